// Dihedral angles of cells, by their cosines, and edges. Internal to refine/.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>

#include "octree/geometry.h"

namespace locvol {

inline constexpr double kDegree = std::numbers::pi / 180;  // in radians

// The largest cosine of the cell's six dihedral angles: that of the smallest angle. 1 for a cell
// without volume.
inline double largest_cosine(const std::array<Point, 4>& cell) {
  const Point a = cell[1] - cell[0], b = cell[2] - cell[0], c = cell[3] - cell[0];
  // Normals of the facets opposite the corners, all outwards or all inwards, as long as twice the
  // facet's area.
  const Point nb = cross(b, c), nc = cross(c, a), nd = cross(a, b);
  const Point na = -1.0 * (nb + nc + nd);
  const double aa = dot(na, na), bb = dot(nb, nb), cc = dot(nc, nc), dd = dot(nd, nd);
  if (!(std::min(std::min(aa, bb), std::min(cc, dd)) > 0)) return 1;
  const double ia = 1 / std::sqrt(aa), ib = 1 / std::sqrt(bb), ic = 1 / std::sqrt(cc),
               id = 1 / std::sqrt(dd);
  const double ab = dot(na, nb) * ia * ib, ac = dot(na, nc) * ia * ic, ad = dot(na, nd) * ia * id;
  const double bc = dot(nb, nc) * ib * ic, bd = dot(nb, nd) * ib * id, cd = dot(nc, nd) * ic * id;
  return -std::min(std::min(std::min(ab, ac), std::min(ad, bc)), std::min(bd, cd));
}

// The largest cosine of a triangle's angles.
inline double largest_cosine(const std::array<Point, 3>& triangle) {
  double largest = -1;
  for (std::size_t i = 0; i < 3; ++i) {
    const Point a = triangle[(i + 1) % 3] - triangle[i], b = triangle[(i + 2) % 3] - triangle[i];
    const double lengths = std::sqrt(dot(a, a) * dot(b, b));
    if (!(lengths > 0)) return 1;
    largest = std::max(largest, dot(a, b) / lengths);
  }
  return largest;
}

inline double shortest_edge_squared(const std::array<Point, 4>& cell) {
  double shortest = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < 4; ++i)
    for (std::size_t j = i + 1; j < 4; ++j)
      shortest = std::min(shortest, squared_distance(cell[i], cell[j]));
  return shortest;
}

// Of a cell with all corners on the surface, that leads from side to side of a part: the width of
// this over its longest edge; else infinite. `normals`: unit ones of the surface at the corners, 0
// on a crease.
inline double relative_width(const std::array<Point, 4>& cell,
                             const std::array<Point, 4>& normals) {
  double width = std::numeric_limits<double>::infinity(), longest = 0;
  for (std::size_t i = 0; i < 4; ++i)
    for (std::size_t j = 0; j < 4; ++j) {
      longest = std::max(longest, squared_distance(cell[i], cell[j]));
      if (dot(normals[i], normals[j]) < 0)
        width = std::min(width, std::abs(dot(normals[i], cell[j] - cell[i])));
    }
  return width / std::sqrt(longest);
}

// Below that part of the tangent of a bound on angles a wall's relative width is too little for
// it: a triangle of unit sides is seen under the bound from a place above a corner of it that is
// 0.87 times the tangent away, from one above its middle at a third of that.
inline constexpr double kThinWall = 0.5;

}  // namespace locvol
