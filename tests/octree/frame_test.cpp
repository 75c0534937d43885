#include "octree/frame.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <stdexcept>

#include "tests/octree/random_places.h"

namespace locvol {
namespace {

class RandomFrames {
 public:
  explicit RandomFrames(std::uint32_t seed) : random_(seed) {}
  double between(double low, double high) {
    return std::uniform_real_distribution(low, high)(random_);
  }
  std::uint32_t step(std::uint32_t last) {
    return std::uniform_int_distribution<std::uint32_t>(0, last)(random_);
  }
  Box box() {
    const double scale = std::pow(10.0, between(-6, 6));
    const double shift = scale * std::pow(10.0, between(-3, 3));
    const Point low = {between(-shift, shift), between(-shift, shift), between(-shift, shift)};
    return {low, low + scale * Point{between(0, 1), between(0, 1), between(0.1, 1)}};
  }

 private:
  std::mt19937 random_;
};

double longest_side(const Box& box) {
  const Point extent = box.max - box.min;
  return std::max({extent.x, extent.y, extent.z});
}

bool has_bits(double v, int num_bits) {
  int exponent = 0;
  const double scaled = std::ldexp(std::frexp(v, &exponent), num_bits);
  return scaled == std::floor(scaled);
}

TEST(Frame, AroundIsTheSmallestThatHoldsTheBoxAndItsMargin) {
  constexpr std::uint32_t kSeed = 11;
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  RandomFrames random(kSeed);
  for (int i = 0; i < 2000; ++i) {
    const Box box = random.box();
    const double longest = longest_side(box);
    const double margin = longest * random.between(0.001, 0.5);
    const double leaf_side = longest * std::pow(2.0, random.between(-12, 1));
    const Frame frame = Frame::around(box, margin, leaf_side);
    const Box root = frame.root_box();
    ASSERT_TRUE(root.contains(box.expanded(margin).min));
    ASSERT_TRUE(root.contains(box.expanded(margin).max));
    ASSERT_TRUE(frame.contains(box.max));
    ASSERT_TRUE(has_bits(frame.unit(), 20));
    for (int axis = 0; axis < 3; ++axis) {
      const double steps = frame.origin()[axis] / frame.unit();
      ASSERT_EQ(steps, std::floor(steps));
      ASSERT_NEAR(root.center()[axis], box.center()[axis], 1.001 * frame.unit());
    }
    // Some level has leaves of the side asked for, and one doubling less would not do (but for the
    // step lost in placing the origin).
    const int level = frame.level_of_side(leaf_side);
    ASSERT_GE(frame.side(level), leaf_side);
    ASSERT_LE(frame.side(level), leaf_side * (1 + 4e-6));
    if (level > 0) {
      ASSERT_LT(frame.side(1), (longest + 2 * margin) * (1 + 4e-6));
    }
  }
}

TEST(Frame, UsesTheExactCubeWhenItFits) {
  const Frame frame = Frame::around({{-1, -1, -1}, {1, 0.5, 1}}, 1, 0.125);
  EXPECT_EQ(frame.root_box().min, (Point{-2, -2.25, -2}));
  EXPECT_EQ(frame.side(0), 4);
  EXPECT_EQ(frame.level_of_side(0.125), 5);
}

TEST(Frame, GoesOneLevelUpWhereThePlacingOfTheOriginHasNoRoom) {
  // The far side of the box would have no owner in the cube that just fits.
  const Frame frame = Frame::around({{0, 0, 0}, {1, 1, 1}}, 0, 0.25);
  EXPECT_EQ(frame.side(0), 2);
  EXPECT_TRUE(frame.contains({1, 1, 1}));
}

TEST(Frame, PositionsAreExactAndIncreasing) {
  constexpr std::uint32_t kSeed = 12;
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  RandomFrames random(kSeed);
  for (int i = 0; i < 2000; ++i) {
    const Box box = random.box();
    const Frame frame = Frame::around(box, longest_side(box) / 10, longest_side(box) / 100);
    const std::uint32_t a = random.step(kGridSide), b = random.step(kGridSide);
    // Exact: the difference of two positions is a whole number of units.
    ASSERT_EQ(frame.position({a, 0, 0}).x - frame.position({b, 0, 0}).x,
              (static_cast<double>(a) - static_cast<double>(b)) * frame.unit());
    ASSERT_EQ(frame.position({a, 0, 0}).x < frame.position({b, 0, 0}).x, a < b);
  }
}

TEST(Frame, OwnershipIsHalfOpenAtEveryLevel) {
  constexpr std::uint32_t kSeed = 13;
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  RandomFrames random(kSeed);
  const double infinity = std::numeric_limits<double>::infinity();
  for (int i = 0; i < 2000; ++i) {
    const Box box = random.box();
    const Frame frame = Frame::around(box, longest_side(box) / 10, longest_side(box) / 100);
    const GridPoint g = {random.step(kGridSide - 1), random.step(kGridSide - 1),
                         random.step(kGridSide - 1)};
    const Point corner = frame.position(g);
    const Point root_min = frame.root_box().min;
    Point just_below;
    for (int axis = 0; axis < 3; ++axis)
      just_below[axis] = std::max(std::nextafter(corner[axis], -infinity), root_min[axis]);
    const Point inside = {random.between(box.min.x, box.max.x),
                          random.between(box.min.y, box.max.y),
                          random.between(box.min.z, box.max.z)};
    for (const Point& p : {corner, just_below, inside}) {
      for (int level = 0; level <= MortonKey::kMaxLevel; ++level) {
        const Box owner = frame.box(frame.key_of(p, level));
        for (int axis = 0; axis < 3; ++axis) {
          ASSERT_LE(owner.min[axis], p[axis]);
          ASSERT_LT(p[axis], owner.max[axis]);
        }
      }
      ASSERT_EQ(frame.key_of(p, 7), MortonKey::containing(frame.key_of(p).grid_min(), 7));
    }
    ASSERT_EQ(frame.key_of(corner), MortonKey::containing(g, MortonKey::kMaxLevel));
  }
}

TEST(Frame, ContainsExactlyTheHalfOpenRoot) {
  const Frame frame({-1, 2, 3}, 0x1p-20);
  EXPECT_TRUE(frame.contains({-1, 2, 3}));
  EXPECT_TRUE(frame.contains({std::nextafter(1.0, 0), 3.5, 4}));
  EXPECT_FALSE(frame.contains({1, 3, 4}));
  EXPECT_FALSE(frame.contains({0, 4, 4}));
  EXPECT_FALSE(frame.contains({0, 3, 5}));
  EXPECT_FALSE(frame.contains({std::nextafter(-1.0, -2), 3, 4}));
  EXPECT_FALSE(frame.contains({std::numeric_limits<double>::quiet_NaN(), 3, 4}));
}

TEST(Frame, BoxesOfChildrenShareTheCornersOfTheirParent) {
  const Frame frame = Frame::around({{0.1, 0.2, 0.3}, {1.3, 0.7, 0.9}}, 0.07, 0.013);
  MortonKey key = MortonKey::root();
  for (int level = 0; level < MortonKey::kMaxLevel; ++level) {
    const Box box = frame.box(key);
    EXPECT_EQ(frame.box(key.child(0)).min, box.min);
    EXPECT_EQ(frame.box(key.child(7)).max, box.max);
    EXPECT_EQ(frame.box(key.child(0)).max, frame.box(key.child(7)).min);
    key = key.child((5 * level + 3) % 8);
  }
}

TEST(Frame, LevelOfSideIsTheDeepestThatIsLargeEnough) {
  const Frame frame({0, 0, 0}, 0x1p-21);  // a root of side 1
  EXPECT_EQ(frame.level_of_side(2), 0);   // none is large enough
  EXPECT_EQ(frame.level_of_side(1), 0);
  EXPECT_EQ(frame.level_of_side(0.51), 0);
  EXPECT_EQ(frame.level_of_side(0.5), 1);
  EXPECT_EQ(frame.level_of_side(0x1p-21), 21);
  EXPECT_EQ(frame.level_of_side(1e-30), 21);
}

TEST(Frame, RefusesWhatItCannotDo) {
  const Box box = {{0, 0, 0}, {1, 1, 1}};
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(Frame::around({{0, 0, 0}, {-1, 1, 1}}, 0, 1), std::invalid_argument);
  EXPECT_THROW(Frame::around({{0, 0, nan}, {1, 1, 1}}, 0, 1), std::invalid_argument);
  EXPECT_THROW(Frame::around({{-1e308, 0, 0}, {1e308, 1, 1}}, 0, 1e308), std::invalid_argument);
  EXPECT_THROW(Frame::around(box, -1, 1), std::invalid_argument);
  EXPECT_THROW(Frame::around(box, nan, 1), std::invalid_argument);
  EXPECT_THROW(Frame::around(box, 0, 0), std::invalid_argument);
  EXPECT_THROW(Frame::around(box, 0, nan), std::invalid_argument);
  EXPECT_THROW(Frame::around(box, 0, 1e-320), std::invalid_argument);
  EXPECT_THROW(Frame::around(box, 0, 0x1p-22), std::invalid_argument);  // too many levels
  EXPECT_NO_THROW(Frame::around(box, 0, 0x1.1p-21));
  const Point far = {1e15, 0, 0};  // where neighboring doubles are 1/8 apart
  EXPECT_THROW(Frame::around({far, far + Point{1, 1, 1}}, 0.1, 1e-3), std::invalid_argument);
}

}  // namespace
}  // namespace locvol
