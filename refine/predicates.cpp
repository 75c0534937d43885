#include "refine/predicates.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Exact_rational.h>
#include <CGAL/Simple_cartesian.h>
#include <CGAL/squared_distance_3.h>

#include <limits>

namespace locvol {
namespace {

using Filtered = CGAL::Exact_predicates_inexact_constructions_kernel;
using Exact = CGAL::Simple_cartesian<CGAL::Exact_rational>;

Filtered::Point_3 filtered(const Point& p) { return {p.x, p.y, p.z}; }
Exact::Point_3 exact(const Point& p) { return {p.x, p.y, p.z}; }

// Below this fraction of (longest edge)³, the determinant has lost the digits that a circumcenter
// to 1e-10 needs: about 16 rounding errors of 1e-16 each, over 1e-10.
constexpr double kWellShaped = 4e-5;

Circumsphere exact_circumsphere(const Point& a, const Point& b, const Point& c, const Point& d) {
  const Exact::Point_3 p = exact(a), q = exact(b), r = exact(c), s = exact(d);
  if (CGAL::coplanar(p, q, r, s)) return {{}, std::numeric_limits<double>::infinity()};
  const Exact::Point_3 center = CGAL::circumcenter(p, q, r, s);
  const double squared_radius = CGAL::to_double(CGAL::squared_distance(center, p));
  return {{CGAL::to_double(center.x()), CGAL::to_double(center.y()), CGAL::to_double(center.z())},
          std::sqrt(squared_radius)};
}

double squared_segment_distance(const Point& p, const Point& a, const Point& b) {
  const Point along = b - a;
  const double length2 = dot(along, along);
  const double t = length2 > 0 ? std::clamp(dot(p - a, along) / length2, 0.0, 1.0) : 0.0;
  return squared_distance(p, a + t * along);
}

}  // namespace

int exact_orientation(const Point& a, const Point& b, const Point& c, const Point& d) {
  return CGAL::orientation(filtered(a), filtered(b), filtered(c), filtered(d));
}

int exact_side_of_circumsphere(const Point& a, const Point& b, const Point& c, const Point& d,
                               const Point& p) {
  return CGAL::side_of_oriented_sphere(filtered(a), filtered(b), filtered(c), filtered(d),
                                       filtered(p));
}

Circumsphere circumsphere_of(const Point& a, const Point& b, const Point& c, const Point& d) {
  const Point u = b - a, v = c - a, w = d - a;
  const double u2 = dot(u, u), v2 = dot(v, v), w2 = dot(w, w);
  const Point vw = cross(v, w);
  const double determinant = dot(u, vw);
  const double longest2 = std::max({u2, v2, w2});  // within a factor 4 of the longest edge, squared
  if (!(std::abs(determinant) > kWellShaped * longest2 * std::sqrt(longest2))) {
    return exact_circumsphere(a, b, c, d);
  }
  const Point offset = (0.5 / determinant) * (u2 * vw + v2 * cross(w, u) + w2 * cross(u, v));
  return {a + offset, norm(offset)};
}

double distance_to_triangle(const Point& p, const Triangle& triangle) {
  const auto& [a, b, c] = triangle.corners;
  const Point normal = cross(b - a, c - a);
  const double normal2 = dot(normal, normal);
  // The projection of p lies in the triangle if it is to the left of all three edges.
  const bool is_above = normal2 > 0 && dot(cross(b - a, p - a), normal) >= 0 &&
                        dot(cross(c - b, p - b), normal) >= 0 &&
                        dot(cross(a - c, p - c), normal) >= 0;
  const double to_edges2 =
      std::min({squared_segment_distance(p, a, b), squared_segment_distance(p, b, c),
                squared_segment_distance(p, c, a)});
  if (!is_above) return std::sqrt(to_edges2);
  return std::min(std::abs(dot(p - a, normal)) / std::sqrt(normal2), std::sqrt(to_edges2));
}

double exact_distance_to_triangle(const Point& p, const Triangle& triangle) {
  const auto& [a, b, c] = triangle.corners;
  const Exact::Triangle_3 face(exact(a), exact(b), exact(c));
  return std::sqrt(CGAL::to_double(CGAL::squared_distance(exact(p), face)));
}

}  // namespace locvol
