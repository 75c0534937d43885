#include "refine/crossing.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Exact_rational.h>

namespace locvol {
namespace {

using K = CGAL::Exact_predicates_inexact_constructions_kernel;
using Exact = CGAL::Exact_rational;

K::Point_3 cgal(const Point& p) { return {p.x, p.y, p.z}; }

int orientation(const Point& a, const Point& b, const Point& c, const Point& d) {
  return CGAL::orientation(cgal(a), cgal(b), cgal(c), cgal(d));
}

int sign_of(const Exact& e) { return CGAL::sign(e); }

// Signs of the components of (b - a) x (d - c), exactly; of the first that is not zero.
int first_sign_of_cross(const Point& a, const Point& b, const Point& c, const Point& d) {
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    const auto difference = [](const Point& p, const Point& q, int axis) -> Exact {
      return Exact(q[axis]) - Exact(p[axis]);
    };
    const int s = sign_of(difference(a, b, j) * difference(c, d, k) -
                          difference(a, b, k) * difference(c, d, j));
    if (s != 0) return s;
  }
  return 0;
}

// Side of the triangle's plane on which p, moved, lies. Moving p by δ adds n·δ to the determinant.
// 0 only for a triangle without area.
int side_of_plane(const Triangle& t, const Point& p) {
  const auto& [a, b, c] = t.corners;
  const int s = orientation(a, b, c, p);
  return s != 0 ? s : first_sign_of_cross(a, b, a, c);
}

// Turn of the directed line p -> q, moved, around the edge u -> v. Moving the line by δ takes
// δ·((v - u) x (q - p)) from the determinant. 0 only where line and edge are parallel.
int turn(const Point& p, const Point& q, const Point& u, const Point& v) {
  const int s = orientation(p, q, u, v);
  return s != 0 ? s : -first_sign_of_cross(u, v, p, q);
}

}  // namespace

bool segment_crosses(const Point& p, const Point& q, const Triangle& triangle) {
  const int side = side_of_plane(triangle, p);
  if (side == 0 || side_of_plane(triangle, q) == side) return false;
  const auto& [a, b, c] = triangle.corners;
  const int first = turn(p, q, a, b);
  return first != 0 && turn(p, q, b, c) == first && turn(p, q, c, a) == first;
}

}  // namespace locvol
