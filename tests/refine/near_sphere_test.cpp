#include "refine/near_sphere.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <utility>

#include "tests/refine/brute_force.h"
#include "tests/refine/shapes.h"

namespace locvol {
namespace {

using shapes::Random;
using shapes::uniform;

struct Question {
  std::array<Point, 4> cell;  // positively oriented
  Point p;
};

Question oriented(const std::array<Point, 5>& points) {
  Question question{{points[0], points[1], points[2], points[3]}, points[4]};
  auto& [a, b, c, d] = question.cell;
  if (brute_force::orientation(a, b, c, d) < 0) std::swap(a, b);
  return question;
}

// All on a plane at an angle, but for rounding.
Question coplanar(Random& random) {
  const Point origin = 20 * shapes::uniform_in(random, shapes::kCube);
  const Point u = 0.1 * shapes::uniform_in(random, shapes::kCube);
  const Point v = 0.1 * shapes::uniform_in(random, shapes::kCube);
  std::array<Point, 5> points;
  for (Point& p : points) p = origin + uniform(random, -1, 1) * u + uniform(random, -1, 1) * v;
  return oriented(points);
}

// All on a sphere, but for rounding.
Question cospherical(Random& random) {
  const Point center = 20 * shapes::uniform_in(random, shapes::kCube);
  std::array<Point, 5> points;
  for (Point& p : points) {
    const Point way = shapes::uniform_in(random, shapes::kCube);
    p = center + (0.1 / norm(way)) * way;
  }
  return oriented(points);
}

// Four on a sphere, where cells are long or flat; the fifth is off it by 10⁻¹⁶ to 10⁻⁸ of its size,
// where doubles begin to tell.
Question off_sphere(Random& random) {
  const Point center = 20 * shapes::uniform_in(random, shapes::kCube);
  Point shape;
  for (int axis = 0; axis < 3; ++axis) shape[axis] = std::pow(10, uniform(random, -3, 0));
  std::array<Point, 5> points;
  for (Point& p : points) {
    Point way = shapes::uniform_in(random, shapes::kCube);
    for (int axis = 0; axis < 3; ++axis) way[axis] *= shape[axis];
    p = center + (0.1 / norm(way)) * way;
  }
  const double off = std::pow(10, uniform(random, -16, -8));
  points[4] = points[4] + (random() % 2 == 0 ? off : -off) * (points[4] - center);
  return oriented(points);
}

TEST(NearSphere, IsRightWhereItIsCertain) {
  constexpr unsigned kSeed = 81;
  Random random(kSeed);
  int num_certain = 0, num_inside = 0;
  constexpr int kNum = 30000;
  for (int n = 0; n < kNum; ++n) {
    const auto& [cell, p] = n % 3 == 0   ? coplanar(random)
                            : n % 3 == 1 ? cospherical(random)
                                         : off_sphere(random);
    if (brute_force::orientation(cell[0], cell[1], cell[2], cell[3]) == 0) continue;
    const auto is_inside = is_in_near_sphere(cell, p);
    if (!is_inside) continue;
    ++num_certain;
    num_inside += *is_inside;
    const int side = brute_force::side_of_sphere(cell, p);
    ASSERT_NE(side, 0) << "seed " << kSeed << ", n " << n;
    ASSERT_EQ(*is_inside, side > 0) << "seed " << kSeed << ", n " << n;
  }
  EXPECT_GT(num_certain, 0.99 * kNum);
  EXPECT_GT(num_inside, 0.2 * kNum);
  EXPECT_LT(num_inside, 0.8 * kNum);
}

TEST(NearSphere, IsNotCertainOfPointsOnIt) {
  const std::array<Point, 4> corner{Point{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  EXPECT_EQ(is_in_near_sphere(corner, {1, 1, 1}), std::nullopt);
  EXPECT_EQ(is_in_near_sphere(corner, {1, 1, 1 + 0x1p-52}), false);
  EXPECT_EQ(is_in_near_sphere(corner, {1, 1, 1 - 0x1p-53}), true);
}

TEST(NearSphere, IsNotCertainWherePowersUnderflowOrOverflow) {
  for (const double size : {1e-60, 1e60}) {
    const std::array<Point, 4> corner{Point{0, 0, 0}, {size, 0, 0}, {0, size, 0}, {0, 0, size}};
    EXPECT_EQ(is_in_near_sphere(corner, 0.5 * Point{size, size, size}), std::nullopt);
  }
}

}  // namespace
}  // namespace locvol
