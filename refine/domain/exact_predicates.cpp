#include "refine/domain/exact_predicates.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace locvol {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;

Kernel::Point_3 to_cgal(const Point& p) { return {p.x, p.y, p.z}; }
Kernel::Point_2 projected(const Point& p, int axis) {
  return {p[(axis + 1) % 3], p[(axis + 2) % 3]};
}

}  // namespace

int orientation_along(int axis, const Point& a, const Point& b, const Point& c) {
  return CGAL::orientation(projected(a, axis), projected(b, axis), projected(c, axis));
}

int orientation(const Point& a, const Point& b, const Point& c, const Point& d) {
  return CGAL::orientation(to_cgal(a), to_cgal(b), to_cgal(c), to_cgal(d));
}

bool are_collinear(const Point& a, const Point& b, const Point& c) {
  // CGAL has no fast path here. The rounded product is off by at most 8 units in the last place of
  // the largest term, and by less than 1e-290 where it underflows.
  const Point u = b - a, v = c - a;
  const double error =
      16 * std::numeric_limits<double>::epsilon() * max_norm(u) * max_norm(v) + 1e-290;
  if (max_norm(cross(u, v)) > error) return false;
  return CGAL::collinear(to_cgal(a), to_cgal(b), to_cgal(c));
}

}  // namespace locvol
