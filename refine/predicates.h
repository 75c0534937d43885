// Exact signs and measures of cells that hold for nearly flat ones too, without CGAL in sight.
// For the audit only: what builds the mesh has its own, so that neither can hide the other's
// faults.
#pragma once

#include "octree/geometry.h"

namespace locvol {

// +1 if a, b, c turn counterclockwise seen from d (the cell abcd is positively oriented), -1 if
// clockwise, 0 if the four are coplanar. Exact. REQUIRES: finite coordinates
int exact_orientation(const Point& a, const Point& b, const Point& c, const Point& d);

// +1 if p lies inside the circumsphere of the cell abcd, 0 on it, -1 outside. Exact.
// REQUIRES: exact_orientation(a, b, c, d) > 0, finite coordinates
int exact_side_of_circumsphere(const Point& a, const Point& b, const Point& c, const Point& d,
                               const Point& p);

struct Circumsphere {
  Point center;
  double radius = 0;  // infinity for a flat cell, whose center means nothing
};

// The circumsphere, to about 1e-10 of the longest edge, or of the radius if that is larger. Beyond
// that, the center is rounded to double coordinates. REQUIRES: finite coordinates
Circumsphere circumsphere_of(const Point& a, const Point& b, const Point& c, const Point& d);

// Euclidean distance to the closed triangle. Fast; a triangle with a height below 1e-6 of its
// length may cost accuracy, which exact_distance_to_triangle does not lose.
double distance_to_triangle(const Point& p, const Triangle& triangle);
// The distance by exact arithmetic, rounded once; some 100 times slower.
double exact_distance_to_triangle(const Point& p, const Triangle& triangle);

}  // namespace locvol
