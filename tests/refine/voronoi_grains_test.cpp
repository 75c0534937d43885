#include "refine/grains/voronoi_grains.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <random>
#include <vector>

namespace locvol {
namespace {

Point random_point(std::mt19937_64& random) {
  Point p;
  for (int axis = 0; axis < 3; ++axis)
    p[axis] = std::ldexp(static_cast<double>(random() >> 23 | 1), -40) - 1;  // below 2^41
  return p;
}

Point center_of(const Grains& grains, const GrainFace& face) {
  Point sum;
  for (const std::uint32_t v : face.vertices) sum = sum + grains.vertices[v];
  return (1 / static_cast<double>(face.vertices.size())) * sum;
}

// From the first grain to the second.
Point normal_of(const Grains& grains, const GrainFace& face) {
  const auto at = [&](std::size_t i) { return grains.vertices[face.vertices[i]]; };
  Point area;
  for (std::size_t i = 1; i + 1 < face.vertices.size(); ++i)
    area = area + cross(at(i) - at(0), at(i + 1) - at(0));
  return (1 / norm(area)) * area;
}

// A place lies behind all faces of the grain whose seed is the closest, and of no other.
TEST(VoronoiGrains, EachHasWhatIsClosestToItsSeed) {
  std::mt19937_64 random(1);
  for (const std::size_t num : {1, 2, 3, 7, 60}) {
    std::vector<Point> seeds;
    while (seeds.size() < num) seeds.push_back(random_point(random));
    const Grains grains = voronoi_grains(seeds);
    for (int trial = 0; trial < 200; ++trial) {
      const Point p = random_point(random);
      std::vector<bool> is_in(num, true);
      for (const GrainFace& face : grains.faces) {
        const bool is_behind = dot(normal_of(grains, face), p - center_of(grains, face)) < 0;
        const std::uint32_t other = face.grains[is_behind ? 1 : 0];  // p is on the other side
        if (other != kNoGrain) is_in[other] = false;
      }
      std::size_t closest = 0;
      for (std::size_t g = 1; g < num; ++g)
        if (squared_distance(seeds[g], p) < squared_distance(seeds[closest], p)) closest = g;
      for (std::size_t g = 0; g < num; ++g) EXPECT_EQ(is_in[g], g == closest);
    }
  }
}

// Where more than four grains meet in a point, it is one vertex.
TEST(VoronoiGrains, OfAGridAreCubes) {
  std::vector<Point> seeds;
  for (int k = 0; k < 27; ++k)
    seeds.push_back({0.5 * (k % 3 - 1), 0.5 * (k / 3 % 3 - 1), 0.5 * (k / 9 - 1)});
  const Grains grains = voronoi_grains(seeds);
  EXPECT_EQ(grains.vertices.size(), 64U);
  EXPECT_EQ(grains.faces.size(), 108U);
  for (const GrainFace& face : grains.faces) EXPECT_EQ(face.vertices.size(), 4U);
}

TEST(VoronoiGrains, OfEqualSeedsAreRefused) {
  EXPECT_THROW(voronoi_grains(std::vector<Point>{{0.5, 0.5, 0.5}, {0.5, 0.5, 0.5}}), GrainError);
}

}  // namespace
}  // namespace locvol
