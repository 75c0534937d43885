// Audits by several ranks, against that of one store that has what they have.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "engine/audit/audit.h"
#include "engine/engine.h"
#include "engine/exchange/thread_ranks.h"
#include "engine/rank_engine.h"
#include "engine/ranks/move_leaves.h"
#include "engine/ranks/rank_store.h"
#include "tests/engine/closed_shapes.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

using namespace testing_shapes;

class AuditOfRanks : public testing::Test {
 protected:
  static constexpr int kNumRanks = 3;

  // Of two components, of which one is all ranks'.
  void mesh(const std::function<void(MeshOptions&)>& choose = [](MeshOptions&) {}) {
    write_off(together(sphere(1, 16, 32), translated(torus(0.5, 0.2, 16, 8), {1.9, 0, 0.4})),
              scratch_ / "input.off");
    MeshOptions options;
    options.input = scratch_ / "input.off";
    options.store = scratch_ / "part-%r";
    options.size = {0.08, false};
    options.leaf_capacity = 300;
    choose(options);
    run_as_ranks(kNumRanks, [&](Exchange& exchange) { mesh_as_rank(options, {}, exchange); });
  }

  std::filesystem::path part(int rank) const { return store_of_rank(scratch_ / "part-%r", rank); }

  // Of the ranks' and of the one store's.
  struct Reports {
    AuditReport of_ranks, of_one;
  };
  Reports audits(std::uint64_t one_in = 1) {
    Reports reports;
    const std::filesystem::path whole = scratch_ / "whole";
    std::filesystem::remove_all(whole);
    run_as_ranks(kNumRanks, [&](Exchange& exchange) {
      const Store own = Store::open(part(exchange.rank()), {.read_only = true});
      const AuditReport report = audit_as_rank(own, exchange, {}, one_in);
      const bool is_first = exchange.rank() == 0;
      if (is_first) reports.of_ranks = report;
      std::optional<Store> one;
      if (is_first) one = Store::open(whole, {.create = true});
      join_leaves({&own, 1}, is_first ? &*one : nullptr, exchange);
    });
    reports.of_one = audit(Store::open(whole, {.read_only = true}), {}, one_in);
    return reports;
  }

  // All is the same, but for the last digits of sums; and each rank describes what it finds.
  void expect_same(Reports reports) {
    AuditReport& of_ranks = reports.of_ranks;
    const AuditReport& of_one = reports.of_one;
    for (const auto sum :
         {&AuditReport::volume, &AuditReport::crease_length, &AuditReport::lost_crease_length}) {
      EXPECT_NEAR(of_ranks.*sum, of_one.*sum, 1e-12);
      of_ranks.*sum = of_one.*sum;
    }
    for (const std::string& violation : of_one.violations)
      EXPECT_TRUE(std::ranges::count(of_ranks.violations, violation)) << violation;
    of_ranks.violations = of_one.violations;
    EXPECT_TRUE(of_ranks == of_one);
    EXPECT_EQ(Names({"input.off", "part-0", "part-1", "part-2", "whole"}), names_in(scratch_));
  }

  // An own leaf with cells that others have a copy of.
  void change_leaf(int rank, const std::function<void(Batch&, MortonKey)>& change) {
    Store store = Store::open(part(rank));
    std::optional<MortonKey> found;
    store.snapshot().for_each_leaf([&](MortonKey leaf, const LeafInfo& info) {
      if (info.holding == Holding::kOwn && info.num_cells > 20 && !info.ranks.empty()) found = leaf;
      return !found;
    });
    ASSERT_TRUE(found);
    Batch batch = store.begin();
    change(batch, *found);
    batch.commit();
  }

  TempDir scratch_;
};

TEST_F(AuditOfRanks, IsThatOfOneStore) {
  mesh();
  const Reports reports = audits();
  EXPECT_TRUE(reports.of_ranks.is_valid());
  EXPECT_EQ(reports.of_ranks.num_components, 2U);
  EXPECT_GT(reports.of_ranks.num_cells, 10'000U);
  expect_same(reports);
}

TEST_F(AuditOfRanks, OfASampleIsThatOfOneStore) {
  mesh();
  for (const std::uint64_t one_in : {2, 5}) {
    const Reports reports = audits(one_in);
    EXPECT_TRUE(reports.of_ranks.is_sample());
    EXPECT_GT(reports.of_ranks.num_components, 2U);
    expect_same(reports);
  }
}

TEST_F(AuditOfRanks, WhereSizesVaryIsThatOfOneStore) {
  mesh([](MeshOptions& options) {
    options.growth = 0.3;
    options.size = {0.15, false};
    options.deviation = Size{0.03, false};
  });
  const Reports reports = audits();
  EXPECT_TRUE(reports.of_ranks.is_valid());
  expect_same(reports);
}

// What is wrong in a leaf at the border is found in the leaves of other ranks, too, though their
// copies of it have not changed.
TEST_F(AuditOfRanks, FindsWhatIsWrongAtBorders) {
  mesh();
  change_leaf(1, [](Batch& batch, MortonKey leaf) {
    LeafPoints points = batch.points(leaf);
    for (MeshPoint& point : points.points) point.position.x += 0.01;
    batch.put_points(leaf, points);
  });
  const Reports moved = audits();
  EXPECT_GT(moved.of_ranks.num_nonempty_circumballs, 0U);
  expect_same(moved);

  change_leaf(2, [](Batch& batch, MortonKey leaf) {
    LeafCells cells = batch.cells(leaf);
    cells.cells.resize(cells.cells.size() / 2);
    cells.cells.push_back(cells.cells.front());
    batch.put_cells(leaf, cells);
  });
  const Reports fewer = audits();
  EXPECT_GT(fewer.of_ranks.num_bad_boundary_vertices + fewer.of_ranks.num_off_surface_vertices, 0U);
  EXPECT_EQ(fewer.of_ranks.num_repeated_cells, 1U);
  EXPECT_FALSE(fewer.of_ranks.is_valid());
  expect_same(fewer);
}

TEST_F(AuditOfRanks, FindsLeavesThatAreNotItsShare) {
  mesh();
  change_leaf(1, [](Batch& batch, MortonKey leaf) {
    LeafInfo info = batch.leaf(leaf).value();
    info.holding = Holding::kCopy;
    batch.put_leaf(leaf, info);
  });
  run_as_ranks(kNumRanks, [&](Exchange& exchange) {
    const Store own = Store::open(part(exchange.rank()), {.read_only = true});
    const AuditReport report = audit_as_rank(own, exchange);
    EXPECT_EQ(report.num_run_faults, 1U);
    EXPECT_FALSE(report.is_valid());
  });
}

// All ways along creases count once, whichever ranks their ends are of.
TEST_F(AuditOfRanks, KnowsCreasesOfOtherRanks) {
  mesh([&](MeshOptions& options) {
    write_off(box_shape({{0, 0, 0}, {1, 0.9, 0.8}}), scratch_ / "input.off");
    options.leaf_capacity = 100;
  });
  const Reports kept = audits();
  EXPECT_TRUE(kept.of_ranks.is_valid());
  EXPECT_NEAR(kept.of_ranks.surface_crease_length, 10.8, 1e-12);
  EXPECT_NEAR(kept.of_ranks.crease_length, 10.8, 1e-12);
  EXPECT_EQ(kept.of_ranks.lost_crease_length, 0);
  expect_same(kept);

  for (int rank = 0; rank < kNumRanks; ++rank) {
    Store store = Store::open(part(rank));
    Batch batch = store.begin();
    store.snapshot().for_each_leaf([&](MortonKey leaf, const LeafInfo& info) {
      if (info.holding != Holding::kOwn) return true;
      LeafPoints points = batch.points(leaf);
      for (MeshPoint& point : points.points)
        if (point.kind == PointKind::kCrease && point.id % 4 == 0) point.kind = PointKind::kSurface;
      batch.put_points(leaf, points);
      return true;
    });
    batch.commit();
  }
  const Reports lost = audits();
  EXPECT_GT(lost.of_ranks.num_lost_creases, 10U);
  EXPECT_EQ(lost.of_ranks.num_violations(), lost.of_ranks.num_lost_creases);
  EXPECT_GT(lost.of_ranks.lost_crease_length, 1);
  EXPECT_NEAR(lost.of_ranks.crease_length, 10.8, 1e-12);
  expect_same(lost);
}

// Places where the boundary could not be made to fit are none of its violations.
TEST_F(AuditOfRanks, KnowsSitesOfOtherRanks) {
  mesh();
  for (int rank = 0; rank < kNumRanks; ++rank)
    change_leaf(rank, [](Batch& batch, MortonKey leaf) {
      LeafInfo info = batch.leaf(leaf).value();
      info.num_unresolved = 1;
      batch.put_leaf(leaf, info);
      LeafPoints points = batch.points(leaf);
      batch.put_unresolved(leaf, {.sites = {{1, points.points.front().position, 0.01}}});
      RunRecord run = batch.run().value();
      run.counts.num_unresolved = 1;
      batch.put_run(run);
      for (MeshPoint& point : points.points) point.position.x += 0.01;
      batch.put_points(leaf, points);
    });
  const Reports reports = audits();
  EXPECT_GT(reports.of_ranks.num_open, 0U);
  expect_same(reports);
}

}  // namespace
}  // namespace locvol
