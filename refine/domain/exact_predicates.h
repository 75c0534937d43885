// Exact signs for the layers that do not know CGAL.
#pragma once

#include <array>

#include "octree/geometry.h"

namespace locvol {

// The sign of the determinant (b - a, c - a) of the points without their coordinate `axis`: 1 if a,
// b, c turn left, seen with the two remaining axes, in cyclic order after `axis`, to the right and
// up.
int orientation_along(int axis, const Point& a, const Point& b, const Point& c);
// The sign of the determinant (b - a, c - a, d - a): 1 if a, b, c turn left as seen from d's
// opposite.
int orientation(const Point& a, const Point& b, const Point& c, const Point& d);
// The same where p, moved by the infinitesimal (ε, ε², ε³), stands for d. 0 only if a, b, c are
// collinear.
int side_of_plane(const Point& a, const Point& b, const Point& c, const Point& p);
// Does the ray upwards (in z) from p, moved likewise, cross the triangle? 1: yes, and its corners
// turn left as seen from above; -1: yes, and they turn right; 0: no.
int ray_crosses(const Point& p, const Triangle& triangle);
// Does that from the centroid of `from` cross it, but where it begins on it?
bool ray_from_centroid_crosses(const std::array<Point, 3>& from, const Triangle& triangle);
bool are_collinear(const Point& a, const Point& b, const Point& c);

}  // namespace locvol
