#include "tests/refine/brute_force.h"

#include <CGAL/Exact_rational.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace locvol::brute_force {
namespace {

using Exact = CGAL::Exact_rational;

struct Vector {
  Exact x, y, z;
};

Vector exact(const Point& p) { return {Exact(p.x), Exact(p.y), Exact(p.z)}; }
Vector operator+(const Vector& a, const Vector& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
Vector operator-(const Vector& a, const Vector& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
Vector operator*(const Exact& s, const Vector& a) { return {s * a.x, s * a.y, s * a.z}; }
Exact dot(const Vector& a, const Vector& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
Vector cross(const Vector& a, const Vector& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
Point rounded(const Vector& a) {
  return {CGAL::to_double(a.x), CGAL::to_double(a.y), CGAL::to_double(a.z)};
}

int sign(const Exact& e) { return e > 0 ? 1 : e < 0 ? -1 : 0; }

// The sign where doubles are sure of it, else 0: each product has a relative error below 10⁻¹⁵.
int sure_orientation(const Point& a, const Point& b, const Point& c, const Point& d) {
  const Point u = b - a, v = c - a, w = d - a;
  const auto products = [&](int i, int j, int k) { return u[i] * v[j] * w[k]; };
  const double plus = products(0, 1, 2) + products(1, 2, 0) + products(2, 0, 1);
  const double minus = products(0, 2, 1) + products(1, 0, 2) + products(2, 1, 0);
  double sum = 0;
  for (const auto& [i, j, k] :
       {std::array{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {1, 0, 2}, {2, 1, 0}})
    sum += std::abs(products(i, j, k));
  const double volume = plus - minus;
  return volume > 1e-13 * sum ? 1 : volume < -1e-13 * sum ? -1 : 0;
}

struct QueryPoint {
  Point position;
  bool is_moved = false;
};

Vector place(const QueryPoint& q) {
  static const Exact epsilon(std::ldexp(1.0, -400));
  static const Vector shift{epsilon, epsilon * epsilon, epsilon * epsilon * epsilon};
  return q.is_moved ? exact(q.position) + shift : exact(q.position);
}

int moved_orientation(const QueryPoint& a, const QueryPoint& b, const QueryPoint& c,
                      const QueryPoint& d) {
  if (const int s = sure_orientation(a.position, b.position, c.position, d.position)) return s;
  const Vector o = place(a);
  return sign(dot(cross(place(b) - o, place(c) - o), place(d) - o));
}

double distance_to_segment(const Point& p, const Point& a, const Point& b) {
  const double length2 = squared_distance(a, b);
  const double t = length2 > 0 ? std::clamp(locvol::dot(p - a, b - a) / length2, 0.0, 1.0) : 0;
  return norm(p - (a + t * (b - a)));
}

// From a to the circumcenter.
std::optional<Vector> circumcenter_offset(const Vector& u, const Vector& v) {
  const Vector n = cross(u, v);
  const Exact nn = dot(n, n);
  if (nn == 0) return std::nullopt;
  return Exact(1) / (2 * nn) * (dot(u, u) * cross(v, n) + dot(v, v) * cross(n, u));
}

}  // namespace

int orientation(const Point& a, const Point& b, const Point& c, const Point& d) {
  return moved_orientation({a}, {b}, {c}, {d});
}

// Of the paraboloid over p: three differences and the fourth coordinate of each corner.
int side_of_sphere(const std::array<Point, 4>& cell, const Point& p) {
  std::array<Vector, 4> to;
  std::array<Exact, 4> height;
  for (std::size_t i = 0; i < 4; ++i) {
    to[i] = exact(cell[i]) - exact(p);
    height[i] = dot(to[i], to[i]);
  }
  Exact sum = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    const Vector &a = to[(i + 1) % 4], &b = to[(i + 2) % 4], &c = to[(i + 3) % 4];
    const Exact term = height[i] * dot(a, cross(b, c));
    sum = i % 2 == 0 ? Exact(sum + term) : Exact(sum - term);
  }
  return sign(sum);
}

bool segment_crosses(const Point& a, const Point& b, const Triangle& triangle) {
  const auto& [u, v, w] = triangle.corners;
  const QueryPoint p{a, true}, q{b, true};
  const int side = moved_orientation({u}, {v}, {w}, p);
  if (side == 0 || moved_orientation({u}, {v}, {w}, q) == side) return false;
  const int turn = moved_orientation(p, q, {u}, {v});
  return moved_orientation(p, q, {v}, {w}) == turn && moved_orientation(p, q, {w}, {u}) == turn;
}

std::vector<std::uint64_t> crossings(const Point& a, const Point& b, const Mesh& mesh) {
  const Box segment = Box::around(a).joined(b);
  std::vector<std::uint64_t> ids;
  for (const Triangle& t : mesh)
    if (t.box().overlaps(segment) && segment_crosses(a, b, t)) ids.push_back(t.id);
  std::ranges::sort(ids);
  return ids;
}

bool is_inside(const Point& p, const Mesh& mesh) {
  double high = p.x;
  for (const Triangle& t : mesh) high = std::max(high, t.box().max.x);
  return crossings(p, {high + 1, p.y, p.z}, mesh).size() % 2 == 1;
}

double distance(const Point& p, const Triangle& triangle) {
  const auto& [a, b, c] = triangle.corners;
  const double rim = std::min(
      {distance_to_segment(p, a, b), distance_to_segment(p, b, c), distance_to_segment(p, c, a)});
  const Point n = locvol::cross(b - a, c - a);
  const double nn = locvol::dot(n, n);
  if (nn == 0) return rim;
  const auto is_left = [&](const Point& from, const Point& to) {
    return locvol::dot(locvol::cross(to - from, p - from), n) >= 0;
  };
  if (!is_left(a, b) || !is_left(b, c) || !is_left(c, a)) return rim;
  return std::min(rim, std::abs(locvol::dot(p - a, n)) / std::sqrt(nn));
}

double distance(const Point& p, const Mesh& mesh) {
  double best = std::numeric_limits<double>::infinity();
  for (const Triangle& t : mesh) best = std::min(best, distance(p, t));
  return best;
}

std::optional<Ball> circumball(const std::array<Point, 4>& vertices) {
  const Vector a = exact(vertices[0]);
  const Vector u = exact(vertices[1]) - a, v = exact(vertices[2]) - a, w = exact(vertices[3]) - a;
  const Exact volume = dot(u, cross(v, w));
  if (volume == 0) return std::nullopt;
  const Vector o = Exact(1) / (2 * volume) *
                   (dot(u, u) * cross(v, w) + dot(v, v) * cross(w, u) + dot(w, w) * cross(u, v));
  return Ball{rounded(a + o), std::sqrt(CGAL::to_double(dot(o, o)))};
}

std::optional<Ball> circumball(const std::array<Point, 3>& corners) {
  const Vector a = exact(corners[0]);
  const auto o = circumcenter_offset(exact(corners[1]) - a, exact(corners[2]) - a);
  if (!o) return std::nullopt;
  return Ball{rounded(a + *o), std::sqrt(CGAL::to_double(dot(*o, *o)))};
}

int side_of_smallest_ball(const std::array<Point, 3>& corners, const Point& p) {
  const Vector a = exact(corners[0]);
  const Vector o = circumcenter_offset(exact(corners[1]) - a, exact(corners[2]) - a).value();
  const Vector d = exact(p) - a - o;
  return CGAL::sign(Exact(dot(o, o) - dot(d, d)));
}

// The point m + s n of the axis through the facet's circumcenter m is as far from d as from the
// facet's corners if s = (|d - m|² - r²) / (2 n·(d - m)).
std::optional<std::array<Point, 2>> dual_edge(const std::array<Point, 3>& facet,
                                              const std::optional<Point>& here,
                                              const std::optional<Point>& there, double limit) {
  const Vector a = exact(facet[0]), u = exact(facet[1]) - a, v = exact(facet[2]) - a;
  const Vector n = cross(u, v), o = circumcenter_offset(u, v).value(), m = a + o;
  const Exact rr = dot(o, o), cut = Exact(limit / std::sqrt(CGAL::to_double(dot(n, n))));
  const auto end = [&](const std::optional<Point>& vertex,
                       const std::optional<Point>& opposite) -> Exact {
    if (!vertex) return dot(n, exact(*opposite) - m) < 0 ? Exact(2 * cut) : Exact(-2 * cut);
    const Vector d = exact(*vertex) - m;
    return (dot(d, d) - rr) / (2 * dot(n, d));
  };
  const Exact from = end(here, there), to = end(there, here);
  if ((from > cut && to > cut) || (from < -cut && to < -cut)) return std::nullopt;
  const auto point_at = [&](const Exact& s) {
    return rounded(m + (s > cut ? cut : s < -cut ? Exact(-cut) : s) * n);
  };
  return std::array{point_at(from), point_at(to)};
}

}  // namespace locvol::brute_force
