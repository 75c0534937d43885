#include "refine/domain/exact_predicates.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Exact_rational.h>

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

using Rational = CGAL::Exact_rational;
using Vector = std::array<Rational, 3>;

Vector exact(const Point& p) { return {Rational(p.x), Rational(p.y), Rational(p.z)}; }

// The centroid of three points, which need not be a point of doubles.
class Centroid {
 public:
  explicit Centroid(const std::array<Point, 3>& corners) : corners_(corners) {
    const auto& [a, b, c] = corners;
    for (const int axis : {0, 1, 2}) rounded_[axis] = a[axis] / 3 + b[axis] / 3 + c[axis] / 3;
    largest_ = std::max({max_norm(a), max_norm(b), max_norm(c)});
  }

  // As orientation_along(2, a, b, centroid).
  int turn(const Point& a, const Point& b) const {
    const Point u = b - a, v = rounded_ - a;
    const double turn = u.x * v.y - u.y * v.x;
    if (const int sign = certain_sign(turn, max_norm(u), a, v); sign != 0) return sign;
    const Vector p = thrice(), x = exact(a), y = exact(b);
    return CGAL::sign((y[0] - x[0]) * (p[1] - 3 * x[1]) - (y[1] - x[1]) * (p[0] - 3 * x[0]));
  }
  // As orientation(a, b, c, centroid).
  int side(const Point& a, const Point& b, const Point& c) const {
    const Point u = b - a, v = c - a, w = rounded_ - a;
    const double side = dot(cross(u, v), w);
    if (const int sign = certain_sign(side, max_norm(u) * max_norm(v), a, w); sign != 0)
      return sign;
    const Vector p = thrice(), x = exact(a), y = exact(b), z = exact(c);
    Rational determinant = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      const std::size_t j = (i + 1) % 3, k = (i + 2) % 3;
      determinant +=
          (p[i] - 3 * x[i]) * ((y[j] - x[j]) * (z[k] - x[k]) - (y[k] - x[k]) * (z[j] - x[j]));
    }
    return CGAL::sign(determinant);
  }

 private:
  // Of a determinant with the vector from a to the centroid; 0 if rounding might have changed it:
  // the centroid is off by less than three roundings of its corners' largest coordinate.
  int certain_sign(double determinant, double others, const Point& a, const Point& from_a) const {
    constexpr double kError = 256 * std::numeric_limits<double>::epsilon();
    const double error = kError * others * (largest_ + max_norm(a) + max_norm(from_a)) + 1e-290;
    return determinant > error ? 1 : determinant < -error ? -1 : 0;
  }
  Vector thrice() const {
    Vector sum = exact(corners_[0]);
    for (const std::size_t n : {1, 2})
      for (std::size_t axis = 0; axis < 3; ++axis) sum[axis] += exact(corners_[n])[axis];
    return sum;
  }

  const std::array<Point, 3>& corners_;
  Point rounded_;
  double largest_ = 0;
};

// From a place p: turn(u, v) and side(a, b, c) are orientation_along(2, u, v, p) and
// orientation(a, b, c, p).
template <class Turn, class Side>
int ray_crosses(const Triangle& triangle, const Turn& turn, const Side& side) {
  const auto& [a, b, c] = triangle.corners;
  // The side of the directed edge uv on which p lies, seen from above; 0 if that is one point.
  const auto side_of_edge = [&](const Point& u, const Point& v) {
    if (const int its = turn(u, v); its != 0) return its;
    if (u.y != v.y) return u.y > v.y ? 1 : -1;
    return u.x == v.x ? 0 : v.x > u.x ? 1 : -1;
  };
  const int turns = side_of_edge(a, b);
  if (turns == 0 || side_of_edge(b, c) != turns || side_of_edge(c, a) != turns) return 0;
  // The triangle turns left (right) as seen from above, so p is below it if abcp is negative
  // (positive).
  return side(a, b, c) * turns < 0 ? turns : 0;
}

}  // namespace

int ray_crosses(const Point& p, const Triangle& triangle) {
  return ray_crosses(
      triangle, [&](const Point& u, const Point& v) { return orientation_along(2, u, v, p); },
      [&](const Point& a, const Point& b, const Point& c) { return side_of_plane(a, b, c, p); });
}

int side_of_plane(const Point& a, const Point& b, const Point& c, const Point& p) {
  int side = orientation(a, b, c, p);
  for (int axis = 0; axis < 3 && side == 0; ++axis) side = orientation_along(axis, a, b, c);
  return side;
}

bool ray_from_centroid_crosses(const std::array<Point, 3>& from, const Triangle& triangle) {
  const Centroid p(from);
  return ray_crosses(
             triangle, [&](const Point& u, const Point& v) { return p.turn(u, v); },
             [&](const Point& a, const Point& b, const Point& c) { return p.side(a, b, c); }) != 0;
}

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
