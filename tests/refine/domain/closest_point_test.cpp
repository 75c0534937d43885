#include "refine/domain/closest_point.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "refine/predicates.h"
#include "tests/refine/shapes.h"

namespace locvol {
namespace {

TEST(ClosestPoint, IsOnTheFaceAnEdgeOrACorner) {
  const std::array<Point, 3> corners{Point{0, 0, 1}, Point{4, 0, 1}, Point{0, 4, 1}};
  EXPECT_EQ(closest_on_triangle(corners, {1, 1, 7}), (Point{1, 1, 1}));
  EXPECT_EQ(closest_on_triangle(corners, {1, 1, -7}), (Point{1, 1, 1}));
  EXPECT_EQ(closest_on_triangle(corners, {3, -5, 2}), (Point{3, 0, 1}));
  EXPECT_EQ(closest_on_triangle(corners, {3, 3, 2}), (Point{2, 2, 1}));
  EXPECT_EQ(closest_on_triangle(corners, {9, -1, 0}), (Point{4, 0, 1}));
}

TEST(ClosestPoint, OfFlatTrianglesIsThatOfTheirEdges) {
  const Point a{0, 0, 0}, b{1, 0, 0}, c{3, 0, 0};
  EXPECT_EQ(closest_on_triangle({a, b, c}, {2, 1, 1}), (Point{2, 0, 0}));
  EXPECT_EQ(closest_on_triangle({c, a, b}, {5, 1, 1}), c);
  EXPECT_EQ(closest_on_triangle({b, b, b}, {5, 1, 1}), b);
}

// No point of the triangle is closer, and it lies on the triangle: its areas with the corners add
// up. Needles as well.
TEST(ClosestPoint, NoneIsCloser) {
  constexpr unsigned kSeed = 5;
  shapes::Random random(kSeed);
  const Box space{{-1, -1, -1}, {1, 1, 1}};
  const auto area = [](const Point& p, const Point& q, const Point& r) {
    return norm(cross(q - p, r - p));
  };
  for (int n = 0; n < 2000; ++n) {
    const Point a = shapes::uniform_in(random, space), q = shapes::uniform_in(random, space),
                b = shapes::uniform_in(random, space),
                c = n % 2 == 0 ? shapes::uniform_in(random, space)
                               : b + 1e-6 * shapes::uniform_in(random, space);
    const Point closest = closest_on_triangle({a, b, c}, q);
    EXPECT_NEAR(area(closest, a, b) + area(closest, b, c) + area(closest, c, a), area(a, b, c),
                1e-12)
        << "seed " << kSeed << ", case " << n;
    for (int k = 0; k < 50; ++k) {
      double u = shapes::uniform(random, 0, 1), v = shapes::uniform(random, 0, 1);
      if (k % 5 == 0) v = 0;
      if (u + v > 1) u = 1 - u, v = 1 - v;
      EXPECT_LE(norm(closest - q), norm(a + u * (b - a) + v * (c - a) - q) + 1e-12)
          << "seed " << kSeed << ", case " << n;
    }
  }
}

// The audit's exact distances, of needles as well.
TEST(ClosestPoint, IsAsFarAsExactArithmeticSays) {
  constexpr unsigned kSeed = 7;
  shapes::Random random(kSeed);
  const Box space{{-1, -1, -1}, {1, 1, 1}};
  for (int n = 0; n < 500; ++n) {
    const Point a = shapes::uniform_in(random, space), q = shapes::uniform_in(random, space),
                b = shapes::uniform_in(random, space);
    const double height = n % 2 == 0 ? 1 : 1e-4;
    const Triangle triangle{0, {a, b, 0.5 * (a + b) + height * shapes::uniform_in(random, space)}};
    EXPECT_NEAR(std::sqrt(squared_distance(triangle, q)), exact_distance_to_triangle(q, triangle),
                1e-10)
        << "seed " << kSeed << ", case " << n;
  }
}

}  // namespace
}  // namespace locvol
