#include "engine/run/first_points.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/engine/closed_shapes.h"

namespace locvol {
namespace {

using namespace testing_shapes;

double distance_to_plane(const Point& p, const Triangle& t) {
  const Point n = cross(t.corners[1] - t.corners[0], t.corners[2] - t.corners[0]);
  return std::abs(dot(p - t.corners[0], n)) / norm(n);
}

TEST(ScatterOnSurface, GivesEachComponentItsShare) {
  const auto one = sphere(1, 9, 16).soup();
  EXPECT_EQ(scatter_on_surface(one, 1).size(), 42U);
  const auto three = together(sphere(1, 9, 16), together(translated(sphere(1, 9, 16), {5, 0, 0}),
                                                         translated(sphere(1, 9, 16), {0, 9, 0})))
                         .soup();
  const auto points = scatter_on_surface(three, 1);
  EXPECT_EQ(points.size(), 3U * 22);
  EXPECT_EQ(std::ranges::count_if(points, [](const Point& p) { return p.x > 3; }), 22);
  EXPECT_EQ(std::ranges::count_if(points, [](const Point& p) { return p.y > 3; }), 22);
}

TEST(ScatterOnSurface, LiesOnTrianglesAndDependsOnTheSeedAlone) {
  const auto soup = torus(1, 0.4, 20, 10).soup();
  const auto points = scatter_on_surface(soup, 7);
  for (const Point& p : points)
    EXPECT_TRUE(std::ranges::any_of(
        soup, [&](const Triangle& t) { return distance_to_plane(p, t) < 1e-14; }));
  EXPECT_EQ(points, scatter_on_surface(soup, 7));
  EXPECT_NE(points, scatter_on_surface(soup, 8));
}

TEST(ScatterOnSurface, IsUniformByArea) {
  // A box twice as long as wide: by area, 1 of 10 points lies on each small end.
  Shape box = sphere(1, 1, 4);
  box.vertices = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0},
                  {0, 0, 2}, {1, 0, 2}, {1, 1, 2}, {0, 1, 2}};
  box.triangles = {{0, 2, 1}, {0, 3, 2}, {4, 5, 6}, {4, 6, 7}, {0, 1, 5}, {0, 5, 4},
                   {1, 2, 6}, {1, 6, 5}, {2, 3, 7}, {2, 7, 6}, {3, 0, 4}, {3, 4, 7}};
  int num_on_ends = 0, num_points = 0;
  for (std::uint64_t seed = 0; seed < 200; ++seed)
    for (const Point& p : scatter_on_surface(box.soup(), seed)) {
      num_on_ends += p.z == 0 || p.z == 2;
      ++num_points;
    }
  EXPECT_NEAR(num_on_ends, 0.2 * num_points, 5 * std::sqrt(0.16 * num_points));
}

}  // namespace
}  // namespace locvol
