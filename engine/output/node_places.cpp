#include "engine/output/node_places.h"

#include <algorithm>
#include <limits>

#include "engine/output/mesh_edge.h"
#include "refine/domain/closest_point.h"

namespace locvol {
namespace {

BoxTree tree_of(const std::vector<Triangle>& triangles) {
  std::vector<Box> boxes;
  boxes.reserve(triangles.size());
  for (const Triangle& t : triangles) boxes.push_back(t.box());
  return BoxTree(std::move(boxes));
}

}  // namespace

NodePlaces::NodePlaces(std::vector<Triangle> triangles, DomainPiece creases,
                       const std::vector<Point>& crease_points, double tolerance)
    : triangles_(std::move(triangles)), tree_(tree_of(triangles_)) {
  if (creases.creases.empty()) return;
  creases_ = std::make_unique<LeafDomain>(std::move(creases));
  graph_.emplace(*creases_);
  for (const Point& p : crease_points)
    if (const auto index = graph_->add(p, tolerance)) points_.emplace_back(p, *index);
  std::ranges::sort(points_);
}

CreaseGraph::Index NodePlaces::point_at(const Point& p) const {
  const auto found =
      std::ranges::lower_bound(points_, p, {}, &decltype(points_)::value_type::first);
  return found == points_.end() || found->first != p ? CreaseGraph::kNone : found->second;
}

std::optional<CreaseGraph::Neighbor> NodePlaces::way(const BoundaryEdgeShape& edge) const {
  if (!graph_) return std::nullopt;
  const CreaseGraph::Index from = point_at(edge.ends[0]), to = point_at(edge.ends[1]);
  if (from == CreaseGraph::kNone || to == CreaseGraph::kNone) return std::nullopt;
  std::vector<CreaseGraph::Neighbor> around;
  graph_->neighbors(from, around);
  std::optional<CreaseGraph::Neighbor> shortest;
  for (const CreaseGraph::Neighbor& neighbor : around)
    if (neighbor.point == to && (!shortest || neighbor.along < shortest->along))
      shortest = neighbor;
  return shortest;
}

std::optional<Point> NodePlaces::on_crease(const CreaseGraph::Neighbor& way, const Point& q) const {
  std::optional<Point> closest;
  double least = std::numeric_limits<double>::infinity();
  graph_->for_each_part(way.heading, way.along, [&](const Point& a, const Point& b, double) {
    const Point p = closest_on_segment(a, b, q);
    if (const double squared = squared_distance(p, q); squared < least)
      least = squared, closest = p;
  });
  return closest;
}

std::optional<Point> NodePlaces::on_sheets(const BoundaryEdgeShape& edge, const Point& q,
                                           double distance) const {
  std::optional<Point> closest;
  double squared = distance * distance;
  tree_.for_each_within(q, squared, [&](std::uint32_t n) {
    const Triangle& t = triangles_[n];
    if (t.sheet != edge.sheets[0] && t.sheet != edge.sheets[1]) return;
    if (dot(normal_of(t.corners), edge.outward) <= 0) return;
    const Point p = closest_on_triangle(t.corners, q);
    if (const double d = squared_distance(p, q); d < squared) squared = d, closest = p;
  });
  return closest;
}

std::optional<Point> NodePlaces::place(const BoundaryEdgeShape& edge) const {
  const Point q = middle(edge.ends[0], edge.ends[1]);
  const double length = norm(edge.ends[1] - edge.ends[0]);
  const auto neighbor = way(edge);
  const auto closest =
      neighbor ? on_crease(*neighbor, q) : on_sheets(edge, q, kFarthestNode * length);
  if (!closest) return std::nullopt;
  const double squared = squared_distance(*closest, q);
  if (squared > kFarthestNode * kFarthestNode * length * length) return std::nullopt;
  return squared <= kFlat * kFlat * length * length ? q : *closest;
}

}  // namespace locvol
