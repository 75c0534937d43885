#include "refine/domain/crossing.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include "refine/domain/exact_predicates.h"
#include "tests/refine/brute_force.h"
#include "tests/refine/shapes.h"

namespace locvol {
namespace {

using shapes::Mesh;
using shapes::Random;
using shapes::uniform;

Point lattice_point(Random& random, int side) {
  std::uniform_int_distribution<int> pick(0, side);
  const int x = pick(random), y = pick(random);
  return {double(x), double(y), double(pick(random))};
}

int num_crossed(const Point& a, const Point& b, const Mesh& mesh) {
  return int(
      std::ranges::count_if(mesh, [&](const Triangle& t) { return segment_crosses(a, b, t); }));
}

// Of a closed surface, beside each of its triangles: an odd number above those that look down.
TEST(RayFromCentroid, LeavesAClosedSurface) {
  std::vector<Mesh> meshes = {shapes::box({{0, 0, 0}, {1, 1, 1}}),
                              shapes::icosphere({0.1, 0.2, 0.3}, 1, 2),
                              shapes::torus(1, 0.3, 9, 7)};
  for (const Mesh& mesh : meshes)
    for (const Triangle& from : mesh) {
      const auto& [a, b, c] = from.corners;
      const auto num_above = std::ranges::count_if(
          mesh, [&](const Triangle& t) { return ray_from_centroid_crosses(from.corners, t); });
      int sign = 0;  // of the first component of its normal that is not 0: up, then along x, y
      for (const int axis : {2, 0, 1})
        if (sign == 0) sign = orientation_along(axis, a, b, c);
      EXPECT_EQ(num_above % 2, sign < 0 ? 1 : 0);
      EXPECT_FALSE(ray_from_centroid_crosses(from.corners, from)) << "it begins there";
    }
}

// A centroid is seldom a point of doubles, and lies exactly in its triangle's plane all the same.
TEST(RayFromCentroid, BeginsOnItsTriangleAndOnWhatLiesThere) {
  constexpr unsigned kSeed = 5;
  Random random(kSeed);
  for (int n = 0; n < 2000; ++n) {
    const std::array<Point, 3> from = {lattice_point(random, 7), lattice_point(random, 7),
                                       lattice_point(random, 7)};
    const double scale = 0.1;  // so that coordinates are rounded
    std::array<Point, 3> corners;
    for (std::size_t k = 0; k < 3; ++k) corners[k] = scale * from[k];
    Triangle turned{0, {corners[2], corners[1], corners[0]}};
    EXPECT_FALSE(ray_from_centroid_crosses(corners, turned));
    // Across it, far above and far below: seen from above, the centroid lies in all of them.
    const Point n_up = cross(corners[1] - corners[0], corners[2] - corners[0]);
    if (std::abs(n_up.z) < 1e-3) continue;
    for (const double z : {-10.0, 10.0}) {
      Triangle moved = turned;
      for (Point& p : moved.corners) p.z += z;
      EXPECT_EQ(ray_from_centroid_crosses(corners, moved), z > 0);
    }
  }
}

TEST(SegmentCrosses, ClosedForms) {
  const Triangle t{0, {Point{0, 0, 0}, {4, 0, 0}, {0, 4, 0}}};
  EXPECT_TRUE(segment_crosses({1, 1, -1}, {1, 1, 1}, t));
  EXPECT_FALSE(segment_crosses({3, 3, -1}, {3, 3, 1}, t)) << "beside it";
  EXPECT_FALSE(segment_crosses({1, 1, 1}, {1, 1, 2}, t)) << "above it";
  EXPECT_FALSE(segment_crosses({1, 1, 1}, {1, 1, 1}, t)) << "a point";
  EXPECT_FALSE(segment_crosses({0, 1, 0}, {3, 1, 0}, t)) << "in its plane";
}

// Moving by (ε, ε², ε³) lifts what lies in z = 0 above it and takes x = 0, y = 0 into the triangle,
// x + y = 4 out of it.
TEST(SegmentCrosses, TouchesAreDecidedByTheMove) {
  const Triangle t{0, {Point{0, 0, 0}, {4, 0, 0}, {0, 4, 0}}};
  EXPECT_TRUE(segment_crosses({1, 1, 0}, {1, 1, -1}, t));
  EXPECT_FALSE(segment_crosses({1, 1, 0}, {1, 1, 1}, t));
  EXPECT_TRUE(segment_crosses({0, 0, -1}, {0, 0, 1}, t));
  EXPECT_TRUE(segment_crosses({0, 2, -1}, {0, 2, 1}, t));
  EXPECT_TRUE(segment_crosses({2, 0, -1}, {2, 0, 1}, t));
  EXPECT_FALSE(segment_crosses({2, 2, -1}, {2, 2, 1}, t));
  EXPECT_FALSE(segment_crosses({4, 0, -1}, {4, 0, 1}, t));
  EXPECT_FALSE(segment_crosses({0, 4, -1}, {0, 4, 1}, t));
}

TEST(SegmentCrosses, TriangleWithoutAreaIsNeverCrossed) {
  const Triangle segment{0, {Point{0, 0, 0}, {1, 1, 1}, {3, 3, 3}}};
  const Triangle point{0, {Point{1, 1, 1}, {1, 1, 1}, {1, 1, 1}}};
  Random random(1);
  for (int n = 0; n < 2000; ++n) {
    const Point a = lattice_point(random, 3), b = lattice_point(random, 3);
    EXPECT_FALSE(segment_crosses(a, b, segment));
    EXPECT_FALSE(segment_crosses(a, b, point));
  }
}

// On a 4×4×4 lattice nearly every choice is degenerate somehow.
TEST(SegmentCrosses, AgreesWithRationalsOnALattice) {
  constexpr unsigned kSeed = 2;
  Random random(kSeed);
  int num_true = 0;
  for (int n = 0; n < 30000; ++n) {
    const Point a = lattice_point(random, 3), b = lattice_point(random, 3);
    const Triangle t{
        0, {lattice_point(random, 3), lattice_point(random, 3), lattice_point(random, 3)}};
    const bool is_crossed = segment_crosses(a, b, t);
    ASSERT_EQ(is_crossed, brute_force::segment_crosses(a, b, t)) << "seed " << kSeed << ", n " << n;
    num_true += is_crossed;
  }
  EXPECT_GT(num_true, 1000);
}

// Points computed to lie on a triangle lie a rounding error beside it.
TEST(SegmentCrosses, AgreesWithRationalsBesideARoundedTriangle) {
  constexpr unsigned kSeed = 3;
  Random random(kSeed);
  const Box cube{{-1, -1, -1}, {1, 1, 1}};
  for (int n = 0; n < 5000; ++n) {
    const Triangle t{0,
                     {shapes::uniform_in(random, cube), shapes::uniform_in(random, cube),
                      shapes::uniform_in(random, cube)}};
    const auto on = shapes::random_points_on({t}, 2, random);
    const double s = uniform(random, 0, 1);
    const Point on_edge = t.corners[0] + s * (t.corners[1] - t.corners[0]);
    const Point free = shapes::uniform_in(random, cube);
    for (const auto& [a, b] : {std::array{on[0], free},
                               {on[0], on[1]},
                               {on_edge, free},
                               {t.corners[2], free},
                               {free, 2.0 * on_edge - free}})
      ASSERT_EQ(segment_crosses(a, b, t), brute_force::segment_crosses(a, b, t))
          << "seed " << kSeed << ", n " << n;
  }
}

TEST(SegmentCrosses, OrderOfCornersAndEndsDoesNotMatter) {
  constexpr unsigned kSeed = 4;
  Random random(kSeed);
  for (int n = 0; n < 3000; ++n) {
    const Point a = lattice_point(random, 4), b = lattice_point(random, 4);
    Triangle t{0, {lattice_point(random, 4), lattice_point(random, 4), lattice_point(random, 4)}};
    const bool is_crossed = segment_crosses(a, b, t);
    std::ranges::sort(t.corners);
    do {
      ASSERT_EQ(segment_crosses(a, b, t), is_crossed) << "seed " << kSeed << ", n " << n;
      ASSERT_EQ(segment_crosses(b, a, t), is_crossed) << "seed " << kSeed << ", n " << n;
    } while (std::ranges::next_permutation(t.corners).found);
  }
}

// A box is left once from its center, whatever feature the way out leads through.
TEST(SegmentCrosses, WayOutOfABoxCrossesOnce) {
  const Mesh box = shapes::box({{-2, -2, -2}, {2, 2, 2}});
  for (int x = -4; x <= 4; ++x)
    for (int y = -4; y <= 4; ++y)
      for (int z = -4; z <= 4; ++z) {
        const bool is_in = std::min({x, y, z}) >= -2 && std::max({x, y, z}) < 2;
        EXPECT_EQ(num_crossed({0, 0, 0}, {double(x), double(y), double(z)}, box), is_in ? 0 : 1)
            << x << ' ' << y << ' ' << z;
      }
}

}  // namespace
}  // namespace locvol
