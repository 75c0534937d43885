#include "engine/output/node_places.h"

#include <algorithm>
#include <utility>

#include "engine/output/mesh_edge.h"
#include "octree/sort_and_unite.h"
#include "refine/domain/closest_point.h"

namespace locvol {
namespace {

BoxTree tree_of(const std::vector<Triangle>& triangles) {
  std::vector<Box> boxes;
  boxes.reserve(triangles.size());
  for (const Triangle& t : triangles) boxes.push_back(t.box());
  return BoxTree(std::move(boxes));
}

Point closest_on(const std::vector<Point>& way, const Point& q) {
  Point closest = way.front();
  double least = squared_distance(closest, q);
  for (std::size_t i = 1; i < way.size(); ++i) {
    const Point p = closest_on_segment(way[i - 1], way[i], q);
    if (const double squared = squared_distance(p, q); squared < least)
      least = squared, closest = p;
  }
  return closest;
}

}  // namespace

NodePlaces::NodePlaces(std::vector<Triangle> triangles, DomainPiece creases,
                       std::vector<Point> crease_points, double size)
    : triangles_(std::move(triangles)),
      tree_(tree_of(triangles_)),
      crease_points_(std::move(crease_points)) {
  if (creases.creases.empty()) return;
  sort_and_unite(crease_points_);
  segments_ = crease_segments(std::move(creases), crease_points_, size);
}

const CreaseSegment* NodePlaces::segment(const BoundaryEdgeShape& edge) const {
  if (segments_.empty()) return nullptr;
  std::array<std::uint32_t, 2> places{};
  for (std::size_t k = 0; k < 2; ++k) {
    const auto found = std::ranges::lower_bound(crease_points_, edge.ends[k]);
    if (found == crease_points_.end() || *found != edge.ends[k]) return nullptr;
    places[k] = static_cast<std::uint32_t>(found - crease_points_.begin());
  }
  std::ranges::sort(places);
  const auto found = std::ranges::lower_bound(segments_, places, {}, &CreaseSegment::points);
  return found == segments_.end() || found->points != places ? nullptr : &*found;
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
  const CreaseSegment* crease = segment(edge);
  const auto closest = crease != nullptr ? std::optional(closest_on(crease->way, q))
                                         : on_sheets(edge, q, kFarthestNode * length);
  if (!closest) return std::nullopt;
  const double squared = squared_distance(*closest, q);
  if (squared > kFarthestNode * kFarthestNode * length * length) return std::nullopt;
  return squared <= kFlat * kFlat * length * length ? q : *closest;
}

}  // namespace locvol
