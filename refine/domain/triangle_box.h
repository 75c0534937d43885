// Does a triangle meet a box?
#pragma once

#include <algorithm>

#include "octree/crease.h"
#include "octree/geometry.h"

namespace locvol {

// Do the closed triangle, which may be flat, and the closed box have a point in common? So the
// cells of any subdivision of a box have among them just the triangles that meet the box. Exact.
bool touches(const Triangle& triangle, const Box& box);
// Likewise the edge.
bool touches(const CreaseEdge& edge, const Box& box);

// The same in a hundredth of the time. It may say true for one that misses the box by little, never
// false for one that meets it.
bool meets(const Triangle& triangle, const Box& box);

// Its half: is the box's center farther from the triangle's plane than its corners reach? `slack`:
// of all coordinates
bool plane_misses(const Triangle& triangle, const Box& box, double slack);

// Of coordinates up to this: far above rounding errors.
inline double slack_at(double largest_coordinate) { return 1e-13 * largest_coordinate; }
inline double largest_coordinate(const Box& b) {
  return std::max(max_norm(b.min), max_norm(b.max));
}

}  // namespace locvol
