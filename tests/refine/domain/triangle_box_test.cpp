#include "refine/domain/triangle_box.h"

#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <random>
#include <vector>

#include "tests/integer_vector.h"

namespace locvol {
namespace {

using namespace integer_vectors;

// The separating axis theorem in integers: all thirteen axes, both ways.
bool touch(const std::array<Vector, 3>& triangle, const Vector& low, const Vector& high) {
  std::vector<Vector> axes{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  axes.push_back(cross(triangle[1] - triangle[0], triangle[2] - triangle[0]));
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t k = 0; k < 3; ++k)
      axes.push_back(cross(axes[i], triangle[(k + 1) % 3] - triangle[k]));
  for (const Vector& axis : axes) {
    std::int64_t min = INT64_MAX, max = INT64_MIN, box_min = INT64_MAX, box_max = INT64_MIN;
    for (const Vector& p : triangle) {
      min = std::min(min, dot(axis, p));
      max = std::max(max, dot(axis, p));
    }
    for (int k = 0; k < 8; ++k) {
      const Vector p{(k & 1 ? high : low)[0], (k & 2 ? high : low)[1], (k & 4 ? high : low)[2]};
      box_min = std::min(box_min, dot(axis, p));
      box_max = std::max(box_max, dot(axis, p));
    }
    if (max < box_min || box_max < min) return false;
  }
  return true;
}

Point scaled(const Vector& v, double factor, const Point& by) {
  return {factor * static_cast<double>(v[0]) + by.x, factor * static_cast<double>(v[1]) + by.y,
          factor * static_cast<double>(v[2]) + by.z};
}

TEST(TriangleBox, AgreesWithIntegersOnGridsFullOfTies) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  std::mt19937 random(seed);
  int num_touching = 0;
  constexpr int kRounds = 100000;
  for (int round = 0; round < kRounds; ++round) {
    const unsigned extent = 4 + static_cast<unsigned>(round % 13);
    const auto coordinate = [&] { return static_cast<std::int64_t>(random() % extent); };
    std::array<Vector, 3> triangle;  // flat ones among them
    for (Vector& p : triangle) p = {coordinate(), coordinate(), coordinate()};
    Vector low{coordinate(), coordinate(), coordinate()}, high = low;
    for (auto& c : high) c += 1 + static_cast<std::int64_t>(random() % 4);
    const bool expected = touch(triangle, low, high);
    num_touching += expected;
    // Powers of two and small sums keep the doubles exact, also far from the origin.
    for (const auto& [factor, by] :
         {std::pair(1.0, Point{}), std::pair(0x1p-40, Point{}), std::pair(1.0, Point{0x1p40, 0, 3}),
          std::pair(0x1p60, Point{})}) {
      const Triangle t{0,
                       {scaled(triangle[0], factor, by), scaled(triangle[1], factor, by),
                        scaled(triangle[2], factor, by)}};
      ASSERT_EQ(touches(t, {scaled(low, factor, by), scaled(high, factor, by)}), expected)
          << "round " << round;
    }
  }
  EXPECT_GT(num_touching, kRounds / 10);
  EXPECT_LT(num_touching, kRounds * 9 / 10);
}

TEST(TriangleBox, SomeEighthOfABoxHasWhatTheBoxHas) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> anywhere(-1.5, 1.5);
  const Box box{{-1, -1, -1}, {1, 1, 1}};
  for (int round = 0; round < 50000; ++round) {
    Triangle t;
    for (Point& p : t.corners) p = {anywhere(random), anywhere(random), anywhere(random)};
    if (round % 3 == 0) t.corners[2] = 0.5 * (t.corners[0] + t.corners[1]);  // a needle
    bool is_in_some = false;
    for (int k = 0; k < 8; ++k) {
      const Point low{k & 1 ? 0.0 : -1.0, k & 2 ? 0.0 : -1.0, k & 4 ? 0.0 : -1.0};
      is_in_some = is_in_some || touches(t, {low, low + Point{1, 1, 1}});
    }
    ASSERT_EQ(is_in_some, touches(t, box)) << "round " << round;
  }
}

}  // namespace
}  // namespace locvol
