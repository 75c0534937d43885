// Points that are nearly one.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <span>
#include <utility>
#include <vector>

#include "octree/disjoint_sets.h"
#include "octree/geometry.h"

namespace locvol {

// visit(i, j) for places i < j of points that are closer than the distance. REQUIRES: coordinates
// are below 1e17 times the distance
template <class Visit>
void for_each_near(std::span<const Point> points, double distance, const Visit& visit) {
  // Each with those in the 27 cubes around it, as wide as the distance.
  using Cube = std::array<std::int64_t, 3>;
  std::vector<std::pair<Cube, std::uint32_t>> cubes;
  cubes.reserve(points.size());
  for (std::uint32_t i = 0; i < points.size(); ++i) {
    const Point d = (1 / distance) * (points[i] - points[0]);
    cubes.push_back({{std::llround(std::floor(d.x)), std::llround(std::floor(d.y)),
                      std::llround(std::floor(d.z))},
                     i});
  }
  std::ranges::sort(cubes);
  for (const auto& [cube, i] : cubes)
    for (std::int64_t dx = -1; dx <= 1; ++dx)
      for (std::int64_t dy = -1; dy <= 1; ++dy) {
        // Cubes that differ in z alone follow each other.
        const Cube low = {cube[0] + dx, cube[1] + dy, cube[2] - 1};
        for (auto it = std::ranges::lower_bound(cubes, std::pair(low, std::uint32_t{0}));
             it != cubes.end() && it->first[0] == low[0] && it->first[1] == low[1] &&
             it->first[2] <= cube[2] + 1;
             ++it)
          if (it->second < i && norm(points[it->second] - points[i]) < distance)
            visit(it->second, i);
      }
}

// Unites these places. The same is required.
inline void unite_near(std::span<const Point> points, double distance, DisjointSets& sets) {
  for_each_near(points, distance, [&](std::uint32_t i, std::uint32_t j) { sets.unite(i, j); });
}

// What each vertex becomes where those of `some` that are closer than the distance, and
// may_join(u, v), become one, also by way of others: the lexicographically smallest of them. The
// same is required.
template <class MayJoin>
std::vector<std::uint32_t> joined_near(std::span<const Point> vertices,
                                       std::vector<std::uint32_t> some, double distance,
                                       const MayJoin& may_join) {
  std::vector<std::uint32_t> becomes(vertices.size());
  std::iota(becomes.begin(), becomes.end(), 0U);
  if (some.empty()) return becomes;
  std::ranges::sort(some, {}, [&](std::uint32_t v) { return vertices[v]; });
  DisjointSets groups(some.size());
  std::vector<Point> points;
  for (const std::uint32_t v : some) points.push_back(vertices[v]);
  for_each_near(points, distance, [&](std::uint32_t i, std::uint32_t j) {
    if (may_join(some[i], some[j])) groups.unite(i, j);
  });
  for (std::uint32_t i = 0; i < some.size(); ++i) becomes[some[i]] = some[groups.find(i)];
  return becomes;
}

}  // namespace locvol
