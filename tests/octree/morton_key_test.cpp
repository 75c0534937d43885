#include "octree/morton_key.h"

#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <random>

#include "tests/octree/random_places.h"

namespace locvol {
namespace {

static_assert(!MortonKey().is_valid());
static_assert(MortonKey::root().is_valid() && MortonKey::root().level() == 0);
static_assert(MortonKey::root().child(5).octant() == 5);
static_assert(MortonKey::root().child(5).parent() == MortonKey::root());

class RandomKeys {
 public:
  explicit RandomKeys(std::uint32_t seed) : random_(seed) {}
  int below(int n) { return std::uniform_int_distribution(0, n - 1)(random_); }
  GridPoint cell() { return {coordinate(), coordinate(), coordinate()}; }
  MortonKey key(int level) { return MortonKey::containing(cell(), level); }
  MortonKey key() { return key(below(MortonKey::kMaxLevel + 1)); }

 private:
  std::uint32_t coordinate() {
    return std::uniform_int_distribution<std::uint32_t>(0, kGridSide - 1)(random_);
  }
  std::mt19937 random_;
};

// The key as the header draws it, bit by bit.
MortonKey key_by_definition(GridPoint cell, int level) {
  std::uint64_t bits = 0;
  for (int l = 0; l < level; ++l) {
    const int bit = MortonKey::kMaxLevel - 1 - l;
    for (const std::uint32_t v : {cell.z, cell.y, cell.x}) bits = bits << 1 | (v >> bit & 1);
  }
  return MortonKey::from_bits((bits << 1 | 1) << (3 * (MortonKey::kMaxLevel - level)));
}

TEST(MortonKey, ContainingFollowsTheDefinitionAtEveryLevel) {
  constexpr std::uint32_t kSeed = 1;
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  RandomKeys random(kSeed);
  for (int level = 0; level <= MortonKey::kMaxLevel; ++level) {
    for (int i = 0; i < 200; ++i) {
      const GridPoint cell = random.cell();
      const MortonKey key = MortonKey::containing(cell, level);
      ASSERT_EQ(key.bits(), key_by_definition(cell, level).bits());
      ASSERT_TRUE(key.is_valid());
      ASSERT_EQ(key.level(), level);
      ASSERT_EQ(key.grid_side(), kGridSide >> level);
      const std::uint32_t mask = ~(key.grid_side() - 1);
      ASSERT_EQ(key.grid_min(), (GridPoint{cell.x & mask, cell.y & mask, cell.z & mask}));
    }
  }
}

TEST(MortonKey, ChildrenKnowTheirParentOctantAndCorner) {
  constexpr std::uint32_t kSeed = 2;
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  RandomKeys random(kSeed);
  for (int i = 0; i < 10000; ++i) {
    const MortonKey key = random.key(random.below(MortonKey::kMaxLevel));
    const GridPoint low = key.grid_min();
    for (unsigned octant = 0; octant < 8; ++octant) {
      const MortonKey child = key.child(static_cast<int>(octant));
      ASSERT_TRUE(child.is_valid());
      ASSERT_EQ(child.level(), key.level() + 1);
      ASSERT_EQ(child.parent(), key);
      ASSERT_EQ(child.octant(), static_cast<int>(octant));
      const std::uint32_t half = key.grid_side() / 2;
      ASSERT_EQ(child.grid_min(),
                (GridPoint{low.x + (octant & 1) * half, low.y + (octant >> 1 & 1) * half,
                           low.z + (octant >> 2) * half}));
    }
  }
}

TEST(MortonKey, ChildrenPartitionTheRangeWithTheParentInTheMiddle) {
  constexpr std::uint32_t kSeed = 3;
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  RandomKeys random(kSeed);
  for (int i = 0; i < 10000; ++i) {
    const MortonKey key = random.key(random.below(MortonKey::kMaxLevel));
    ASSERT_EQ(key.child(0).range_min(), key.range_min());
    ASSERT_EQ(key.child(7).range_max(), key.range_max());
    for (int octant = 0; octant < 7; ++octant)
      ASSERT_EQ(key.child(octant).range_max().bits() + 2, key.child(octant + 1).range_min().bits());
    ASSERT_LT(key.child(3).range_max(), key);
    ASSERT_LT(key, key.child(4).range_min());
    ASSERT_EQ(key.range_min().level(), MortonKey::kMaxLevel);
    ASSERT_EQ(key.range_max().level(), MortonKey::kMaxLevel);
  }
}

TEST(MortonKey, AncestorsAreTheNodesOnTheWayToTheRoot) {
  constexpr std::uint32_t kSeed = 4;
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  RandomKeys random(kSeed);
  for (int i = 0; i < 5000; ++i) {
    const MortonKey key = random.key(), other = random.key();
    bool is_on_the_way = key == other;
    for (MortonKey up = other; !is_on_the_way && up.level() > 0;)
      is_on_the_way = (up = up.parent()) == key;
    ASSERT_EQ(key.is_ancestor_or_self_of(other), is_on_the_way);
    for (MortonKey up = key; up.level() > 0; up = up.parent()) {
      ASSERT_TRUE(up.parent().is_ancestor_or_self_of(key));
      ASSERT_FALSE(key.is_ancestor_or_self_of(up.parent()));
    }
  }
}

TEST(MortonKey, OrderOfOneLevelIsTheZCurve) {
  const MortonKey node = MortonKey::root().child(6).child(1);
  const std::array<GridPoint, 8> steps = {
      {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}, {0, 0, 1}, {1, 0, 1}, {0, 1, 1}, {1, 1, 1}}};
  const GridPoint low = node.grid_min();
  const std::uint32_t half = node.grid_side() / 2;
  MortonKey previous = MortonKey::root().range_min();
  for (const GridPoint& step : steps) {
    const MortonKey key = MortonKey::containing(
        {low.x + half * step.x, low.y + half * step.y, low.z + half * step.z}, node.level() + 1);
    EXPECT_EQ(key.parent(), node);
    EXPECT_LT(previous, key);
    previous = key;
  }
}

TEST(MortonKey, OnlyMarkersOnTheThirdBitsAreValid) {
  for (int bit = 0; bit < 64; ++bit)
    EXPECT_EQ(MortonKey::from_bits(std::uint64_t{1} << bit).is_valid(), bit % 3 == 0) << bit;
}

}  // namespace
}  // namespace locvol
