// The point of a segment or a triangle that is closest to a place. For what builds the mesh; the
// audit has its own (predicates.h).
#pragma once

#include <algorithm>
#include <array>

#include "octree/geometry.h"

namespace locvol {

inline Point closest_on_segment(const Point& a, const Point& b, const Point& q) {
  const Point along = b - a;
  const double length2 = dot(along, along);
  const double t = length2 > 0 ? std::clamp(dot(q - a, along) / length2, 0.0, 1.0) : 0.0;
  return a + t * along;
}

// Rounded; the triangle may be flat.
inline Point closest_on_triangle(const std::array<Point, 3>& corners, const Point& q) {
  const auto& [a, b, c] = corners;
  const Point normal = cross(b - a, c - a);
  // Where the foot in the plane lies along b - a and c - a, times the normal squared.
  const double v = dot(cross(q - a, c - a), normal), w = dot(cross(b - a, q - a), normal),
               whole = dot(normal, normal);
  if (v > 0 && w > 0 && v + w < whole) return a + (v / whole) * (b - a) + (w / whole) * (c - a);
  return std::ranges::min(
      {closest_on_segment(a, b, q), closest_on_segment(b, c, q), closest_on_segment(c, a, q)}, {},
      [&](const Point& p) { return squared_distance(p, q); });
}

// Is all of the triangle farther than √squared: its plane, or that through one of its sides and
// across it, which has it on the other side? Many that are farther are not found; rounding makes
// the distances wrong by no more than coordinates are.
inline bool is_farther_by_a_plane(const std::array<Point, 3>& corners, const Point& q,
                                  double squared) {
  const auto& [a, b, c] = corners;
  const Point normal = cross(b - a, c - a);
  const double most = squared * dot(normal, normal);
  const double above = dot(q - a, normal);
  if (above * above > most) return true;
  const auto is_beyond = [&](const Point& from, const Point& to) {
    const Point along = to - from;
    const double inside = dot(cross(along, q - from), normal);
    return inside < 0 && inside * inside > most * dot(along, along);
  };
  return is_beyond(a, b) || is_beyond(b, c) || is_beyond(c, a);
}

// How far that is; the foot in the plane needs no place.
inline double squared_distance(const Triangle& triangle, const Point& q) {
  const auto& [a, b, c] = triangle.corners;
  const Point n = cross(b - a, c - a);
  const double nn = dot(n, n);
  const bool is_above = nn > 0 && dot(cross(b - a, q - a), n) >= 0 &&
                        dot(cross(c - b, q - b), n) >= 0 && dot(cross(a - c, q - c), n) >= 0;
  if (is_above) {
    const double d = dot(q - a, n);
    return d * d / nn;
  }
  const auto to_edge = [&](const Point& from, const Point& to) {
    return squared_distance(q, closest_on_segment(from, to, q));
  };
  return std::min(std::min(to_edge(a, b), to_edge(b, c)), to_edge(c, a));
}

}  // namespace locvol
