// The queue and the cache against the store that they mirror.
#include "engine/run/run_state.h"

#include <gtest/gtest.h>

#include "tests/engine/closed_shapes.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

using namespace testing_shapes;

const Box kBox{{0, 0, 0}, {1, 1, 1}};

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

TEST_F(RunStateTest, EnqueuesForTheNextEpochAndGrowsTheDirtyBox) {
  RunState state(store_, 1 << 20);
  state.enqueue(leaf(5), Box::around({0, 0, 0}));
  state.enqueue(leaf(3), kBox);
  state.enqueue(leaf(5), Box::around({1, 2, 3}));
  EXPECT_TRUE(stored_queue().empty());
  state.commit();
  const QueuePosition waiting{2, kNoColor};
  EXPECT_EQ(stored_queue(), (std::vector<QueueEntry>{{waiting, leaf(3), kBox},
                                                     {waiting, leaf(5), {{0, 0, 0}, {1, 2, 3}}}}));
  EXPECT_EQ(store_.snapshot().leaf(leaf(5))->queued, waiting);
}

TEST_F(RunStateTest, OpensAnEpochWithColors) {
  RunState state(store_, 1 << 20);
  EXPECT_FALSE(state.open_epoch());
  for (const std::size_t i : {0, 1, 63}) state.enqueue(leaf(i), kBox);
  EXPECT_TRUE(state.open_epoch());
  EXPECT_FALSE(state.open_epoch());
  EXPECT_EQ(state.run.epoch, 2U);
  // Neighbors differ in color, the far leaf shares one.
  EXPECT_EQ(state.queue.front(), (QueuePosition{2, 0}));
  EXPECT_EQ(state.queue.front_leaves(), (std::vector{leaf(0), leaf(63)}));
  // A leaf that still waits keeps its place, a visited one waits for the next epoch.
  state.dequeue(leaf(0));
  state.enqueue(leaf(0), kBox);
  state.enqueue(leaf(1), kBox);
  state.commit();
  const auto queue = stored_queue();
  ASSERT_EQ(queue.size(), 3U);
  EXPECT_EQ(queue[0].leaf, leaf(63));
  EXPECT_EQ(queue[1].position, (QueuePosition{2, 1}));
  EXPECT_EQ(queue[2].position, (QueuePosition{3, kNoColor}));
  EXPECT_EQ(queue[2].leaf, leaf(0));

  // Read again from the store, it goes on there.
  const RunState again(store_, 1 << 20);
  EXPECT_EQ(again.run.epoch, 2U);
  EXPECT_EQ(again.queue.size(), 3U);
  EXPECT_EQ(again.queue.front_leaves(), std::vector{leaf(63)});
}

// Leaves that wait for each other are those whose colors had to differ.
TEST_F(RunStateTest, TellsWhichVisitsMayOverlap) {
  constexpr double kFar = kConflict * 0.05;
  for (const bool is_cover : {true, false}) {
    RunState state(store_, 1 << 20);
    state.run.parameters.size = 0.05;
    state.run.parameters.init = is_cover ? Initialization::kCover : Initialization::kPaper;
    for (const MortonKey leaf : octree_.leaves()) state.enqueue(leaf, kBox);
    EXPECT_TRUE(state.open_epoch());
    state.dequeue(leaf(0));
    state.enqueue(leaf(0), kBox);
    const std::vector<QueuePlace> epoch = state.queue.front_epoch();
    ASSERT_EQ(epoch.size(), 63U);  // and none of the next
    EXPECT_TRUE(std::ranges::is_sorted(epoch));
    int num_independent = 0;
    for (const QueuePlace& a : epoch)
      for (const QueuePlace& b : epoch) {
        if (a == b) continue;
        const double squared = state.box(a.leaf).squared_distance(state.box(b.leaf));
        EXPECT_EQ(state.are_independent(a, b), is_cover && squared > kFar * kFar);
        EXPECT_EQ(state.are_independent(a, b), state.are_independent(b, a));
        EXPECT_TRUE(a.position.color != b.position.color || state.are_independent(a, b));
        num_independent += state.are_independent(a, b);
      }
    EXPECT_EQ(num_independent > 0, is_cover);
    EXPECT_EQ(epoch.back().position.color == 63, !is_cover);
  }
}

TEST_F(RunStateTest, AddsPointsToTheLeafThatOwnsThem) {
  RunState state(store_, 1 << 20);
  const MeshPoint a = state.add_point({0.3, 0.3, 0.3}, PointKind::kSurface);
  const MeshPoint b = state.add_point({0.25, 0.25, 0.25}, PointKind::kVolume);
  const MortonKey owner = state.octree.leaf_owning(state.run.frame, a.position);
  state.commit();
  EXPECT_EQ(store_.snapshot().points(owner).points, (std::vector{a, b}));
  EXPECT_EQ(store_.snapshot().leaf(owner)->num_points, 2U);
  EXPECT_EQ(store_.snapshot().run()->next_point_id, 2U);
}

TEST_F(RunStateTest, WritesChangesThroughATinyCache) {
  RunState state(store_, 0);
  for (std::size_t i = 0; i < octree_.size(); ++i) {
    const Point center = state.box(leaf(i)).center();
    state.add_point(center, PointKind::kVolume);
    state.leaves.put_unresolved(leaf(i), {{{1, center, 0.5}}});
    state.leaves.trim();
    EXPECT_EQ(state.leaves.points(leaf(i)).points.size(), 1U) << "an unwritten change was lost";
    if (i % 10 == 9) state.commit();
  }
  state.commit();
  EXPECT_EQ(state.leaves.unwritten_bytes(), 0U);
  for (std::size_t i = 0; i < octree_.size(); ++i) {
    EXPECT_EQ(store_.snapshot().points(leaf(i)).points.front().position,
              state.box(leaf(i)).center());
    EXPECT_EQ(store_.snapshot().unresolved(leaf(i)).sites.size(), 1U);
    EXPECT_EQ(state.leaves.info(leaf(i)).num_points, 1U);
  }
}

TEST_F(RunStateTest, ErasesLeavesAndNamesThoseThatAreMissing) {
  RunState state(store_, 1 << 20);
  state.add_point({0.1, 0.1, 0.1}, PointKind::kVolume);
  state.leaves.erase_leaf(leaf(0));
  state.leaves.add_leaf(leaf(0).child(0), {}, {}, {});
  state.commit();
  EXPECT_FALSE(store_.snapshot().leaf(leaf(0)));
  EXPECT_TRUE(store_.snapshot().points(leaf(0)).points.empty());
  EXPECT_TRUE(store_.snapshot().leaf(leaf(0).child(0)));
  EXPECT_THROW(state.leaves.info(leaf(0)), StoreError);
}

}  // namespace
}  // namespace locvol
