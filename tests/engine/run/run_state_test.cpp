// The queue and the cache against the store that they mirror.
#include "engine/run/run_state.h"

#include <gtest/gtest.h>

#include "engine/run/leaf_distances.h"
#include "tests/engine/closed_shapes.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

using namespace testing_shapes;

class RunStateTest : public testing::Test {
 protected:
  RunStateTest() {
    RunRecord run;
    run.parameters.size = 0.01;
    run.frame = Frame({0, 0, 0}, 1.0 / (1 << MortonKey::kMaxLevel));
    run.phase = Phase::kRefine;
    run.epoch = 1;
    Batch batch = store_.begin();
    batch.put_run(run);
    for (const MortonKey leaf : octree_.leaves()) batch.put_leaf(leaf, {});
    batch.commit();
  }
  static ConflictDistance distance_in(const RunView& run) {
    return [run](MortonKey leaf) { return conflict_of_refinement(run, leaf); };
  }
  static bool open_epoch(RunState& state) { return state.queue().open_epoch(distance_in(state)); }
  MortonKey leaf(std::size_t i) const { return octree_.leaves()[i]; }
  std::vector<QueueEntry> stored_queue() const {
    std::vector<QueueEntry> queue;
    store_.snapshot().for_each_queued([&](const QueueEntry& entry) {
      queue.push_back(entry);
      return true;
    });
    return queue;
  }

  TempDir scratch_;
  LinearOctree octree_ = LinearOctree::uniform(2);
  Store store_ = Store::open(scratch_ / "store", {.create = true});
};

TEST_F(RunStateTest, EnqueuesOnceForTheNextEpoch) {
  RunState state(store_, 1 << 20);
  state.queue().enqueue(leaf(5));
  state.queue().enqueue(leaf(3));
  state.queue().enqueue(leaf(5));
  EXPECT_TRUE(stored_queue().empty());
  state.commits().commit();
  const QueuePosition waiting{2, kNoColor};
  EXPECT_EQ(stored_queue(), (std::vector<QueueEntry>{{waiting, leaf(3)}, {waiting, leaf(5)}}));
  EXPECT_EQ(store_.snapshot().leaf(leaf(5))->queued, waiting);
}

TEST_F(RunStateTest, OpensAnEpochWithColors) {
  RunState state(store_, 1 << 20);
  EXPECT_FALSE(open_epoch(state));
  for (const std::size_t i : {0, 1, 63}) state.queue().enqueue(leaf(i));
  EXPECT_TRUE(open_epoch(state));
  EXPECT_FALSE(open_epoch(state));
  EXPECT_EQ(state.run().epoch, 2U);
  // Neighbors differ in color, the far leaf shares one.
  EXPECT_EQ(state.queue().entries().front(), (QueuePosition{2, 0}));
  EXPECT_EQ(state.queue().entries().front_leaves(), (std::vector{leaf(0), leaf(63)}));
  // A leaf that still waits keeps its place, a visited one waits for the next epoch.
  state.queue().dequeue(leaf(0));
  state.queue().enqueue(leaf(0));
  state.queue().enqueue(leaf(1));
  state.commits().commit();
  const auto queue = stored_queue();
  ASSERT_EQ(queue.size(), 3U);
  EXPECT_EQ(queue[0].leaf, leaf(63));
  EXPECT_EQ(queue[1].position, (QueuePosition{2, 1}));
  EXPECT_EQ(queue[2].position, (QueuePosition{3, kNoColor}));
  EXPECT_EQ(queue[2].leaf, leaf(0));

  // Read again from the store, it goes on there.
  RunState again(store_, 1 << 20);
  EXPECT_EQ(again.run().epoch, 2U);
  EXPECT_EQ(again.queue().entries().size(), 3U);
  EXPECT_EQ(again.queue().entries().front_leaves(), std::vector{leaf(63)});
}

// Leaves that wait for each other are those whose colors had to differ.
TEST_F(RunStateTest, TellsWhichVisitsMayOverlap) {
  constexpr double kFar = kConflict * 0.05;
  for (const bool is_cover : {true, false}) {
    RunRecord run = *store_.snapshot().run();
    run.parameters.size = 0.05;
    run.parameters.init = is_cover ? Initialization::kCover : Initialization::kPaper;
    Batch batch = store_.begin();
    batch.put_run(run);
    batch.commit();
    RunState state(store_, 1 << 20);
    for (const MortonKey leaf : octree_.leaves()) state.queue().enqueue(leaf);
    EXPECT_TRUE(open_epoch(state));
    state.queue().dequeue(leaf(0));
    state.queue().enqueue(leaf(0));
    const std::vector<QueueEntry> epoch = state.queue().entries().front_epoch();
    ASSERT_EQ(epoch.size(), 63U);  // and none of the next
    EXPECT_TRUE(std::ranges::is_sorted(epoch));
    int num_independent = 0;
    const auto are_independent = [&](const QueueEntry& a, const QueueEntry& b) {
      return state.queue().are_independent(a, b, distance_in(state));
    };
    for (const QueueEntry& a : epoch)
      for (const QueueEntry& b : epoch) {
        if (a == b) continue;
        const double squared = state.box(a.leaf).squared_distance(state.box(b.leaf));
        EXPECT_EQ(are_independent(a, b), is_cover && squared > kFar * kFar);
        EXPECT_EQ(are_independent(a, b), are_independent(b, a));
        EXPECT_TRUE(a.position.color != b.position.color || are_independent(a, b));
        num_independent += are_independent(a, b);
      }
    EXPECT_EQ(num_independent > 0, is_cover);
    EXPECT_EQ(epoch.back().position.color == 63, !is_cover);
  }
}

TEST_F(RunStateTest, AddsPointsToTheLeafThatOwnsThem) {
  RunState state(store_, 1 << 20);
  const MeshPoint a = state.points().add({0.3, 0.3, 0.3}, PointKind::kSurface);
  const MeshPoint b = state.points().add({0.25, 0.25, 0.25}, PointKind::kVolume);
  const MortonKey owner = state.octree().leaf_owning(state.frame(), a.position);
  state.commits().commit();
  EXPECT_EQ(store_.snapshot().points(owner).points, (std::vector{a, b}));
  EXPECT_EQ(store_.snapshot().leaf(owner)->num_points, 2U);
  EXPECT_EQ(store_.snapshot().run()->next_point_id, 2U);
}

TEST_F(RunStateTest, GivesIdsToVisitsByTheirPlaces) {
  RunState state(store_, 1 << 20);
  const Point p = {0.3, 0.3, 0.3};
  state.points().begin_ids(1000);
  EXPECT_EQ(state.points().add(p, PointKind::kVolume).id, 1000U);
  EXPECT_EQ(state.points().add(p, PointKind::kVolume).id, 1001U);
  state.points().end_ids();
  state.points().begin_ids();
  EXPECT_EQ(state.points().add(p, PointKind::kVolume).id, 1000 + kIdsOfVisit);
  state.points().end_ids();
  EXPECT_EQ(state.run().next_point_id, 1000 + 2 * kIdsOfVisit);
}

TEST_F(RunStateTest, WritesChangesThroughATinyCache) {
  RunState state(store_, 0);
  for (std::size_t i = 0; i < octree_.size(); ++i) {
    const Point center = state.box(leaf(i)).center();
    state.points().add(center, PointKind::kVolume);
    state.records().put_unresolved(leaf(i), {{{1, center, 0.5}}});
    state.leaves().trim();
    EXPECT_EQ(state.leaves().points(leaf(i)).points.size(), 1U) << "an unwritten change was lost";
    if (i % 10 == 9) state.commits().commit();
  }
  state.commits().commit();
  EXPECT_EQ(state.leaves().unwritten_bytes(), 0U);
  for (std::size_t i = 0; i < octree_.size(); ++i) {
    EXPECT_EQ(store_.snapshot().points(leaf(i)).points.front().position,
              state.box(leaf(i)).center());
    EXPECT_EQ(store_.snapshot().unresolved(leaf(i)).sites.size(), 1U);
    EXPECT_EQ(state.leaves().info(leaf(i)).num_points, 1U);
  }
}

TEST_F(RunStateTest, SplitsLeavesAndNamesThoseThatAreMissing) {
  RunState state(store_, 1 << 20);
  const MeshPoint point = state.points().add({0.1, 0.1, 0.1}, PointKind::kVolume);
  state.records().put_cells(leaf(0), {{0, 1, 2, 3}, {{0, 1, 2, 3}}});
  state.records().put_unresolved(leaf(0), {{{1, point.position, 0.5}}});
  std::array<LeafRecords::Child, 8> children;
  children[0].points.points = {point};
  state.records().split(leaf(0), children);
  state.commits().commit();
  EXPECT_FALSE(store_.snapshot().leaf(leaf(0)));
  EXPECT_TRUE(store_.snapshot().points(leaf(0)).points.empty());
  EXPECT_EQ(stored_queue(), (std::vector<QueueEntry>{{{2, kNoColor}, leaf(0).child(0)}}));
  EXPECT_EQ(store_.snapshot().leaf(leaf(0).child(0))->num_points, 1U);
  EXPECT_TRUE(store_.snapshot().leaf(leaf(0).child(7)));
  EXPECT_EQ(store_.snapshot().run()->counts, RunCounts{.num_points = 1});
  EXPECT_THROW(state.leaves().info(leaf(0)), StoreError);
}

// The run's counts are the sums over its leaves, whatever replaces what.
TEST_F(RunStateTest, KeepsTheCountsOfWhatItIsGiven) {
  RunState state(store_, 1 << 20);
  const MeshPoint gone = state.points().add({0.1, 0.1, 0.1}, PointKind::kVolume);
  state.points().add({0.1, 0.2, 0.1}, PointKind::kVolume);
  state.points().remove(gone);
  EXPECT_THROW(state.points().remove(gone), RefineError);
  for (const std::size_t i : {0, 1}) {
    state.records().put_cells(leaf(i), {{0, 1, 2, 3, 4}, {{0, 1, 2, 3}, {1, 2, 3, 4}}});
    state.records().put_num_core_cells(leaf(i), 10);
    state.records().put_unresolved(leaf(i), {{{1, {}, 0.5}, {2, {}, 0.5}}});
    state.records().add_visit(leaf(i), {.insertions = {1, 0, 0, 0, 0, 2}, .deletions = 3});
  }
  state.records().put_num_core_cells(leaf(0), 4);
  state.records().put_unresolved(leaf(1), {});
  state.records().leave_out_cells(leaf(1), {{0, 1, 2, 3}, {{0, 1, 2, 3}}});
  EXPECT_EQ(state.leaves().info(leaf(1)).num_cells, 1U);
  EXPECT_EQ(state.leaves().info(leaf(1)).num_left_out, 1U);
  EXPECT_EQ(state.run().counts, (RunCounts{.num_visits = 2,
                                           .num_points = 1,
                                           .num_cells = 17,
                                           .num_unresolved = 2,
                                           .num_insertions = {2, 0, 0, 0, 0, 4},
                                           .num_deletions = 6}));
}

}  // namespace
}  // namespace locvol
