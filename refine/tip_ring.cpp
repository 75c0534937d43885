#include "refine/tip_ring.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>

namespace locvol {
namespace {

// The mean of the normals there, by angle; of unit length, or 0.
Point axis_at(const Point& tip, const std::vector<Triangle>& triangles) {
  Point sum;
  for (const auto& [id, corners, sheet, change] : triangles)
    for (std::size_t i = 0; i < 3; ++i) {
      if (corners[i] != tip) continue;
      const Point a = corners[(i + 1) % 3] - tip, b = corners[(i + 2) % 3] - tip,
                  normal = cross(a, b);
      if (const double length = norm(normal); length > 0)
        sum = sum + std::atan2(length, dot(a, b)) / length * normal;
    }
  const double length = norm(sum);
  return length > 0 ? 1 / length * sum : Point{};
}

// A unit vector at right angles to another.
Point across(const Point& axis) {
  const Point other = std::abs(axis.x) < 0.6 ? Point{1, 0, 0} : Point{0, 1, 0};
  const Point way = cross(axis, other);
  return 1 / norm(way) * way;
}

class TipRing {
 public:
  TipRing(const LeafDomain& domain, const Point& tip, double most) : tip_(tip) {
    domain.triangles_near(tip, most, triangles_);
    axis_ = axis_at(tip, triangles_);
  }

  bool has_axis() const { return axis_ != Point{}; }

  // Empty if some angle has no such place, or several.
  std::vector<Point> at(double radius) const {
    const Point u = across(axis_), v = cross(axis_, u);
    std::vector<Point> ring;
    for (int k = 0; k < kNumAroundTip; ++k) {
      const double angle = 2 * std::numbers::pi * k / kNumAroundTip;
      const auto place = place_on(std::cos(angle) * u + std::sin(angle) * v, radius);
      if (!place) return {};
      ring.push_back(*place);
    }
    return ring;
  }

 private:
  // Of the half-plane from the axis in that direction: the only place of the surface at the
  // distance from the tip.
  std::optional<Point> place_on(const Point& way, double radius) const {
    const Point normal = cross(axis_, way);
    std::optional<Point> found;
    for (const Triangle& t : triangles_) {
      const auto part = cut(t.corners, normal);
      if (!part) continue;
      const auto& [a, b] = *part;
      const bool is_far = dot(a, a) >= radius * radius;
      if (is_far == (dot(b, b) >= radius * radius)) continue;
      const Point place = on_sphere(is_far ? b : a, is_far ? a : b, radius);
      if (dot(place, way) <= 0) continue;
      if (found) return std::nullopt;
      found = place;
    }
    if (found) *found = tip_ + *found;
    return found;
  }

  // Where the plane through the tip cuts a triangle, from the tip. What lies in the plane is on one
  // side of it, and edges are cut the same way from both of their triangles: so what is cut hangs
  // together.
  std::optional<std::array<Point, 2>> cut(const std::array<Point, 3>& corners,
                                          const Point& normal) const {
    std::array<Point, 2> ends;
    std::size_t num = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      Point p = corners[i], q = corners[(i + 1) % 3];
      if (q < p) std::swap(p, q);
      const Point a = p - tip_, b = q - tip_;
      const double over_a = dot(a, normal), over_b = dot(b, normal);
      if ((over_a >= 0) == (over_b >= 0)) continue;
      ends[num++] = a + over_a / (over_a - over_b) * (b - a);
    }
    return num == 2 ? std::optional(ends) : std::nullopt;
  }

  // From a place within the sphere around the origin to one that is not.
  static Point on_sphere(const Point& within, const Point& beyond, double radius) {
    const Point way = beyond - within;
    const double a = dot(way, way), b = dot(within, way),
                 c = std::min(dot(within, within) - radius * radius, 0.0);
    const double root = std::sqrt(std::max(b * b - a * c, 0.0));
    const double t = b > 0 ? -c / (b + root) : (root - b) / a;
    return within + std::clamp(t, 0.0, 1.0) * way;
  }

  Point tip_, axis_;
  std::vector<Triangle> triangles_;
};

}  // namespace

std::vector<Point> ring_around_tip(const LeafDomain& domain, const Point& tip, double most,
                                   double least) {
  constexpr double kShare = 0.45;  // of the way to another tip: at a half, rings of both would meet
  double radius = most;
  if (const auto crease = domain.closest_on_crease(tip, 2 * most))
    radius = std::min(radius, 0.5 * norm(crease->position - tip));
  for (const CornerPoint& corner : domain.corners())
    if (corner.position != tip) radius = std::min(radius, kShare * norm(corner.position - tip));
  const TipRing ring(domain, tip, most);
  if (!ring.has_axis()) return {};
  for (; radius >= least; radius *= 0.5)
    if (std::vector<Point> points = ring.at(radius); !points.empty()) return points;
  return {};
}

}  // namespace locvol
