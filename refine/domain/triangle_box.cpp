#include "refine/domain/triangle_box.h"

#include <cmath>
#include <limits>

#include "refine/domain/exact_predicates.h"

// Two convex sets are apart if and only if they are along some axis (separating axis theorem):
// here the box's normals, the triangle's normal, and the products of the box's edges with the
// triangle's. The last nine are, seen along one coordinate axis, the normals of the triangle's
// edges in the plane, and there the box must lie beyond the edge. Rounded arithmetic decides where
// its errors cannot matter, and exact predicates the rest.

namespace locvol {
namespace {

constexpr double kError = 64 * std::numeric_limits<double>::epsilon();
constexpr double kUnderflow = 1e-290;

enum class Answer { kNo, kYes, kUnclear };

struct BoxMeasures {
  Point center, half;
  double largest = 0;  // coordinate of box and triangle
};

Point corner(const Box& box, int k) {
  return {(k & 1 ? box.max : box.min).x, (k & 2 ? box.max : box.min).y,
          (k & 4 ? box.max : box.min).z};
}

Answer plane_separates(const Triangle& t, const BoxMeasures& box) {
  const auto& [a, b, c] = t.corners;
  const Point u = b - a, v = c - a, n = cross(u, v);
  const double distance = std::abs(dot(n, box.center - a));
  const double reach =
      std::abs(n.x) * box.half.x + std::abs(n.y) * box.half.y + std::abs(n.z) * box.half.z;
  const double error = kError * max_norm(u) * max_norm(v) * box.largest + kUnderflow;
  if (distance > reach + error) return Answer::kYes;
  return distance < reach - error ? Answer::kNo : Answer::kUnclear;
}

bool plane_separates_exactly(const Triangle& t, const Box& box) {
  const auto& [a, b, c] = t.corners;
  const int side = orientation(a, b, c, box.min);
  if (side == 0) return false;
  for (int k = 1; k < 8; ++k)
    if (orientation(a, b, c, corner(box, k)) != side) return false;
  return true;
}

// Seen along `axis`: does the line pq have the box on one side and the point r not on that side?
Answer edge_separates(int axis, const Point& p, const Point& q, const Point& r,
                      const BoxMeasures& box) {
  const int i = (axis + 1) % 3, j = (axis + 2) % 3;
  const double di = q[i] - p[i], dj = q[j] - p[j];
  const auto side = [&](const Point& x) { return di * (x[j] - p[j]) - dj * (x[i] - p[i]); };
  const double reach = std::abs(di) * box.half[j] + std::abs(dj) * box.half[i];
  const double error = kError * std::max(std::abs(di), std::abs(dj)) * box.largest + kUnderflow;
  const double at_center = side(box.center), at_r = side(r);
  if (std::abs(at_center) < reach - error) return Answer::kNo;  // on both sides
  if (std::abs(at_center) <= reach + error || std::abs(at_r) <= error) return Answer::kUnclear;
  return (at_center > 0) != (at_r > 0) ? Answer::kYes : Answer::kNo;
}

bool edge_separates_exactly(int axis, const Point& p, const Point& q, const Point& r,
                            const Box& box) {
  const int side = orientation_along(axis, p, q, box.min);
  if (side == 0 || orientation_along(axis, p, q, r) == side) return false;
  for (int k = 1; k < 8; ++k)
    if (orientation_along(axis, p, q, corner(box, k)) != side) return false;
  return true;
}

}  // namespace

bool touches(const Triangle& triangle, const Box& box) {
  const Box around = triangle.box();
  if (!around.overlaps(box)) return false;
  for (const Point& p : triangle.corners)
    if (box.contains(p)) return true;
  const BoxMeasures measures{
      box.center(), 0.5 * (box.max - box.min),
      std::max({max_norm(box.min), max_norm(box.max), max_norm(around.min), max_norm(around.max)})};
  const Answer plane = plane_separates(triangle, measures);
  if (plane == Answer::kYes ||
      (plane == Answer::kUnclear && plane_separates_exactly(triangle, box)))
    return false;
  for (int axis = 0; axis < 3; ++axis)
    for (std::size_t k = 0; k < 3; ++k) {
      const Point &p = triangle.corners[k], &q = triangle.corners[(k + 1) % 3],
                  &r = triangle.corners[(k + 2) % 3];
      const Answer edge = edge_separates(axis, p, q, r, measures);
      if (edge == Answer::kYes ||
          (edge == Answer::kUnclear && edge_separates_exactly(axis, p, q, r, box)))
        return false;
    }
  return true;
}

bool touches(const CreaseEdge& edge, const Box& box) { return touches(edge.as_triangle(), box); }

bool plane_misses(const Triangle& t, const Box& box, double slack) {
  const auto& [a, b, c] = t.corners;
  const Point n = cross(b - a, c - a);
  const Point half = 0.5 * (box.max - box.min);
  const double size = std::abs(n.x) + std::abs(n.y) + std::abs(n.z);
  const double reach = std::abs(n.x) * half.x + std::abs(n.y) * half.y + std::abs(n.z) * half.z;
  // The normal of a needle has large relative errors, bounded by the edges' rounding.
  const Point e = b - a, f = c - a;
  const double edge =
      std::abs(e.x) + std::abs(e.y) + std::abs(e.z) + std::abs(f.x) + std::abs(f.y) + std::abs(f.z);
  const double error = slack * (size + edge * norm(half) * 4);
  return std::abs(dot(n, box.center() - a)) > reach + error;
}

bool meets(const Triangle& triangle, const Box& box) {
  const Box around = triangle.box();
  const double slack = slack_at(std::max(largest_coordinate(around), largest_coordinate(box)));
  return around.overlaps(box.expanded(slack)) && !plane_misses(triangle, box, slack);
}

}  // namespace locvol
