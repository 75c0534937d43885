// Replays and reports of leaves against the run that they look at.
#include "engine/inspect/replay.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <numeric>

#include "engine/engine.h"
#include "engine/inspect/leaf_report.h"
#include "engine/run/leaf_distances.h"
#include "engine/run/run_state.h"
#include "tests/damaged_record.h"
#include "tests/engine/closed_shapes.h"
#include "tests/file_bytes.h"
#include "tests/temp_dir.h"
#include "tests/vtu_arrays.h"

namespace locvol {
namespace {

using namespace testing_shapes;
using Action = RefineStep::Action;

constexpr StoreOptions kReadOnly{.read_only = true};

// A run over a thin torus, stopped after some visits.
class TorusRun {
 public:
  explicit TorusRun(Initialization init, std::uint64_t leaf_capacity) {
    write_off(torus(1, 0.3, 60, 24), scratch_ / "torus.off");
    options_.input = scratch_ / "torus.off";
    options_.store = scratch_ / "store";
    options_.size = {init == Initialization::kPaper ? 0.2 : 0.12, false};
    options_.init = init;
    options_.leaf_capacity = leaf_capacity;
  }

  const std::filesystem::path& store() const { return options_.store; }
  void finish() { EXPECT_EQ(mesh(options_).outcome, RunOutcome::kDone); }
  // Stops before the visit after `num_visits` more of refinement.
  void stop_after(std::uint64_t num_visits) {
    bool is_refining = false;
    std::uint64_t num_asked = 0;
    RunControl control;
    control.num_threads = 1;
    control.is_stopped = [&] {
      if (!is_refining && Store::exists(options_.store)) {
        const Store store = Store::open(options_.store, kReadOnly);
        is_refining = store.snapshot().run()->phase == Phase::kRefine;
      }
      return is_refining && num_asked++ == num_visits;
    };
    EXPECT_EQ(mesh(options_, control).outcome, RunOutcome::kInterrupted);
  }

 private:
  TempDir scratch_;
  MeshOptions options_;
};

std::vector<MortonKey> leaves_with_points(const Store& store) {
  std::vector<MortonKey> leaves;
  store.snapshot().for_each_leaf([&](MortonKey key, const LeafInfo& info) {
    if (info.num_points > 0) leaves.push_back(key);
    return true;
  });
  return leaves;
}

class ReplayOf : public testing::TestWithParam<Initialization> {};

TEST_P(ReplayOf, EachCleanLeafIsTheSameAgain) {
  TorusRun run(GetParam(), GetParam() == Initialization::kPaper ? 60 : 400);
  run.finish();
  const Store store = Store::open(run.store(), kReadOnly);
  std::uint64_t num_cells = 0;
  for (const MortonKey leaf : leaves_with_points(store)) {
    const StoredVisit visit = stored_visit(store, leaf);
    EXPECT_TRUE(visit.is_clean);
    const LeafInfo info = *store.snapshot().leaf(leaf);
    EXPECT_EQ(visit.num_visits, info.num_visits);
    EXPECT_EQ(visit.input.own.size(), info.num_points);
    const Replay again = replay(visit);
    EXPECT_TRUE(again.reproduces()) << again.error;
    EXPECT_EQ(again.mesh.cells.size(), info.num_cells);
    num_cells += again.mesh.cells.size();
  }
  EXPECT_EQ(num_cells, store.snapshot().run()->counts.num_cells);
}

// What a waiting leaf's replay shows is what the run does to it next.
TEST_P(ReplayOf, TheFrontOfTheQueueIsWhatTheRunDoesNext) {
  bool has_inserted = false;
  for (const std::uint64_t num_visits : {0, 1, 2, 5}) {
    SCOPED_TRACE(num_visits);
    TorusRun run(GetParam(), GetParam() == Initialization::kPaper ? 60 : 400);
    run.stop_after(num_visits);
    StoredVisit visit;
    RunRecord before;
    {
      Store store = Store::open(run.store());
      RunState state(store, 1 << 20);
      const auto distance = [&](MortonKey leaf) { return conflict_of_refinement(state, leaf); };
      if (state.queue().open_epoch(distance)) state.commits().commit();
      before = state.run();
      visit = stored_visit(store, state.queue().entries().front_leaves().front());
    }
    EXPECT_FALSE(visit.is_clean);
    const Replay next = replay(visit);
    EXPECT_EQ(next.error, "");
    run.stop_after(1);
    const Store store = Store::open(run.store(), kReadOnly);
    const RunRecord after = *store.snapshot().run();
    EXPECT_EQ(after.counts.num_visits, before.counts.num_visits + 1);
    for (std::size_t c = 0; c < kNumConditions; ++c)
      EXPECT_EQ(after.counts.num_insertions[c] - before.counts.num_insertions[c],
                next.delta.stats.insertions[c]);
    EXPECT_EQ(after.counts.num_moves - before.counts.num_moves, next.delta.stats.moves);
    const auto num_steps = [&](Action action) {
      return static_cast<std::uint64_t>(
          std::ranges::count(next.steps, action, &RefineStep::action));
    };
    const auto& insertions = next.delta.stats.insertions;
    EXPECT_EQ(num_steps(Action::kInsert),
              std::reduce(insertions.begin(), insertions.end(), std::uint64_t{0}));
    EXPECT_EQ(num_steps(Action::kMove), next.delta.stats.moves);
    // What is moved is inserted anew, once for all of its moves.
    EXPECT_GE(next.delta.inserted.size(), num_steps(Action::kInsert));
    EXPECT_LE(next.delta.inserted.size(), num_steps(Action::kInsert) + num_steps(Action::kMove));
    has_inserted |= !next.delta.inserted.empty();
    const auto info = store.snapshot().leaf(visit.leaf);
    EXPECT_EQ(info.has_value(), !next.delta.is_overfull);
    if (info) {
      EXPECT_EQ(info->num_cells, next.mesh.cells.size());
    }
  }
  EXPECT_TRUE(has_inserted);
}

INSTANTIATE_TEST_SUITE_P(Engine, ReplayOf,
                         testing::Values(Initialization::kCover, Initialization::kPaper));

TEST(Replay, ChangesNothing) {
  TorusRun run(Initialization::kCover, 400);
  run.stop_after(3);
  const auto bytes = [&] { return bytes_of(run.store() / "data.mdb"); };
  const std::string before = bytes();
  {
    const Store store = Store::open(run.store(), kReadOnly);
    for (const MortonKey leaf : leaves_with_points(store)) replay(stored_visit(store, leaf));
  }
  EXPECT_TRUE(bytes() == before);
}

TEST(Replay, SaysWhenTheCellsDiffer) {
  TorusRun run(Initialization::kCover, 400);
  run.finish();
  MortonKey leaf;
  {
    Store store = Store::open(run.store());
    leaf = leaves_with_points(store).back();
    LeafCells cells = store.snapshot().cells(leaf);
    ASSERT_GT(cells.cells.size(), 2U);
    cells.cells.pop_back();
    std::swap(cells.cells[0][0], cells.cells[0][1]);  // inverted
    Batch batch = store.begin();
    batch.put_cells(leaf, cells);
    batch.commit();
  }
  const Replay again = replay(stored_visit(Store::open(run.store(), kReadOnly), leaf));
  EXPECT_FALSE(again.reproduces());
  EXPECT_EQ(again.num_cells_new, 2U);
  EXPECT_EQ(again.num_cells_gone, 1U);
}

TEST(Replay, RefusesWhatCannotBeVisited) {
  TorusRun run(Initialization::kCover, 400);
  run.finish();
  const Store store = Store::open(run.store(), kReadOnly);
  EXPECT_THROW(stored_visit(store, MortonKey::root()), StoreError);
  const TempDir other;
  EXPECT_THROW(stored_visit(Store::open(other / "empty", {.create = true}), MortonKey::root()),
               StoreError);
}

TEST(LeafReport, AgreesWithTheWholeRun) {
  TorusRun run(Initialization::kCover, 400);
  run.finish();
  const Store store = Store::open(run.store(), kReadOnly);
  const Snapshot snapshot = store.snapshot();
  const RunRecord record = *snapshot.run();
  std::map<std::uint64_t, MeshPoint> all;
  for (const MortonKey leaf : snapshot.leaf_keys())
    for (const MeshPoint& p : snapshot.points(leaf).points) all[p.id] = p;
  for (const MortonKey leaf : leaves_with_points(store)) {
    const auto report = report_leaf(snapshot, record, leaf);
    ASSERT_TRUE(report);
    EXPECT_TRUE(report->faults.empty());
    EXPECT_EQ(report->info, snapshot.leaf(leaf));
    EXPECT_EQ(report->cells, snapshot.cells(leaf));
    EXPECT_EQ(report->num_stale_cells, 0U);
    ASSERT_EQ(report->mesh.cells.size(), report->cells.cells.size());
    CountsByKind ghosts{};
    const double reach = kReach * record.parameters.size;
    for (const auto& [id, p] : all)
      if (record.frame.key_of(p.position, leaf.level()) != leaf &&
          report->box.squared_distance(p.position) <= reach * reach)
        ++ghosts[static_cast<std::size_t>(p.kind)];
    EXPECT_EQ(report->ghosts, ghosts);
    for (std::size_t i = 0; i < report->mesh.cells.size(); ++i)
      for (std::size_t k = 0; k < 4; ++k) {
        const auto id = report->cells.vertices[report->cells.cells[i][k]];
        EXPECT_EQ(report->mesh.corners(i)[k], all.at(id).position);
      }
    for (const MortonKey neighbor : report->neighbors)
      EXPECT_TRUE(record.frame.box(neighbor).overlaps(report->box) && neighbor != leaf);
    const CellQuality worst = worst_quality(report->mesh);
    EXPECT_LT(worst.circumradius, record.parameters.size);
    EXPECT_LE(worst.radius_edge_ratio, 2 * (1 + 1e-9));
  }
  EXPECT_FALSE(report_leaf(snapshot, record, MortonKey::root()));
}

TEST(LeafReport, ShowsWhatIsLeftOfADamagedLeaf) {
  TorusRun run(Initialization::kCover, 400);
  run.finish();
  MortonKey leaf;
  LeafPoints points;
  {
    const Store store = Store::open(run.store(), kReadOnly);
    leaf = leaves_with_points(store).front();
    points = store.snapshot().points(leaf);
  }
  damage_record(run.store(), points, leaf);
  const Store store = Store::open(run.store(), kReadOnly);
  const auto report = report_leaf(store.snapshot(), *store.snapshot().run(), leaf);
  ASSERT_TRUE(report);
  ASSERT_EQ(report->faults.size(), 1U);
  EXPECT_EQ(report->faults[0].leaf, leaf);
  EXPECT_TRUE(report->points.points.empty());
  EXPECT_EQ(report->cells.cells.size(), report->info->num_cells);
  EXPECT_GT(report->num_stale_cells, 0U);
  EXPECT_GT(report->num_triangles, 0U);
  EXPECT_THROW(stored_visit(store, leaf), CorruptRecord);
}

TEST(LeavesVtu, HoldsBoxesAndCounts) {
  TorusRun run(Initialization::kCover, 400);
  run.stop_after(4);
  const Store store = Store::open(run.store(), kReadOnly);
  const Frame frame = store.snapshot().run()->frame;
  std::vector<LeafRow> rows;
  std::vector<Fault> faults;
  const auto take = [&](const LeafRow& row) {
    rows.push_back(row);
    return true;
  };
  scan_leaves(store, take, faults);
  const TempDir scratch;
  const auto bytes = write_leaves_vtu(rows, frame, scratch / "leaves.vtu");
  EXPECT_EQ(bytes, std::filesystem::file_size(scratch / "leaves.vtu"));
  const VtuArrays vtu(scratch / "leaves.vtu");
  ASSERT_EQ(vtu.num_cells(), rows.size());
  const auto points = vtu.array<Point>("Float64", "Points");
  const auto keys = vtu.array<std::uint64_t>("UInt64", "key");
  const auto states = vtu.array<std::int64_t>("Int64", "state");
  const auto num_points = vtu.array<std::int64_t>("Int64", "points");
  const auto queued = vtu.array<std::int64_t>("Int64", "queued");
  const auto epochs = vtu.array<std::int64_t>("Int64", "epoch");
  ASSERT_EQ(points.size(), 8 * rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Box box = frame.box(rows[i].key);
    EXPECT_EQ(points[8 * i], box.min);
    EXPECT_EQ(points[8 * i + 2], (Point{box.max.x, box.max.y, box.min.z}));
    EXPECT_EQ(points[8 * i + 6], box.max);
    EXPECT_EQ(keys[i], rows[i].key.bits());
    EXPECT_EQ(states[i], static_cast<std::int64_t>(rows[i].state()));
    EXPECT_EQ(num_points[i], static_cast<std::int64_t>(rows[i].info->num_points));
    EXPECT_EQ(queued[i], rows[i].info->queued ? 1 : 0);
    EXPECT_EQ(epochs[i], rows[i].info->queued ? std::int64_t{rows[i].info->queued->epoch} : -1);
  }
  EXPECT_GT(std::ranges::count(queued, 1), 0);
}

}  // namespace
}  // namespace locvol
