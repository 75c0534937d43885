#include "refine/scatter_surface.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/refine/domain_pieces.h"
#include "tests/refine/shapes.h"

namespace locvol {
namespace {

std::vector<Point> scattered(const shapes::Mesh& mesh, std::uint64_t seed) {
  const LeafDomain domain(whole_piece(shapes::bounding_box(mesh).expanded(1), mesh));
  return scatter_on_surface(domain, seed);
}

double distance_to_plane(const Point& p, const Triangle& t) {
  const Point n = cross(t.corners[1] - t.corners[0], t.corners[2] - t.corners[0]);
  return std::abs(dot(p - t.corners[0], n)) / norm(n);
}

TEST(ScatterOnSurface, GivesEachComponentItsShare) {
  const auto one = shapes::icosphere({0, 0, 0}, 1, 2);
  EXPECT_EQ(scattered(one, 1).size(), 42U);
  const auto three = shapes::together(one, shapes::together(shapes::icosphere({5, 0, 0}, 1, 2),
                                                            shapes::icosphere({0, 9, 0}, 1, 2)));
  const auto points = scattered(three, 1);
  EXPECT_EQ(points.size(), 3U * 22);
  EXPECT_EQ(std::ranges::count_if(points, [](const Point& p) { return p.x > 3; }), 22);
  EXPECT_EQ(std::ranges::count_if(points, [](const Point& p) { return p.y > 3; }), 22);
}

TEST(ScatterOnSurface, LiesOnTrianglesAndDependsOnTheSeedAlone) {
  const auto torus = shapes::torus(1, 0.4, 20, 10);
  const auto points = scattered(torus, 7);
  for (const Point& p : points)
    EXPECT_TRUE(std::ranges::any_of(
        torus, [&](const Triangle& t) { return distance_to_plane(p, t) < 1e-14; }));
  EXPECT_EQ(points, scattered(torus, 7));
  EXPECT_NE(points, scattered(torus, 8));
}

TEST(ScatterOnSurface, IsUniformByArea) {
  // A box twice as long as wide: by area, 1 of 10 points lies on each small end.
  const auto box = shapes::box({{0, 0, 0}, {1, 1, 2}});
  int num_on_ends = 0, num_points = 0;
  for (std::uint64_t seed = 0; seed < 200; ++seed)
    for (const Point& p : scattered(box, seed)) {
      num_on_ends += p.z == 0 || p.z == 2;
      ++num_points;
    }
  EXPECT_NEAR(num_on_ends, 0.2 * num_points, 5 * std::sqrt(0.16 * num_points));
}

}  // namespace
}  // namespace locvol
