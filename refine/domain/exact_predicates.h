// Exact signs for the layers that do not know CGAL.
#pragma once

#include "octree/geometry.h"

namespace locvol {

// The sign of the determinant (b - a, c - a) of the points without their coordinate `axis`: 1 if a,
// b, c turn left, seen with the two remaining axes, in cyclic order after `axis`, to the right and
// up.
int orientation_along(int axis, const Point& a, const Point& b, const Point& c);
// The sign of the determinant (b - a, c - a, d - a): 1 if a, b, c turn left as seen from d's
// opposite.
int orientation(const Point& a, const Point& b, const Point& c, const Point& d);
bool are_collinear(const Point& a, const Point& b, const Point& c);

}  // namespace locvol
