#include "refine/near_sphere.h"

#include <qd/dd_real.h>

#include <algorithm>

namespace locvol {
namespace {

struct Offset {
  dd_real x, y, z;
};

// Exact.
Offset offset(const Point& from, const Point& to) {
  return {dd_real::sub(to.x, from.x), dd_real::sub(to.y, from.y), dd_real::sub(to.z, from.z)};
}

dd_real squared_length(const Offset& o) { return o.x * o.x + o.y * o.y + o.z * o.z; }
dd_real minor_xy(const Offset& a, const Offset& b) { return a.x * b.y - b.x * a.y; }

}  // namespace

// The determinant of the rows (a, |a|²), ... of offsets from p. With coordinates up to m its terms
// are 72 m⁵ at most. Each of its operations is off by 2⁻¹⁰² of its terms at most (Hida, Li and
// Bailey, "Algorithms for quad-double precision floating point arithmetic", 2001), which adds up to
// 1300 · 2⁻¹⁰² m⁵.
std::optional<bool> is_in_near_sphere(const std::array<Point, 4>& cell, const Point& p) {
  constexpr double kError = 0x1p-90, kLeast = 1e-50, kMost = 1e50;  // no underflow, no overflow
  double m = 0;
  for (const Point& corner : cell) m = std::max(m, max_norm(corner - p));
  if (!(m > kLeast && m < kMost)) return std::nullopt;
  const Offset a = offset(p, cell[0]), b = offset(p, cell[1]), c = offset(p, cell[2]),
               d = offset(p, cell[3]);
  const dd_real ab = minor_xy(a, b), bc = minor_xy(b, c), cd = minor_xy(c, d), da = minor_xy(d, a),
                ac = minor_xy(a, c), bd = minor_xy(b, d);
  const dd_real abc = a.z * bc - b.z * ac + c.z * ab, bcd = b.z * cd - c.z * bd + d.z * bc,
                cda = c.z * da + d.z * ac + a.z * cd, dab = d.z * ab + a.z * bd + b.z * da;
  const dd_real determinant = squared_length(d) * abc - squared_length(c) * dab +
                              (squared_length(b) * cda - squared_length(a) * bcd);
  const double sum = to_double(determinant), error = kError * m * m * m * m * m;
  if (sum < -error) return true;
  if (sum > error) return false;
  return std::nullopt;
}

}  // namespace locvol
