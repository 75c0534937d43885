#include "octree/octree.h"

#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <limits>
#include <random>
#include <stdexcept>
#include <vector>

namespace locvol {
namespace {

const Frame kUnevenFrame = Frame::around({{-1, -1, -1}, {1, 1, 1}}, 0.1, 0.01);

class RandomOctrees {
 public:
  explicit RandomOctrees(std::uint32_t seed) : random_(seed) {}
  std::size_t below(std::size_t n) {
    return std::uniform_int_distribution<std::size_t>(0, n - 1)(random_);
  }
  double between(double low, double high) {
    return std::uniform_real_distribution(low, high)(random_);
  }
  Point point() { return {between(-1, 1), between(-1, 1), between(-1, 1)}; }
  MortonKey key() {
    return kUnevenFrame.key_of(point(), static_cast<int>(below(MortonKey::kMaxLevel + 1)));
  }
  // A mix of levels, deep in a few places.
  LinearOctree octree(int num_splits) {
    LinearOctree octree;
    const Point dense = point();
    for (int i = 0; i < num_splits; ++i) {
      const bool is_dense = below(4) == 0;
      const MortonKey leaf = octree.leaf_owning(kUnevenFrame, is_dense ? dense : point());
      if (leaf.level() < MortonKey::kMaxLevel) octree.split(leaf);
    }
    return octree;
  }

 private:
  std::mt19937 random_;
};

std::vector<MortonKey> copy(std::span<const MortonKey> keys) { return {keys.begin(), keys.end()}; }

TEST(LinearOctree, StartsAsTheRoot) {
  const LinearOctree octree;
  EXPECT_EQ(copy(octree.leaves()), std::vector{MortonKey::root()});
  EXPECT_TRUE(octree.is_leaf(MortonKey::root()));
}

TEST(LinearOctree, SplitsKeepTheCoverUntilTheLastLevel) {
  constexpr std::uint32_t kSeed = 21;
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  RandomOctrees random(kSeed);
  LinearOctree octree;
  const Point p = random.point();
  for (int level = 0; level < MortonKey::kMaxLevel; ++level) {
    const MortonKey leaf = octree.leaf_owning(kUnevenFrame, p);
    ASSERT_EQ(leaf, kUnevenFrame.key_of(p, level));
    octree.split(leaf);
    ASSERT_EQ(octree.size(), 8 + 7 * static_cast<std::size_t>(level));
    ASSERT_FALSE(octree.is_leaf(leaf));
    for (int octant = 0; octant < 8; ++octant) ASSERT_TRUE(octree.is_leaf(leaf.child(octant)));
    ASSERT_NO_THROW(LinearOctree(copy(octree.leaves())));
  }
  EXPECT_EQ(octree.leaf_owning(kUnevenFrame, p).level(), MortonKey::kMaxLevel);
}

TEST(LinearOctree, UniformIsTheSameAsSplittingEverything) {
  LinearOctree octree;
  for (int level = 0; level <= 3; ++level) {
    const LinearOctree uniform = LinearOctree::uniform(level);
    EXPECT_EQ(copy(uniform.leaves()), copy(octree.leaves()));
    for (const MortonKey leaf : copy(octree.leaves())) octree.split(leaf);
  }
}

TEST(LinearOctree, CoarsestWithSomeLeavesHasThemAndNoMoreThanItMust) {
  const LinearOctree uniform = LinearOctree::uniform(3);
  const std::vector<MortonKey> some = {uniform.leaves()[0], uniform.leaves()[77],
                                       uniform.leaves()[78], uniform.leaves()[511]};
  const LinearOctree octree = LinearOctree::coarsest_with(some);
  for (const MortonKey leaf : some) EXPECT_TRUE(octree.is_leaf(leaf));
  // Where eight siblings are leaves, one of them is wanted, or holds one that is.
  for (const MortonKey leaf : octree.leaves())
    EXPECT_TRUE(std::ranges::any_of(
        some, [&](MortonKey key) { return leaf.parent().is_ancestor_or_self_of(key); }));
  EXPECT_EQ(LinearOctree::coarsest_with({}).size(), 1U);
}

TEST(LinearOctree, RefusesWhatIsNoCover) {
  const std::vector<MortonKey> cover = copy(RandomOctrees(22).octree(40).leaves());
  EXPECT_NO_THROW(LinearOctree{cover});
  for (std::size_t i = 0; i < cover.size(); ++i) {
    auto gap = cover, repeated = cover, overlapping = cover, invalid = cover;
    gap.erase(gap.begin() + static_cast<std::ptrdiff_t>(i));
    EXPECT_THROW(LinearOctree{gap}, std::invalid_argument) << i;
    repeated.insert(repeated.begin() + static_cast<std::ptrdiff_t>(i), cover[i]);
    EXPECT_THROW(LinearOctree{repeated}, std::invalid_argument) << i;
    overlapping[i] = overlapping[i].parent();
    EXPECT_THROW(LinearOctree{overlapping}, std::invalid_argument) << i;
    invalid[i] = MortonKey();
    EXPECT_THROW(LinearOctree{invalid}, std::invalid_argument) << i;
  }
  auto unsorted = cover;
  std::swap(unsorted.front(), unsorted.back());
  EXPECT_THROW(LinearOctree{unsorted}, std::invalid_argument);
  EXPECT_THROW(LinearOctree{std::vector<MortonKey>{}}, std::invalid_argument);
  auto twice = cover;
  twice.insert(twice.end(), cover.begin(), cover.end());
  EXPECT_THROW(LinearOctree{twice}, std::invalid_argument);
}

TEST(LinearOctree, LeafAtAgreesWithAllLeaves) {
  constexpr std::uint32_t kSeed = 23;
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  RandomOctrees random(kSeed);
  const LinearOctree octree = random.octree(120);
  for (int i = 0; i < 2000; ++i) {
    const MortonKey key = random.key();
    std::vector<MortonKey> below;
    MortonKey owner;
    for (const MortonKey leaf : octree.leaves()) {
      if (leaf.is_ancestor_or_self_of(key)) owner = leaf;
      if (key.is_ancestor_or_self_of(leaf)) below.push_back(leaf);
    }
    ASSERT_EQ(octree.leaf_at(key), owner.is_valid() ? owner : below.front());
    ASSERT_EQ(octree.is_leaf(key), owner == key);
    ASSERT_EQ(copy(octree.leaves_under(key)), below);
  }
}

TEST(LinearOctree, EveryPointHasItsLeaf) {
  constexpr std::uint32_t kSeed = 24;
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  RandomOctrees random(kSeed);
  const LinearOctree octree = random.octree(120);
  for (int i = 0; i < 2000; ++i) {
    const Point p = random.point();
    const MortonKey leaf = octree.leaf_owning(kUnevenFrame, p);
    ASSERT_TRUE(octree.is_leaf(leaf));
    ASSERT_TRUE(kUnevenFrame.box(leaf).contains(p));
  }
}

TEST(LinearOctree, LeavesWithinAgreeWithAllPairs) {
  constexpr std::uint32_t kSeed = 25;
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  RandomOctrees random(kSeed);
  const LinearOctree octree = random.octree(150);
  for (int i = 0; i < 500; ++i) {
    // Boxes of leaves and distances in whole sides meet their neighbors at exactly the distance.
    const MortonKey leaf = octree.leaves()[random.below(octree.size())];
    const bool is_aligned = i % 2 == 0;
    const Box box =
        is_aligned ? kUnevenFrame.box(leaf) : Box::around(random.point()).joined(random.point());
    const double distance = i % 5 == 0   ? 0
                            : is_aligned ? kUnevenFrame.side(leaf.level())
                                         : random.between(0, 0.5);
    std::vector<MortonKey> expected;
    for (const MortonKey other : octree.leaves())
      if (kUnevenFrame.box(other).squared_distance(box) <= distance * distance)
        expected.push_back(other);
    ASSERT_EQ(octree.leaves_within(kUnevenFrame, box, distance), expected);
  }
}

TEST(LinearOctree, LeavesWithinEndsOfTheScale) {
  const LinearOctree octree = RandomOctrees(26).octree(50);
  const Box corner = Box::around(kUnevenFrame.root_box().min);
  EXPECT_EQ(octree.leaves_within(kUnevenFrame, corner, std::numeric_limits<double>::infinity()),
            copy(octree.leaves()));
  EXPECT_TRUE(octree.leaves_within(kUnevenFrame, corner, -1).empty());
  const Box elsewhere = Box::around(kUnevenFrame.root_box().max + Point{1, 0, 0});
  EXPECT_TRUE(octree.leaves_within(kUnevenFrame, elsewhere, 0.5).empty());
  EXPECT_FALSE(octree.leaves_within(kUnevenFrame, elsewhere, 1).empty());
}

}  // namespace
}  // namespace locvol
