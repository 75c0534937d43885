// The circumcenter of a cell, the same bits whoever asks. Internal to refine/.
#pragma once

#include <array>
#include <limits>

#include "octree/geometry.h"

namespace locvol {

struct Circumball {
  Point center;
  double squared_radius = 0;  // infinity for a flat cell
};

// A function of the set of vertices alone: they are put into lexicographic order first. The center
// is rounded from a value with an error of at most some 10⁻¹¹ of the cell's size: doubles decide
// for well-shaped cells, quadruple precision for flat ones, rationals for those nearly degenerate.
// If the radius exceeds `most`, the squared radius may be infinite, and the center anywhere: such
// flat cells need no more than doubles.
Circumball circumball(const std::array<Point, 4>& vertices,
                      double most = std::numeric_limits<double>::infinity());

// The axis of a triangle: the line of points at equal distances from its corners.
struct Axis {
  Point center;               // circumcenter
  Point direction;            // unit normal, right-handed for the sorted corners
  double squared_radius = 0;  // of the circumcircle; infinity for a triangle without area
};
Axis axis_of(std::array<Point, 3> corners);

// Tells exactly whether p is outside the smallest ball through a triangle's corners. False for one
// without area.
bool is_outside_smallest_ball(const std::array<Point, 3>& corners, const Point& p);

}  // namespace locvol
