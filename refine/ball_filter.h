// Which balls of cells have a point in them, where doubles are certain of it: nearly always.
// Internal to refine/.
#pragma once

#include <algorithm>
#include <array>
#include <limits>
#include <optional>

#include "octree/geometry.h"

namespace locvol {

// Twice the way from a cell's corner to its circumcenter, known to 2^-20 of its length; else not
// numbers.
struct WayToCenter {
  float x = kUnknown, y = kUnknown, z = kUnknown;
  static constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();
  bool is_known() const { return x == x; }
  Point vector() const { return {x, y, z}; }
};

// The way from a cell's corner to its circumcenter, from the ways to its other corners, a, b and c.
// Of D and N, whose quotient it is, rounding changes 60 ε |a|³ and 220 ε |a|⁴ at most, with the
// longest a. As twice the radius is no less than |a|, that is 3e-7 of each where D is not small,
// and 2^-20 with what rounding to floats adds.
inline WayToCenter way_to_center(const Point& a, const Point& b, const Point& c) {
  constexpr double kFlat = 1e-7, kLeast = 1e-30, kMost = 1e30;  // floats do not underflow, overflow
  const double a2 = dot(a, a), b2 = dot(b, b), c2 = dot(c, c);
  const Point bc = cross(b, c);
  const double determinant = dot(a, bc), longest2 = std::max(std::max(a2, b2), c2);
  const Point way = 1 / determinant * (a2 * bc + b2 * cross(c, a) + c2 * cross(a, b));
  const double length = max_norm(way);
  if (!(determinant * determinant > kFlat * kFlat * longest2 * longest2 * longest2) ||
      !(length > kLeast && length < kMost))
    return {};
  return {static_cast<float>(way.x), static_cast<float>(way.y), static_cast<float>(way.z)};
}

// Tells whether p is in the circumball of the cell with this corner, and so no vertex. Empty where
// the way does not tell.
[[gnu::always_inline]] inline std::optional<bool> is_in_ball(const WayToCenter& way_to,
                                                             const Point& corner, const Point& p) {
  const Point q = p - corner, way = way_to.vector();
  // Inside if |q|² < q·way.
  const double q2 = dot(q, q), difference = q2 - dot(q, way);
  constexpr double kError = 0x1p-18;  // over |q| |way|
  if (difference * difference > kError * kError * q2 * dot(way, way)) return difference < 0;
  return std::nullopt;
}

}  // namespace locvol
