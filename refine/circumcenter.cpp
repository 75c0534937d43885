#include "refine/circumcenter.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Exact_rational.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace locvol {
namespace {

using Rational = CGAL::Exact_rational;
using Quad = __float128;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

double to_double(double v) { return v; }
double to_double(Quad v) { return static_cast<double>(v); }
double to_double(const Rational& v) { return CGAL::to_double(v); }

template <class T>
struct Vector {
  T x, y, z;
};

template <class T>
Vector<T> difference(const Point& a, const Point& b) {
  return {T(a.x) - T(b.x), T(a.y) - T(b.y), T(a.z) - T(b.z)};
}
template <class T>
Vector<T> cross(const Vector<T>& a, const Vector<T>& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
template <class T>
T dot(const Vector<T>& a, const Vector<T>& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}

// center = a + numerator / denominator, with
//   numerator = |u|² (v x w) + |v|² (w x u) + |w|² (u x v),  denominator = 2 u·(v x w),
// for the edges u, v, w from a.
template <class T>
struct CenterOffset {
  Vector<T> numerator;
  T denominator;

  bool exceeds(const T& least) const { return denominator > least || denominator < -least; }
};

template <class T>
CenterOffset<T> offset(const Point& a, const Point& b, const Point& c, const Point& d) {
  const auto u = difference<T>(b, a), v = difference<T>(c, a), w = difference<T>(d, a);
  const auto vw = cross(v, w), wu = cross(w, u), uv = cross(u, v);
  const T uu = dot(u, u), vv = dot(v, v), ww = dot(w, w);
  return {{uu * vw.x + vv * wu.x + ww * uv.x, uu * vw.y + vv * wu.y + ww * uv.y,
           uu * vw.z + vv * wu.z + ww * uv.z},
          T(2) * dot(u, vw)};
}

template <class T>
Circumball ball(const Point& a, const CenterOffset<T>& offset) {
  const auto& [numerator, denominator] = offset;
  const Vector<T> o{numerator.x / denominator, numerator.y / denominator,
                    numerator.z / denominator};
  const Point center{to_double(T(a.x) + o.x), to_double(T(a.y) + o.y), to_double(T(a.z) + o.z)};
  return {center, to_double(dot(o, o))};
}

// Is the radius larger than `most`, whatever was rounded? The numerator is off by less than a
// hundred roundings of size⁴, the denominator by as many of size³.
bool is_larger(const CenterOffset<double>& o, double size, double most) {
  constexpr double kError = 1e-13;
  if (!(size > 1e-70 && size < 1e70)) return false;  // else they may underflow or overflow
  const double cube = size * size * size;
  return std::sqrt(dot(o.numerator, o.numerator)) - kError * cube * size >
         most * (std::abs(o.denominator) + kError * cube);
}

// In lexicographic order. Which of two random points comes first no processor can foretell, so
// without branches, but for points with the same x.
std::array<Point, 4> sorted(const std::array<Point, 4>& points) {
  std::array<std::size_t, 4> place{};
  bool has_equal = false;
  for (std::size_t i = 0; i < 4; ++i)
    for (std::size_t j = i + 1; j < 4; ++j) {
      const bool is_after = points[i].x > points[j].x;
      has_equal |= points[i].x == points[j].x;
      place[i] += is_after;
      place[j] += !is_after;
    }
  std::array<Point, 4> result = points;
  if (has_equal)
    std::ranges::sort(result);
  else
    for (std::size_t i = 0; i < 4; ++i) result[place[i]] = points[i];
  return result;
}

}  // namespace

Circumball circumball(const std::array<Point, 4>& vertices, double most) {
  const auto [a, b, c, d] = sorted(vertices);
  const double size = std::max(std::max(max_norm(b - a), max_norm(c - a)), max_norm(d - a));
  const double cube = size * size * size;
  const auto rounded = offset<double>(a, b, c, d);
  if (rounded.exceeds(1e-3 * cube)) return ball(a, rounded);
  if (is_larger(rounded, size, most)) return {{}, kInfinity};
  if (const auto o = offset<Quad>(a, b, c, d); o.exceeds(Quad(1e-18 * cube))) return ball(a, o);
  if (const auto o = offset<Rational>(a, b, c, d); o.exceeds(Rational(0))) return ball(a, o);
  return {{}, kInfinity};
}

Axis axis_of(std::array<Point, 3> corners) {
  std::ranges::sort(corners);
  const auto& [a, b, c] = corners;
  const Point u = b - a, v = c - a, n = locvol::cross(u, v);
  const double nn = locvol::dot(n, n);
  if (!(nn > 0)) return {{}, {}, kInfinity};
  const Point o = (0.5 / nn) * (locvol::dot(u, u) * locvol::cross(v, n) +
                                locvol::dot(v, v) * locvol::cross(n, u));
  return {a + o, (1 / std::sqrt(nn)) * n, locvol::dot(o, o)};
}

// By the smallest ball's center a + o, |w|² against 2 o·w, both times |n|². With coordinates up to
// m the terms of the difference are 108 m⁶ at most, its roundings 2100 · 2⁻⁵³ m⁶.
bool is_outside_smallest_ball(const std::array<Point, 3>& corners, const Point& p) {
  constexpr double kError = 0x1p-41, kLeast = 1e-45, kMost = 1e45;  // no underflow, no overflow
  const auto& [a, b, c] = corners;
  const Point u = b - a, v = c - a, w = p - a, n = locvol::cross(u, v);
  const double m = std::max(std::max(max_norm(u), max_norm(v)), max_norm(w));
  const double excess =
      locvol::dot(w, w) * locvol::dot(n, n) -
      locvol::dot(locvol::dot(u, u) * locvol::cross(v, n) + locvol::dot(v, v) * locvol::cross(n, u),
                  w);
  const double cube = m * m * m;
  if (m > kLeast && m < kMost && std::abs(excess) > kError * cube * cube) return excess > 0;
  using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
  const auto cgal = [](const Point& q) { return Kernel::Point_3{q.x, q.y, q.z}; };
  return CGAL::side_of_bounded_sphere(cgal(a), cgal(b), cgal(c), cgal(p)) ==
         CGAL::ON_UNBOUNDED_SIDE;
}

}  // namespace locvol
