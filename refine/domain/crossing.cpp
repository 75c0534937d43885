#include "refine/domain/crossing.h"

#include <CGAL/Exact_rational.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "refine/domain/exact_predicates.h"

namespace locvol {
namespace {

using Rational = CGAL::Exact_rational;

// The sign of a determinant of three differences of points, with largest coordinates whose product
// is `extent`; 0 if rounding might have changed it, which takes 34 roundings of `extent` at most.
int certain_sign(double determinant, double extent) {
  constexpr double kError = 56 * 0x1p-53;
  if (!(extent > 1e-200 && extent < 1e200)) return 0;  // else products may underflow or overflow
  return determinant > kError * extent ? 1 : determinant < -kError * extent ? -1 : 0;
}

// What doubles can decide of segment_crosses, which is nearly all; else empty. All signs that it
// takes are those of the exact test.
std::optional<bool> crosses_for_certain(const Point& p, const Point& q, const Triangle& triangle) {
  const auto& [a, b, c] = triangle.corners;
  const Point u = b - a, v = c - a, normal = cross(u, v), ap = p - a, aq = q - a;
  const double extent = max_norm(u) * max_norm(v);
  const int side = certain_sign(dot(ap, normal), extent * max_norm(ap));
  const int other_side = certain_sign(dot(aq, normal), extent * max_norm(aq));
  if (side == 0 || other_side == 0) return std::nullopt;
  if (side == other_side) return false;
  const Point d = q - p;
  const std::array<Point, 3> corners{a - p, b - p, c - p};
  const double length = max_norm(d);
  std::array<int, 3> turns{};
  for (std::size_t i = 0; i < 3; ++i) {
    const Point &from = corners[i], &to = corners[(i + 1) % 3];
    turns[i] = certain_sign(dot(d, cross(from, to)), length * max_norm(from) * max_norm(to));
  }
  if (turns[0] * turns[1] < 0 || turns[1] * turns[2] < 0 || turns[2] * turns[0] < 0) return false;
  if (turns[0] == 0 || turns[1] == 0 || turns[2] == 0) return std::nullopt;
  return true;
}

int sign_of(const Rational& e) { return CGAL::sign(e); }

// Signs of the components of (b - a) x (d - c), exactly; of the first that is not zero.
int first_sign_of_cross(const Point& a, const Point& b, const Point& c, const Point& d) {
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    const auto difference = [](const Point& p, const Point& q, int axis) -> Rational {
      return Rational(q[axis]) - Rational(p[axis]);
    };
    const int s = sign_of(difference(a, b, j) * difference(c, d, k) -
                          difference(a, b, k) * difference(c, d, j));
    if (s != 0) return s;
  }
  return 0;
}

// Turn of the directed line p -> q, moved, around the edge u -> v. Moving the line by δ takes
// δ·((v - u) x (q - p)) from the determinant. 0 only where line and edge are parallel.
int turn(const Point& p, const Point& q, const Point& u, const Point& v) {
  const int s = orientation(p, q, u, v);
  return s != 0 ? s : -first_sign_of_cross(u, v, p, q);
}

}  // namespace

bool segment_crosses(const Point& p, const Point& q, const Triangle& triangle) {
  if (const auto crosses = crosses_for_certain(p, q, triangle)) return *crosses;
  const auto side_of = [&](const Point& r) {
    return side_of_plane(triangle.corners[0], triangle.corners[1], triangle.corners[2], r);
  };
  const int side = side_of(p);
  if (side == 0 || side_of(q) == side) return false;
  const auto& [a, b, c] = triangle.corners;
  const int first = turn(p, q, a, b);
  return first != 0 && turn(p, q, b, c) == first && turn(p, q, c, a) == first;
}

}  // namespace locvol
