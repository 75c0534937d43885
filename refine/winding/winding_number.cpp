#include "refine/winding/winding_number.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "refine/domain/exact_predicates.h"

namespace locvol {
namespace {

Point area_of(const std::array<Point, 3>& t) { return 0.5 * cross(t[1] - t[0], t[2] - t[0]); }

// On which side of the triangle the place is, moved: 1 behind it, -1 before it.
int side_of(const Point& p, const std::array<Point, 3>& t, double determinant, double extent) {
  constexpr double kError = 1e-14;
  if (determinant > kError * extent) return 1;
  if (determinant < -kError * extent) return -1;
  return -side_of_plane(t[0], t[1], t[2], p);
}

// The signed solid angle, positive seen from behind (Van Oosterom, Strackee, 1983).
double solid_angle(const Point& p, const std::array<Point, 3>& t) {
  const Point a = t[0] - p, b = t[1] - p, c = t[2] - p;
  const double la = norm(a), lb = norm(b), lc = norm(c);
  const double determinant = dot(a, cross(b, c));
  const double rest = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb;
  const double angle = 2 * std::atan2(std::abs(determinant), rest);
  return side_of(p, t, determinant, la * lb * lc) * angle;
}

}  // namespace

// Each loop of edges gets an apex beside the middle of its box: on a plane hole's plane cones would
// lie on what is there.
Cones::Cones(const Chain& chain, std::span<const OpenEdge> edges) {
  if (edges.empty()) return;
  for (const std::vector<std::uint32_t>& loop : loops_of(edges, chain.vertices.size())) {
    Box box = Box::around(chain.vertices[edges[loop[0]].from]);
    for (const std::uint32_t i : loop) box = box.joined(chain.vertices[edges[i].from]);
    const double extent = max_norm(box.max - box.min);
    const Point apex = box.center() + Point{0.0618 * extent, 0.0414 * extent, 0.0732 * extent};
    for (const std::uint32_t i : loop)
      cones_.push_back({chain.vertices[edges[i].to], chain.vertices[edges[i].from], apex});
  }
  build(0, static_cast<std::uint32_t>(cones_.size()));
}

std::uint32_t Cones::build(std::uint32_t begin, std::uint32_t end) {
  constexpr std::uint32_t kInLeaf = 4;
  const auto at = static_cast<std::uint32_t>(nodes_.size());
  nodes_.emplace_back();
  Node node;
  node.begin = begin;
  node.end = end;
  double& area = node.area;
  Point sum;
  Box box = Box::around(cones_[begin][0]);
  for (std::uint32_t i = begin; i < end; ++i) {
    const Cone& corners = cones_[i];
    const Point vector = area_of(corners);
    const double weight = norm(vector);
    const Point center = 1.0 / 3 * (corners[0] + corners[1] + corners[2]);
    node.moment = node.moment + vector;
    sum = sum + weight * center;
    area += weight;
    box = box.joined(center);
  }
  node.center = area > 0 ? (1 / area) * sum : box.center();
  for (std::uint32_t i = begin; i < end; ++i)
    for (const Point& p : cones_[i]) node.radius = std::max(node.radius, norm(p - node.center));
  if (end - begin > kInLeaf) {
    const Point sides = box.max - box.min;
    const int axis = sides.x >= sides.y && sides.x >= sides.z ? 0 : sides.y >= sides.z ? 1 : 2;
    const std::uint32_t middle = begin + (end - begin) / 2;
    const auto place = [&](std::uint32_t i) { return cones_.begin() + std::ptrdiff_t{i}; };
    std::nth_element(place(begin), place(middle), place(end), [&](const Cone& a, const Cone& b) {
      const auto key = [&](const Cone& c) { return c[0][axis] + c[1][axis] + c[2][axis]; };
      return key(a) != key(b) ? key(a) < key(b) : a < b;
    });
    build(begin, middle);
    node.second = build(middle, end);
  }
  nodes_[at] = node;
  return at;
}

double Cones::angle_at(const Point& p, double far) const {
  return nodes_.empty() ? 0 : angle_of(nodes_[0], p, far) / (4 * std::numbers::pi);
}

double Cones::angle_of(const Node& node, const Point& p, double far) const {
  const Point d = node.center - p;
  const double squared = dot(d, d);
  if (squared > far * far * node.radius * node.radius)
    return dot(node.moment, d) / (squared * std::sqrt(squared));
  if (node.second != 0)
    return angle_of(*(&node + 1), p, far) + angle_of(nodes_[node.second], p, far);
  double sum = 0;
  for (std::uint32_t i = node.begin; i < node.end; ++i) sum += solid_angle(p, cones_[i]);
  return sum;
}

bool Cones::is_surely_below(double most, const Point& p) const {
  double left = most * 4 * std::numbers::pi;
  if (!nodes_.empty()) take_most_of(nodes_[0], p, left);
  return left > 0;
}

void Cones::take_most_of(const Node& node, const Point& p, double& left) const {
  constexpr double kFarEnough = 2;  // radii: then at most four times what it may be
  const double distance = norm(node.center - p);
  if (distance > kFarEnough * node.radius) {
    const double nearest = distance - node.radius;
    left -= node.area / (nearest * nearest);
    return;
  }
  if (node.second != 0) {
    take_most_of(*(&node + 1), p, left);
    if (left > 0) take_most_of(nodes_[node.second], p, left);
    return;
  }
  for (std::uint32_t i = node.begin; i < node.end; ++i) left -= std::abs(solid_angle(p, cones_[i]));
}

bool is_seen_before(const std::array<Point, 3>& triangle, const Point& p) {
  return side_of_plane(triangle[0], triangle[1], triangle[2], p) > 0;
}

BesideNumbers beside_triangle(const std::array<Point, 3>& triangle, int times, int whole,
                              const Cones& cones) {
  const Point p = place_on(triangle);
  double there = whole - cones.angle_at(p, Cones::kFar);
  constexpr double kNear = 1e-2;
  const double part = there - std::floor(there);
  if (std::abs(part - 0.5) < kNear) there = whole - cones.angle_at(p, Cones::kFarther);
  return is_seen_before(triangle, p) ? BesideNumbers{there + times, there}
                                     : BesideNumbers{there, there - times};
}

WindingNumber::WindingNumber(const Chain& chain) : open_(open_edges(chain)), cones_(chain, open_) {
  for (const ChainTriangle& t : chain.triangles) {
    triangles_.push_back({.corners = chain.points_of(t)});
    times_.push_back(t.times);
  }
  for (const Cones::Cone& cone : cones_.all()) {
    triangles_.push_back({.corners = cone});
    times_.push_back(1);
  }
  std::vector<Point> vertices;
  std::vector<std::array<std::uint32_t, 3>> corners;
  for (std::uint32_t t = 0; t < triangles_.size(); ++t) {
    const auto& [a, b, c] = triangles_[t].corners;
    triangles_[t].id = t;
    if (orientation_along(2, a, b, c) == 0) continue;  // upright: no ray upwards crosses it
    const auto first = static_cast<std::uint32_t>(vertices.size());
    vertices.insert(vertices.end(), {a, b, c});
    corners.push_back({first, first + 1, first + 2});
    in_tree_.push_back(t);
  }
  tree_.emplace_back(vertices, corners);
}

// Of the ray upwards, each with the side that it comes out on.
int WindingNumber::whole_at(const Point& p) const {
  int sum = 0;
  tree_[0].for_each_along(TriangleTree::Stretch(p, {0, 0, 1}, 0), 0, [&](std::uint32_t n) {
    const std::uint32_t t = in_tree_[n];
    sum += ray_crosses(p, triangles_[t]) * times_[t];
  });
  return sum;
}

BesideNumbers WindingNumber::beside(std::size_t t) const {
  const std::array<Point, 3>& corners = triangles_[t].corners;
  return beside_triangle(corners, times_[t], whole_at(place_on(corners)), cones_);
}

}  // namespace locvol
