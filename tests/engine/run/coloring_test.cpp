#include "engine/run/coloring.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <tuple>

namespace locvol {
namespace {

// An octree of mixed levels, by random splits.
LinearOctree random_octree(std::mt19937_64& random, int num_splits) {
  LinearOctree octree;
  for (int i = 0; i < num_splits; ++i) {
    const auto leaf = octree.leaves()[random() % octree.size()];
    if (leaf.level() < 6) octree.split(leaf);
  }
  return octree;
}

std::vector<MortonKey> random_subset(std::mt19937_64& random, std::span<const MortonKey> leaves) {
  std::vector<MortonKey> subset;
  for (const MortonKey leaf : leaves)
    if (random() % 3 != 0) subset.push_back(leaf);
  return subset;
}

bool are_close(const Frame& frame, MortonKey a, MortonKey b, double distance) {
  return frame.box(a).squared_distance(frame.box(b)) <= distance * distance;
}

// Each has the smallest color that none has which is near and comes before it: by weight, then in
// Morton order.
void expect_greedy(const Frame& frame, const std::vector<LeafToColor>& leaves,
                   const std::vector<std::uint32_t>& colors) {
  ASSERT_EQ(colors.size(), leaves.size());
  for (std::size_t i = 0; i < leaves.size(); ++i) {
    std::vector<bool> is_used(leaves.size() + 1);
    for (std::size_t j = 0; j < leaves.size(); ++j) {
      const auto& [a, b] = std::tie(leaves[i], leaves[j]);
      const bool is_before = b.weight > a.weight || (b.weight == a.weight && j < i);
      if (is_before && are_close(frame, a.leaf, b.leaf, std::max(a.distance, b.distance)))
        is_used[colors[j]] = true;
    }
    const auto smallest = std::ranges::find(is_used, false) - is_used.begin();
    EXPECT_EQ(colors[i], smallest) << "leaf " << i;
  }
}

TEST(Coloring, IsGreedyInMortonOrderAgainstAllPairs) {
  const std::uint64_t seed = std::random_device{}();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937_64 random(seed);
  for (int round = 0; round < 20; ++round) {
    const Frame frame({-3, 1, 2}, 0.25);
    const LinearOctree octree = random_octree(random, 40);
    const auto leaves = random_subset(random, octree.leaves());
    const double distance = frame.side(static_cast<int>(random() % 6)) * 0.9;
    std::vector<LeafToColor> alike;
    for (const MortonKey leaf : leaves) alike.push_back({leaf, distance});
    expect_greedy(frame, alike, color_leaves(octree, frame, leaves, distance));
  }
}

TEST(Coloring, IsGreedyByWeightAgainstAllPairs) {
  const std::uint64_t seed = std::random_device{}();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937_64 random(seed);
  for (int round = 0; round < 20; ++round) {
    const Frame frame({-3, 1, 2}, 0.25);
    const LinearOctree octree = random_octree(random, 40);
    std::vector<LeafToColor> leaves;
    for (const MortonKey leaf : random_subset(random, octree.leaves()))
      leaves.push_back({leaf, frame.side(static_cast<int>(random() % 6)) * 0.9, random() % 5});
    expect_greedy(frame, leaves, color_leaves(octree, frame, leaves));
  }
}

TEST(Coloring, GivesHeavyLeavesOneColor) {
  const Frame frame({0, 0, 0}, 1);
  const LinearOctree octree = LinearOctree::uniform(3);
  std::vector<LeafToColor> leaves;  // of eight that meet the last is heavy, none beside another
  for (const MortonKey leaf : octree.leaves())
    leaves.push_back({leaf, 0.1 * frame.side(3), leaf.octant() == 7 ? 9U : 1U});
  const auto colors = color_leaves(octree, frame, leaves);
  for (std::size_t i = 0; i < leaves.size(); ++i) EXPECT_EQ(colors[i] == 0, leaves[i].weight == 9);
}

TEST(Coloring, NeedsEightColorsForLeavesAsWideAsTheDistance) {
  const Frame frame({0, 0, 0}, 1);
  const LinearOctree octree = LinearOctree::uniform(3);
  const auto colors = color_leaves(octree, frame, octree.leaves(), 0.99 * frame.side(3));
  EXPECT_EQ(std::ranges::max(colors), 7U);
  for (std::size_t i = 0; i < octree.size(); ++i)
    EXPECT_EQ(colors[i], static_cast<std::uint32_t>(octree.leaves()[i].octant()));
}

TEST(Coloring, GivesDistantLeavesOneColor) {
  const Frame frame({0, 0, 0}, 1);
  const LinearOctree octree = LinearOctree::uniform(2);
  const std::vector<MortonKey> corners{octree.leaves().front(), octree.leaves().back()};
  EXPECT_EQ(color_leaves(octree, frame, corners, frame.side(2)),
            (std::vector<std::uint32_t>{0, 0}));
  EXPECT_EQ(color_leaves(octree, frame, corners, 4 * frame.side(2)),
            (std::vector<std::uint32_t>{0, 1}));
  EXPECT_TRUE(color_leaves(octree, frame, {}, 1).empty());
}

}  // namespace
}  // namespace locvol
