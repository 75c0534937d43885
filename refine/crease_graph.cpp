#include "refine/crease_graph.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <utility>

#include "octree/sort_and_unite.h"
#include "refine/edge_sides.h"

namespace locvol {

CreaseGraph::CreaseGraph(const LeafDomain& domain)
    : domain_(domain), edges_(domain.creases()), is_left_out_(edges_.size()) {
  positions_.reserve(2 * edges_.size());
  for (const CreaseEdge& e : edges_)
    positions_.insert(positions_.end(), e.ends.begin(), e.ends.end());
  sort_and_unite(positions_);
  one_of_.resize(positions_.size());
  std::iota(one_of_.begin(), one_of_.end(), Vertex{0});
  is_corner_.assign(positions_.size(), false);
  for (const CreaseEdge& e : edges_) {
    std::array<Vertex, 2> ends{};
    for (const std::size_t k : {0, 1}) {
      ends[k] = *vertex_at(e.ends[k]);
      if (e.is_corner[k]) is_corner_[ends[k]] = true;
    }
    ends_.push_back(ends);
    lengths_.push_back(norm(e.ends[1] - e.ends[0]));
  }
  list_edges();
  find_fixed();
  if (domain.crease_floor() > 0) join_close(domain.crease_floor());
  point_at_.assign(positions_.size(), kNone);
  on_edge_.resize(edges_.size());
}

// By the vertices that they end at.
void CreaseGraph::list_edges() {
  first_at_.assign(positions_.size() + 1, 0);
  for (Edge e = 0; e < edges_.size(); ++e)
    if (!is_left_out_[e])
      for (const Vertex v : ends_[e]) ++first_at_[v + 1];
  std::partial_sum(first_at_.begin(), first_at_.end(), first_at_.begin());
  at_vertex_.resize(first_at_.back());
  std::vector<std::uint32_t> next = first_at_;
  for (Edge e = 0; e < edges_.size(); ++e)
    if (!is_left_out_[e])
      for (const Vertex v : ends_[e]) at_vertex_[next[v]++] = e;
}

void CreaseGraph::find_fixed() {
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
}

void CreaseGraph::join_close(double floor) {
  is_first_.assign(positions_.size(), false);
  std::vector<Vertex> reached_from(positions_.size(), kNone);  // the last that it was
  for (const bool is_for_corners : {true, false})
    for (Vertex v = 0; v < positions_.size(); ++v)
      if (is_fixed_[v] && one_of_[v] == v && is_corner_[v] == is_for_corners)
        join_around(v, floor, reached_from);
  leave_out_short(3 * floor);
  for (Vertex v = 0; v < positions_.size(); ++v)
    if (one_of_[v] != v) is_corner_[v] = is_fixed_[v] = false;
  for (std::array<Vertex, 2>& ends : ends_)
    for (Vertex& v : ends) v = one_of_[v];
  list_edges();
  for (Vertex v = 0; v < positions_.size(); ++v)
    if (edges_at(v).empty()) is_corner_[v] = is_fixed_[v] = false;
}

// What is fixed, closer along creases, and not of another one becomes one with it.
void CreaseGraph::join_around(Vertex v, double floor, std::vector<Vertex>& reached_from) {
  is_first_[v] = true;
  reached_from[v] = v;
  std::vector<std::pair<double, Vertex>> reached = {{0, v}};
  for (std::size_t n = 0; n < reached.size(); ++n) {
    const auto [along, here] = reached[n];
    for (const Edge e : edges_at(here)) {
      const Vertex next = ends_[e][ends_[e][0] == here];
      const double to_next = along + lengths_[e];
      if (to_next >= floor || reached_from[next] == v) continue;
      reached_from[next] = v;
      reached.emplace_back(to_next, next);
      if (is_fixed_[next] && one_of_[next] == next && !is_first_[next]) one_of_[next] = v;
    }
  }
}

// Parts of creases that end where they begin, and closed creases.
void CreaseGraph::leave_out_short(double most) {
  for (Edge e = 0; e < edges_.size(); ++e)
    if (!is_left_out_[e] && lengths_[e] < most) leave_out_if_short(e, most);
}

// The part of a crease with this edge.
void CreaseGraph::leave_out_if_short(Edge start, double most) {
  std::vector<Edge> part = {start};
  double length = lengths_[start];
  std::array<Vertex, 2> ends = ends_[start];
  for (const std::size_t k : {0, 1}) {
    while (!is_fixed_[ends[k]] && edges_at(ends[k]).size() == 2 && length < most) {
      const auto edges = edges_at(ends[k]);
      const Edge last = k == 0 ? part.front() : part.back();
      const Edge next = edges[edges[0] == last];
      if (next == (k == 0 ? part.back() : part.front())) break;  // closed
      length += lengths_[next];
      part.insert(k == 0 ? part.begin() : part.end(), next);
      ends[k] = ends_[next][ends_[next][0] == ends[k]];
    }
  }
  if (length >= most || one_of_[ends[0]] != one_of_[ends[1]]) return;
  for (const Edge e : part) is_left_out_[e] = true;
}

std::optional<CreaseGraph::Vertex> CreaseGraph::vertex_at(const Point& p) const {
  const auto place = std::ranges::lower_bound(positions_, p);
  if (place == positions_.end() || *place != p) return std::nullopt;
  return one_of_[static_cast<std::size_t>(place - positions_.begin())];
}

Point CreaseGraph::position(const Place& place) const {
  const auto& [a, b] = edges_[place.edge].ends;
  return a + (place.along / lengths_[place.edge]) * (b - a);
}

std::optional<CreaseGraph::Place> CreaseGraph::place_of(const Point& p, double tolerance) const {
  if (const auto v = vertex_at(p)) {
    if (edges_at(*v).empty()) return std::nullopt;
    const Edge e = edges_at(*v).front();
    return Place{e, ends_[e][0] == *v ? 0 : lengths_[e]};
  }
  const auto closest = domain_.closest_on_crease(p, tolerance);
  if (!closest) return std::nullopt;
  const auto e = static_cast<Edge>(closest->edge);
  if (is_left_out_[e]) return std::nullopt;
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
  const auto v = vertex_of(place);
  if (!v) return {{place, true}, {place, false}};
  std::vector<Heading> all;
  for (const Edge e : edges_at(*v)) all.push_back(into(e, *v));
  return all;
}

std::optional<CreaseGraph::Index> CreaseGraph::add(const Point& p, double tolerance) {
  const auto place = place_of(p, tolerance);
  if (!place) return std::nullopt;
  const auto index = static_cast<Index>(points_.size());
  points_.push_back({p, *place});
  tolerance_ = std::max(tolerance_, tolerance);
  if (const auto v = vertex_of(*place)) {
    point_at_[*v] = index;
  } else {
    std::vector<Index>& there = on_edge_[place->edge];
    there.insert(std::ranges::upper_bound(there, place->along, {},
                                          [&](Index i) { return points_[i].place.along; }),
                 index);
  }
  return index;
}

void CreaseGraph::remove(Index i) {
  const Place& place = points_[i].place;
  if (const auto v = vertex_of(place))
    point_at_[*v] = kNone;
  else
    std::erase(on_edge_[place.edge], i);
}

bool CreaseGraph::has_point_at(const Place& place) const {
  if (const auto v = vertex_of(place)) return has_point_at(*v);
  return std::ranges::binary_search(on_edge_[place.edge], place.along, {},
                                    [&](Index i) { return points_[i].place.along; });
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

double CreaseGraph::turn(const Heading& start, double length) const {
  double sum = 0, along = 0;
  for (std::optional<Heading> heading = start; heading; heading = past(*heading)) {
    along += heading->left(*this);
    if (!(along < length)) break;
    sum += turns_[heading->next(*this)];
  }
  return sum;
}

void CreaseGraph::sheets(const Place& place, std::vector<SheetId>& out) const {
  out.clear();
  for (const Heading& heading : headings(place)) {
    const auto& sheets = edges_[heading.from.edge].sheets;
    out.insert(out.end(), sheets.begin(), sheets.end());
    if (!domain_.only_body())
      for_each_at_edge(domain_, edges_[heading.from.edge], position(place), 2 * tolerance_,
                       [&](const Triangle& t, const Point&) { out.push_back(t.sheet); });
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
