#include "refine/leaf_creases.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numbers>

#include "refine/crease_leaf.h"
#include "refine/domain/closest_point.h"
#include "refine/edge_sides.h"

namespace locvol {

LeafCreases::LeafCreases(const LeafDomain& domain, const LeafMesh& mesh,
                         std::span<const MeshPoint> points, double size)
    : domain_(domain), mesh_(mesh), points_(points), size_(size), graph_(domain) {
  std::vector<Ball> balls;
  for (const MeshPoint& p : points) {
    const auto index = graph_.add(p.position, tolerance());
    index_of_points_.push_back(index.value_or(CreaseGraph::kNone));
    if (index) balls.push_back({p.position, *index});
  }
  local_.assign(graph_.num_points(), kInfiniteVertex);
  radius_.resize(graph_.num_points());
  for (CreaseGraph::Index i = 0; i < radius_.size(); ++i) {
    radius_[i] = graph_.ball_radius(i);
    largest_radius_ = std::max(largest_radius_, radius_[i]);
  }
  constexpr double kMostCubes = 64;  // in a row
  balls_.emplace(domain.region(), std::max(largest_radius_, 0.1 * size), kMostCubes, balls);
  for (LocalIndex v = 0; v < mesh.num_locals(); ++v) add(v);
}

void LeafCreases::match(LocalIndex v, CreaseGraph::Index index) {
  index_.resize(std::max<std::size_t>(index_.size(), std::size_t{v} + 1), CreaseGraph::kNone);
  index_[v] = index;
  local_[index] = v;
}

void LeafCreases::add(LocalIndex v) {
  const LeafMesh::Local& local = mesh_.local(v);
  if (local.point.kind != PointKind::kCrease || !local.is_alive) return;
  if ((local.ref & kNewPoint) == 0) {
    const auto known = std::ranges::lower_bound(points_, local.ref, {}, &MeshPoint::id);
    if (known == points_.end() || known->id != local.ref) return;
    const auto index = index_of_points_[std::size_t(known - points_.begin())];
    if (index != CreaseGraph::kNone) match(v, index);
    return;
  }
  const auto index = graph_.add(local.point.position, tolerance());
  if (!index) return;
  local_.push_back(kInfiniteVertex);
  match(v, *index);
  balls_->add({graph_.point(*index), *index});
  radius_.push_back(graph_.ball_radius(*index));
  largest_radius_ = std::max(largest_radius_, radius_.back());
  std::vector<CreaseGraph::Neighbor> around;
  graph_.neighbors(*index, around);
  for (const auto& [point, along, heading] : around)
    if (point != CreaseGraph::kNone) radius_[point] = graph_.ball_radius(point);
}

void LeafCreases::segments(LocalIndex v, std::vector<Segment>& out) const {
  out.clear();
  const CreaseGraph::Index index = index_of(v);
  if (index == CreaseGraph::kNone) return;
  graph_.neighbors(index, neighbors_);
  for (const CreaseGraph::Neighbor& next : neighbors_)
    if (next.point != CreaseGraph::kNone && next.point != index &&
        local_[next.point] != kInfiniteVertex)
      out.push_back({v, local_[next.point], next});
}

Point LeafCreases::halved(const Segment& segment, const std::optional<Point>& q) const {
  constexpr double kLeast = 0.3;  // of the way, from an end
  const double length = segment.way.along;
  double best = 0.5 * length;
  if (q) {
    double least = std::numeric_limits<double>::infinity();
    graph_.for_each_part(segment.way.heading, length,
                         [&](const Point& a, const Point& b, double along) {
                           const Point foot = closest_on_segment(a, b, *q);
                           const double d = squared_distance(foot, *q);
                           if (d < least) least = d, best = along + norm(foot - a);
                         });
    if (best < kLeast * length || best > (1 - kLeast) * length) best = 0.5 * length;
  }
  if (const auto along = as_far_as_others(segment))
    if (*along > kLeast * length && *along < (1 - kLeast) * length) best = *along;
  return graph_.position_along(segment.way.heading, best);
}

std::optional<double> LeafCreases::as_far_as_others(const Segment& segment) const {
  std::optional<double> along;
  for (const bool is_at_a : {true, false}) {
    const CreaseGraph::Index corner = index_of(is_at_a ? segment.a : segment.b),
                             beyond = index_of(is_at_a ? segment.b : segment.a);
    const Point &p = graph_.point(corner), way = graph_.point(beyond) - p;
    graph_.neighbors(corner, neighbors_);
    if (neighbors_.size() < 3) continue;
    double least = std::numeric_limits<double>::infinity();
    for (const CreaseGraph::Neighbor& next : neighbors_) {
      if (next.point == CreaseGraph::kNone || next.point == beyond) continue;
      const Point other = graph_.point(next.point) - p;
      if (dot(way, other) > kAcuteCorner * norm(way) * norm(other))
        least = std::min(least, next.along);
    }
    if (least < segment.way.along) along = is_at_a ? least : segment.way.along - least;
  }
  return along;
}

double LeafCreases::angle(const Segment& segment) const {
  const CreaseEdge& edge = graph_.edges()[segment.way.heading.from.edge];
  const std::vector<EdgeSide> sides =
      sides_of(domain_, edge, mesh_.local(segment.a).point.position, 2 * tolerance());
  double least = std::numbers::pi;
  for (std::size_t i = 0; i < sides.size(); ++i)
    for (std::size_t j = i + 1; j < sides.size(); ++j)
      least = std::min(least, std::acos(std::clamp(dot(sides[i].way, sides[j].way), -1.0, 1.0)));
  return least;
}

std::optional<std::array<CreaseGraph::Neighbor, 2>> LeafCreases::ways_to_slide(LocalIndex v) const {
  const CreaseGraph::Index index = index_of(v);
  if (index == CreaseGraph::kNone) return std::nullopt;
  const CreaseGraph::Place& place = graph_.place(index);
  const bool is_last = place.along >= graph_.length(place.edge);
  if ((is_last || place.along <= 0) && graph_.is_fixed(graph_.ends(place.edge)[is_last]))
    return std::nullopt;
  graph_.neighbors(index, neighbors_);
  const auto is_known = [&](const CreaseGraph::Neighbor& next) {
    return next.point != CreaseGraph::kNone && next.point != index &&
           local_[next.point] != kInfiniteVertex;
  };
  if (neighbors_.size() != 2 || !std::ranges::all_of(neighbors_, is_known)) return std::nullopt;
  return std::array{neighbors_[0], neighbors_[1]};
}

void LeafCreases::append_places_along(LocalIndex v, std::span<const double> parts,
                                      std::vector<Point>& out) const {
  const auto ways = ways_to_slide(v);
  if (!ways) return;
  const double step = std::min((*ways)[0].along, (*ways)[1].along);
  for (const double part : parts)
    for (const CreaseGraph::Neighbor& way : *ways)
      out.push_back(graph_.position_along(way.heading, part * step));
}

void LeafCreases::append_place_towards(LocalIndex v, const Point& shift,
                                       std::vector<Point>& out) const {
  const auto ways = ways_to_slide(v);
  if (!ways) return;
  for (const CreaseGraph::Neighbor& way : *ways) {
    const double length = norm(shift);
    const Point step = graph_.position_along(way.heading, length) - mesh_.local(v).point.position;
    const double along = dot(step, shift) / length;
    if (along > 0 && along < way.along) out.push_back(graph_.position_along(way.heading, along));
  }
}

bool LeafCreases::may_slide(LocalIndex v, const Point& q, double most_step) const {
  const auto place = graph_.place_of(q, tolerance());
  const auto ways = ways_to_slide(v);
  if (!place || !ways) return false;
  std::vector<SheetId> there;
  graph_.sheets(*place, there);
  if (!std::ranges::equal(there, sheets(v))) return false;
  const auto headings = graph_.headings(*place);
  if (headings.size() != 2) return false;
  std::array<CreaseGraph::Neighbor, 2> to{graph_.neighbor(headings[0]),
                                          graph_.neighbor(headings[1])};
  if (to[1].point == index_of(v)) std::swap(to[0], to[1]);  // past where it is now
  const bool is_first = (*ways)[0].point != to[1].point;
  if (to[0].point != index_of(v) || (*ways)[is_first].point != to[1].point) return false;
  const CreaseGraph::Neighbor& on = (*ways)[!is_first];
  to[0].point = on.point;
  to[0].along += on.along;
  constexpr double kMost = kMostTurn * std::numbers::pi / 180;
  return std::ranges::all_of(to,
                             [&](const CreaseGraph::Neighbor& way) {
                               return squared_distance(q, graph_.point(way.point)) <=
                                          most_step * most_step &&
                                      graph_.turn(way.heading, way.along) <= kMost;
                             }) &&
         !segment_at(q, v);
}

std::array<LocalIndex, 2> LeafCreases::neighbors_of(LocalIndex v) const {
  const auto ways = ways_to_slide(v);
  assert(ways);
  return {local_[(*ways)[0].point], local_[(*ways)[1].point]};
}

void LeafCreases::slide(LocalIndex v) {
  const CreaseGraph::Index before = index_of(v);
  graph_.remove(before);
  local_[before] = kInfiniteVertex;
  radius_[before] = 0;
  add(v);
}

std::size_t LeafCreases::num_sides(const Segment& segment) const {
  const CreaseGraph::Edge edge = segment.way.heading.from.edge;
  num_sides_.resize(graph_.edges().size());
  if (num_sides_[edge] > 0) return num_sides_[edge] - 1;
  std::size_t num = 0;
  for_each_at_edge(domain_, graph_.edges()[edge], mesh_.local(segment.a).point.position,
                   2 * tolerance(), [&](const Triangle&, const Point&) { ++num; });
  if (num > 0) num_sides_[edge] = num + 1;
  return num;
}

bool LeafCreases::is_in_ball(const Point& q) const {
  return !balls_->for_each_around(q, largest_radius_, [&](const Ball& ball) {
    const double radius = radius_[ball.index];
    return squared_distance(q, ball.position) >= radius * radius;
  });
}

// Each lies in the balls around the ends.
std::optional<LeafCreases::Segment> LeafCreases::segment_at(const Point& q,
                                                            LocalIndex but_at) const {
  const CreaseGraph::Index but = but_at == kInfiniteVertex ? CreaseGraph::kNone : index_of(but_at);
  std::optional<Segment> deepest;
  double least = 1;  // squared distance over squared radius
  balls_->for_each_around(q, largest_radius_, [&](const Ball& ball) {
    const double radius = radius_[ball.index];
    if (squared_distance(q, ball.position) >= radius * radius || ball.index == but) return true;
    graph_.neighbors(ball.index, neighbors_);
    for (const CreaseGraph::Neighbor& next : neighbors_) {
      if (next.point == CreaseGraph::kNone || next.point == ball.index || next.point == but)
        continue;
      const Point& other = graph_.point(next.point);
      const double depth = 4 * squared_distance(q, 0.5 * (ball.position + other)) /
                           squared_distance(ball.position, other);
      if (depth >= least) continue;
      least = depth;
      deepest = {local_[ball.index], local_[next.point], next};
    }
    return true;
  });
  return deepest;
}

std::span<const SheetId> LeafCreases::sheets(LocalIndex v) const {
  if (sheets_.size() <= v) sheets_.resize(mesh_.num_locals());
  std::vector<SheetId>& known = sheets_[v];
  if (!known.empty()) return known;
  if (const CreaseGraph::Index index = index_of(v); index != CreaseGraph::kNone)
    graph_.sheets(index, known);
  else if (const auto closest = domain_.closest_to(mesh_.local(v).point.position, size_))
    known = {closest->side.sheet};
  return known;
}

bool LeafCreases::are_facing(const Point& a, const Point& b) const {
  const auto one = domain_.closest_to(a, size_), other = domain_.closest_to(b, size_);
  return one && other && dot(one->side.normal, other->side.normal) < 0;
}

bool LeafCreases::have_common_sheet(LocalIndex a, LocalIndex b) const {
  sheets(a), sheets(b);
  const std::vector<SheetId>&one = sheets_[a], &other = sheets_[b];
  return std::ranges::any_of(one, [&](SheetId s) { return std::ranges::binary_search(other, s); });
}

bool LeafCreases::have_common_sheet(LocalIndex a, LocalIndex b, LocalIndex c) const {
  sheets(a), sheets(b), sheets(c);
  return std::ranges::any_of(sheets_[a], [&](SheetId s) {
    return std::ranges::binary_search(sheets_[b], s) && std::ranges::binary_search(sheets_[c], s);
  });
}

bool LeafCreases::is_exempt(const std::array<LocalIndex, 4>& vertices,
                            const std::array<Point, 4>& corners) const {
  std::size_t a = 0, b = 1;
  double least = squared_distance(corners[0], corners[1]);
  for (std::size_t i = 0; i < 4; ++i)
    for (std::size_t j = std::max<std::size_t>(i + 1, 2); j < 4; ++j)
      if (const double d = squared_distance(corners[i], corners[j]); d < least)
        least = d, a = i, b = j;
  const LocalIndex one = vertices[a], other = vertices[b];
  if (one >= mesh_.num_locals() || other >= mesh_.num_locals()) return false;
  const PointKind kind = mesh_.local(one).point.kind, kind_of_other = mesh_.local(other).point.kind;
  if (!is_on_surface(kind) || !is_on_surface(kind_of_other)) return false;
  if (!have_common_sheet(one, other)) return true;
  const bool is_on_crease = kind == PointKind::kCrease,
             is_other_on_crease = kind_of_other == PointKind::kCrease;
  if (is_on_crease && is_other_on_crease) return !is_neighbor(one, other);
  return !is_on_crease && !is_other_on_crease && are_facing(corners[a], corners[b]);
}

std::optional<std::array<Point, 4>> LeafCreases::normals(
    const std::array<LocalIndex, 4>& vertices, const std::array<Point, 4>& corners) const {
  std::array<Point, 4> normals;
  for (std::size_t i = 0; i < 4; ++i) {
    const PointKind kind = mesh_.local(vertices[i]).point.kind;
    if (!is_on_surface(kind)) return std::nullopt;
    if (kind == PointKind::kCrease) continue;
    if (const auto closest = domain_.closest_to(corners[i], size_))
      normals[i] = (1 / norm(closest->side.normal)) * closest->side.normal;
  }
  return normals;
}

bool LeafCreases::is_neighbor(LocalIndex a, LocalIndex b) const {
  const CreaseGraph::Index one = index_of(a), other = index_of(b);
  if (one == CreaseGraph::kNone || other == CreaseGraph::kNone) return false;
  graph_.neighbors(one, neighbors_);
  return std::ranges::any_of(neighbors_, [&](const auto& n) { return n.point == other; });
}

}  // namespace locvol
