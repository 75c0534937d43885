#include "refine/near_sphere.h"

#include <qd/dd_real.h>

#include <algorithm>

namespace locvol {
namespace {

template <class Number>
struct Offset {
  Number x, y, z;
};

// Exact.
Offset<dd_real> offset(const Point& from, const Point& to) {
  return {dd_real::sub(to.x, from.x), dd_real::sub(to.y, from.y), dd_real::sub(to.z, from.z)};
}

template <class Number>
Number squared_length(const Offset<Number>& o) {
  return o.x * o.x + o.y * o.y + o.z * o.z;
}

template <class Number>
Number minor_xy(const Offset<Number>& a, const Offset<Number>& b) {
  return a.x * b.y - b.x * a.y;
}

// Of the rows (a, |a|²), ...
template <class Number>
Number determinant(const Offset<Number>& a, const Offset<Number>& b, const Offset<Number>& c,
                   const Offset<Number>& d) {
  const Number ab = minor_xy(a, b), bc = minor_xy(b, c), cd = minor_xy(c, d), da = minor_xy(d, a),
               ac = minor_xy(a, c), bd = minor_xy(b, d);
  const Number abc = a.z * bc - b.z * ac + c.z * ab, bcd = b.z * cd - c.z * bd + d.z * bc,
               cda = c.z * da + d.z * ac + a.z * cd, dab = d.z * ab + a.z * bd + b.z * da;
  return squared_length(d) * abc - squared_length(c) * dab +
         (squared_length(b) * cda - squared_length(a) * bcd);
}

std::optional<bool> is_negative(double sum, double error) {
  if (sum < -error) return true;
  if (sum > error) return false;
  return std::nullopt;
}

}  // namespace

// By the determinant of offsets from p. With coordinates up to m its terms are 72 m⁵ at most. In
// twice the precision of doubles each operation is off by 2⁻¹⁰² of its terms at most (Hida, Li and
// Bailey, "Algorithms for quad-double precision floating point arithmetic", 2001), which adds up to
// 1300 · 2⁻¹⁰² m⁵; in doubles by 2⁻⁵³, offsets too, which adds up to 1200 · 2⁻⁵³ m⁵.
std::optional<bool> is_in_near_sphere(const std::array<Point, 4>& cell, const Point& p) {
  constexpr double kError = 0x1p-90, kDoubleError = 0x1p-42;
  constexpr double kLeast = 1e-50, kMost = 1e50;  // no underflow, no overflow
  const auto plain = [&p](const Point& q) -> Offset<double> {
    return {q.x - p.x, q.y - p.y, q.z - p.z};
  };
  const auto& [a, b, c, d] = cell;
  double m = 0;
  for (const Point& corner : cell) m = std::max(m, max_norm(corner - p));
  if (!(m > kLeast && m < kMost)) return std::nullopt;
  const double m5 = m * m * m * m * m;
  if (const auto is_inside =
          is_negative(determinant(plain(a), plain(b), plain(c), plain(d)), kDoubleError * m5))
    return is_inside;
  return is_negative(to_double(determinant(offset(p, a), offset(p, b), offset(p, c), offset(p, d))),
                     kError * m5);
}

}  // namespace locvol
