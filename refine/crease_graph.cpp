#include "refine/crease_graph.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include "octree/sort_and_unite.h"

namespace locvol {

CreaseGraph::CreaseGraph(const LeafDomain& domain) : domain_(domain), edges_(domain.creases()) {
  positions_.reserve(2 * edges_.size());
  for (const CreaseEdge& e : edges_)
    positions_.insert(positions_.end(), e.ends.begin(), e.ends.end());
  sort_and_unite(positions_);
  first_at_.assign(positions_.size() + 1, 0);
  is_corner_.assign(positions_.size(), false);
  for (const CreaseEdge& e : edges_) {
    std::array<Vertex, 2> ends{};
    for (const std::size_t k : {0, 1}) {
      ends[k] = *vertex_at(e.ends[k]);
      ++first_at_[ends[k] + 1];
      if (e.is_corner[k]) is_corner_[ends[k]] = true;
    }
    ends_.push_back(ends);
    lengths_.push_back(norm(e.ends[1] - e.ends[0]));
  }
  std::partial_sum(first_at_.begin(), first_at_.end(), first_at_.begin());
  at_vertex_.resize(2 * edges_.size());
  std::vector<std::uint32_t> next = first_at_;
  for (Edge e = 0; e < edges_.size(); ++e)
    for (const Vertex v : ends_[e]) at_vertex_[next[v]++] = e;

  turns_.assign(positions_.size(), 0);
  is_fixed_ = is_corner_;
  const double least_cosine = std::cos(kFixedTurn * std::numbers::pi / 180);
  for (Vertex v = 0; v < positions_.size(); ++v) {
    const auto edges = edges_at(v);
    if (edges.size() != 2 || is_corner_[v]) {
      if (edges.size() > 2) is_fixed_[v] = true;
      continue;
    }
    const auto way = [&](Edge e) {
      const Vertex other = ends_[e][ends_[e][0] == v];
      return (1 / lengths_[e]) * (positions_[other] - positions_[v]);
    };
    const double cosine = std::clamp(-dot(way(edges[0]), way(edges[1])), -1.0, 1.0);
    turns_[v] = std::acos(cosine);
    if (cosine < least_cosine) is_fixed_[v] = true;
  }
  point_at_.assign(positions_.size(), kNone);
  on_edge_.resize(edges_.size());
}

std::optional<CreaseGraph::Vertex> CreaseGraph::vertex_at(const Point& p) const {
  const auto place = std::ranges::lower_bound(positions_, p);
  if (place == positions_.end() || *place != p) return std::nullopt;
  return static_cast<Vertex>(place - positions_.begin());
}

Point CreaseGraph::position(const Place& place) const {
  const auto& [a, b] = edges_[place.edge].ends;
  return a + (place.along / lengths_[place.edge]) * (b - a);
}

std::optional<CreaseGraph::Place> CreaseGraph::place_of(const Point& p, double tolerance) const {
  if (const auto v = vertex_at(p)) {
    const Edge e = edges_at(*v).front();
    return Place{e, ends_[e][0] == *v ? 0 : lengths_[e]};
  }
  const auto closest = domain_.closest_on_crease(p, tolerance);
  if (!closest) return std::nullopt;
  const auto e = static_cast<Edge>(closest->edge);
  const auto& [a, b] = edges_[e].ends;
  return Place{e, std::clamp(dot(p - a, b - a) / lengths_[e], 0.0, lengths_[e])};
}

std::optional<CreaseGraph::Heading> CreaseGraph::past(const Heading& heading) const {
  const Vertex v = heading.next(*this);
  const auto edges = edges_at(v);
  if (is_corner_[v] || edges.size() != 2) return std::nullopt;
  return into(edges[edges[0] == heading.from.edge], v);
}

std::vector<CreaseGraph::Heading> CreaseGraph::headings(const Place& place) const {
  const bool is_first = place.along <= 0, is_last = place.along >= lengths_[place.edge];
  if (!is_first && !is_last) return {{place, true}, {place, false}};
  const Vertex v = ends_[place.edge][is_last];
  std::vector<Heading> all;
  for (const Edge e : edges_at(v)) all.push_back(into(e, v));
  return all;
}

std::optional<CreaseGraph::Index> CreaseGraph::add(const Point& p, double tolerance) {
  const auto place = place_of(p, tolerance);
  if (!place) return std::nullopt;
  const auto index = static_cast<Index>(points_.size());
  points_.push_back({p, *place});
  const double length = lengths_[place->edge];
  if (place->along <= 0 || place->along >= length) {
    point_at_[ends_[place->edge][place->along > 0]] = index;
  } else {
    std::vector<Index>& there = on_edge_[place->edge];
    there.insert(std::ranges::upper_bound(there, place->along, {},
                                          [&](Index i) { return points_[i].place.along; }),
                 index);
  }
  return index;
}

CreaseGraph::Index CreaseGraph::next_on_edge(const Heading& heading) const {
  const std::vector<Index>& there = on_edge_[heading.from.edge];
  const auto along = [&](Index i) { return points_[i].place.along; };
  if (heading.is_forward) {
    const auto next = std::ranges::upper_bound(there, heading.from.along, {}, along);
    return next == there.end() ? kNone : *next;
  }
  const auto next = std::ranges::lower_bound(there, heading.from.along, {}, along);
  return next == there.begin() ? kNone : *(next - 1);
}

CreaseGraph::Neighbor CreaseGraph::neighbor(const Heading& start) const {
  double along = 0;
  std::optional<Heading> heading = start;
  for (std::size_t n = 0; heading && n <= edges_.size(); ++n) {
    if (const Index next = next_on_edge(*heading); next != kNone)
      return {next, along + std::abs(points_[next].place.along - heading->from.along), start};
    along += heading->left(*this);
    if (const Index next = point_at_[heading->next(*this)]; next != kNone)
      return {next, along, start};
    heading = past(*heading);
  }
  return {kNone, along, start};
}

void CreaseGraph::neighbors(Index i, std::vector<Neighbor>& out) const {
  out.clear();
  for (const Heading& heading : headings(points_[i].place)) out.push_back(neighbor(heading));
}

void CreaseGraph::sheets(Index i, std::vector<SheetId>& out) const {
  out.clear();
  for (const Heading& heading : headings(points_[i].place)) {
    const auto& sheets = edges_[heading.from.edge].sheets;
    out.insert(out.end(), sheets.begin(), sheets.end());
  }
  sort_and_unite(out);
}

double CreaseGraph::ball_radius(Index i) const {
  neighbors(i, neighbors_);
  double squared = 0;
  for (const Neighbor& n : neighbors_)
    if (n.point != kNone)
      squared = std::max(squared, squared_distance(points_[i].position, points_[n.point].position));
  return kCreaseBall * std::sqrt(squared);
}

}  // namespace locvol
