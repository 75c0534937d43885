#include "octree/shares.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <iterator>
#include <random>
#include <vector>

#include "octree/octree.h"

namespace locvol {
namespace {

const Frame kSharedFrame = Frame({-3, 1, 10}, 0x1p-18);

LinearOctree random_octree(std::mt19937_64& random, int num_splits) {
  LinearOctree octree;
  for (int i = 0; i < num_splits; ++i) octree.split(octree.leaves()[random() % octree.size()]);
  return octree;
}

TEST(Shares, AreIntervalsOfAboutEqualCost) {
  std::mt19937_64 random(3);
  for (int round = 0; round < 30; ++round) {
    const LinearOctree octree = random_octree(random, 60);
    std::vector<double> costs;
    double total = 0, largest = 0;
    for (std::size_t i = 0; i < octree.size(); ++i) {
      costs.push_back(static_cast<double>(random() % 10));
      total += costs.back();
      largest = std::max(largest, costs.back());
    }
    const int num_ranks = 1 + static_cast<int>(random() % 12);
    const Shares shares = Shares::of_equal_cost(octree.leaves(), costs, num_ranks);
    ASSERT_EQ(shares.num_ranks(), num_ranks);
    std::vector<double> of_rank(static_cast<std::size_t>(num_ranks));
    int last = 0;
    for (std::size_t i = 0; i < octree.size(); ++i) {
      const int owner = shares.owner_of(octree.leaves()[i]);
      EXPECT_GE(owner, last);
      last = owner;
      of_rank[static_cast<std::size_t>(owner)] += costs[i];
      if (octree.leaves()[i].level() < MortonKey::kMaxLevel) {
        EXPECT_EQ(shares.owner_of(octree.leaves()[i].child(static_cast<int>(random() % 8))), owner);
      }
    }
    for (const double cost : of_rank) EXPECT_NEAR(cost, total / num_ranks, largest + 1e-9);
  }
}

// Some of which may be empty.
TEST(Shares, AreRangesOfKeys) {
  std::mt19937_64 random(5);
  for (int round = 0; round < 30; ++round) {
    const LinearOctree octree = random_octree(random, 40);
    const auto leaves = octree.leaves();
    std::vector<MortonKey> first(1 + random() % 9);
    for (MortonKey& key : first) key = leaves[random() % leaves.size()];
    first.front() = leaves.front();
    std::ranges::sort(first);
    const Shares shares(first);
    for (int rank = 0; rank < shares.num_ranks(); ++rank) {
      const KeyRange range = shares.range_of(rank);
      const auto is_own = [&](MortonKey leaf) { return shares.owner_of(leaf) == rank; };
      std::vector<MortonKey> own;
      std::ranges::copy_if(leaves, std::back_inserter(own), is_own);
      EXPECT_TRUE(std::ranges::equal(range.begun_of(leaves), own));
      EXPECT_EQ(range.is_all(), own.size() == leaves.size());
      for (MortonKey node : leaves)
        for (;; node = node.parent()) {
          const auto under = octree.leaves_under(node);
          EXPECT_EQ(range.has_begin_of(node), is_own(under.front()));
          EXPECT_EQ(range.contains(node), std::ranges::all_of(under, is_own));
          EXPECT_EQ(range.overlaps(node), std::ranges::any_of(under, is_own));
          if (node.level() == 0) break;
        }
    }
  }
}

TEST(Shares, FindTheRanksNearABox) {
  std::mt19937_64 random(4);
  for (int round = 0; round < 60; ++round) {
    const LinearOctree octree = random_octree(random, 40);
    std::vector<double> costs(octree.size());
    for (double& cost : costs) cost = static_cast<double>(random() % 4);
    const Shares shares =
        Shares::of_equal_cost(octree.leaves(), costs, 1 + static_cast<int>(random() % 9));
    for (int i = 0; i < 20; ++i) {
      const Box box = kSharedFrame.box(octree.leaves()[random() % octree.size()]);
      const double distance = 0.01 * static_cast<double>(random() % 300) - 0.1;
      std::vector<int> expected;
      for (const MortonKey leaf : octree.leaves_within(kSharedFrame, box, distance))
        expected.push_back(shares.owner_of(leaf));
      const auto repeated = std::ranges::unique(expected);
      expected.erase(repeated.begin(), repeated.end());
      EXPECT_EQ(shares.ranks_within(kSharedFrame, box, distance), expected);
    }
  }
}

TEST(Shares, OfMoreRanksThanLeavesHaveSomeWithout) {
  const LinearOctree octree = LinearOctree::uniform(1);
  const Shares shares = Shares::of_equal_cost(octree.leaves(), std::vector<double>(8, 1.0), 16);
  EXPECT_EQ(shares.num_ranks(), 16);
  for (const MortonKey leaf : octree.leaves()) EXPECT_LT(shares.owner_of(leaf), 16);
  EXPECT_EQ(Shares().owner_of(octree.leaves().back()), 0);
}

}  // namespace
}  // namespace locvol
