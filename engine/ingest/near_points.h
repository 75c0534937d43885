// Finds points that lie so close to each other that they may be meant as one.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "octree/geometry.h"

namespace locvol {

// Points that hang together by steps shorter than some distance.
struct PointGroup {
  std::uint32_t first = 0;  // the smallest of them, by its place in the list
  std::uint32_t count = 0;
  Box box;

  double width() const;  // of the box, from corner to corner
};

struct PointGroups {
  std::vector<PointGroup> groups;       // in the order of their first points
  std::vector<std::uint32_t> of_point;  // by point, the place of its group
};

// All groups, however wide. Distances are those of distance_between().
// REQUIRES: points are ascending, and all different; the distance is above 1e-240
// Memory: 60 bytes a point. Time: a logarithm for each point.
PointGroups near_groups(std::span<const Point> points, double distance);

// The distance, right for any two points that double arithmetic can tell apart.
double distance_between(const Point& p, const Point& q);

// A cube of a grid whose lines lie at multiples of its side, a power of two: so that the cube of a
// point is found without rounding.
using GridCube = std::array<double, 3>;
double grid_side_up_to(double length);  // the largest power of two that is no longer
GridCube cube_of(const Point& p, double side);

}  // namespace locvol
