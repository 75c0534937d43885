#include "refine/vertex_move.h"

#include <algorithm>
#include <utility>

#include "refine/cell_shape.h"
#include "refine/circumcenter.h"
#include "refine/conditions.h"
#include "refine/domain/exact_predicates.h"

namespace locvol {
namespace {

bool is_same_facet(const std::array<Delaunay::Vertex, 3>& a,
                   const std::array<Delaunay::Vertex, 3>& b) {
  if ((a[0] ^ a[1] ^ a[2]) != (b[0] ^ b[1] ^ b[2])) return false;  // most are not
  return std::ranges::all_of(
      a, [&](Delaunay::Vertex v) { return v == b[0] || v == b[1] || v == b[2]; });
}

}  // namespace

void VertexMove::begin(Vertex v) {
  vertex_ = v;
  star_.clear();
  link_.clear();
  hole_.clear();
  hole_cosines_.clear();
  rim_.clear();
  open_.clear();
  ++star_stamp_;
  if (marks_.size() < delaunay_.cell_bound()) marks_.resize(delaunay_.cell_bound());
  if (on_border_.size() <= delaunay_.num_vertices())
    on_border_.resize(delaunay_.num_vertices() + 1);
}

bool VertexMove::take_out(Vertex v) {
  begin(v);
  delaunay_.cells_around(v, star_);
  if (star_.size() > kMaxFacets) return false;
  ++border_stamp_;
  num_on_border_ = 0;
  for (const Cell c : star_) {
    if (delaunay_.is_infinite(c)) return false;
    marks_[c].star = star_stamp_;
    const int at = delaunay_.index_of(c, v);
    Open facet;
    facet.corner = facet_of(delaunay_.vertices(c), at);
    for (const Vertex w : facet.corner)
      if (place_on_border(w) == link_.size()) link_.push_back(w);
    facet.beyond = delaunay_.neighbor(c, at);
    facet.index = delaunay_.index_of_neighbor(facet.beyond, c);
    open_.push_back(facet);
  }
  heights_.resize((link_.size() + kLanes - 1) / kLanes);
  for (std::vector<Lanes>& along : link_points_)
    along.assign(heights_.size(), Lanes{} + std::numeric_limits<double>::quiet_NaN());
  for (std::size_t n = 0; n < link_.size(); ++n) {
    const Point& p = point(link_[n]);
    link_points_[0][n / kLanes][n % kLanes] = p.x;
    link_points_[1][n / kLanes][n % kLanes] = p.y;
    link_points_[2][n / kLanes][n % kLanes] = p.z;
  }
  return fill_hole();
}

// Each open facet gets the cell whose ball has no neighbor of the vertex in it, until none is open.
bool VertexMove::fill_hole() {
  while (!open_.empty()) {
    if (hole_.size() > 2 * kMaxFacets) return false;
    const Open facet = open_.back();
    open_.pop_back();
    const Vertex off = apex(facet);
    if (off == Delaunay::kNone) return false;
    const auto h = static_cast<std::uint32_t>(hole_.size());
    NewCell& cell = hole_.emplace_back();
    cell.vertex = {facet.corner[0], facet.corner[1], facet.corner[2], off};
    cell.neighbor[3] = facet.beyond;
    cell.way = way_to_center(point(cell.vertex[0]) - point(off), point(cell.vertex[1]) - point(off),
                             point(cell.vertex[2]) - point(off));
    const auto meet = [&](const Open& other) {
      if (other.beyond & kNew)
        hole_[other.beyond & ~kNew].neighbor[std::size_t(other.index)] = kNew | h;
      else
        rim_.push_back({other.beyond, other.index, h});
    };
    meet(facet);
    for (std::size_t i = 0; i < 3; ++i) {
      const auto corner = facet_of(cell.vertex, int(i));
      const Open next{{corner[0], corner[2], corner[1]}, kNew | h, int(i)};
      const auto other = std::ranges::find_if(
          open_, [&](const Open& o) { return is_same_facet(o.corner, next.corner); });
      if (other == open_.end()) {
        open_.push_back(next);
        continue;
      }
      cell.neighbor[i] = other->beyond;
      meet(*other);
      *other = open_.back();
      open_.pop_back();
    }
  }
  return true;
}

// Of all spheres through the facet's corners, the first that meets a neighbor on the open side, as
// its center comes along the axis from beyond.
VertexMove::Vertex VertexMove::apex(const Open& facet) {
  const auto& [i, j, k] = facet.corner;
  const Point &p = point(i), a = point(j) - p, b = point(k) - p;
  const Point normal = cross(a, b);
  const double n2 = dot(normal, normal), a2 = dot(a, a), b2 = dot(b, b);
  const Point center = 0.5 / n2 * (a2 * cross(b, normal) + b2 * cross(normal, a));
  // Of all at once, without branches.
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  for (std::size_t n = 0; n < heights_.size(); ++n) {
    const Lanes x = link_points_[0][n] - p.x, y = link_points_[1][n] - p.y,
                z = link_points_[2][n] - p.z;
    const Lanes off = normal.x * x + normal.y * y + normal.z * z;
    const Lanes to_center = center.x * x + center.y * y + center.z * z;
    const Lanes height = (x * x + y * y + z * z - 2 * to_center) / off;
    heights_[n] = off > 0 ? height : Lanes{} + kInfinity;
  }
  Vertex best = Delaunay::kNone;
  double least = kInfinity;
  for (std::size_t n = 0; n < link_.size(); ++n) {
    const double height = heights_[n / kLanes][n % kLanes];
    if (!(height < least)) continue;
    const Vertex v = link_[n];
    if (v == i || v == j || v == k) continue;
    best = v;
    least = height;
  }
  if (best == Delaunay::kNone) return exact_apex(facet);
  const NewCell cell{
      {i, j, k, best},
      {},
      way_to_center(p - point(best), point(j) - point(best), point(k) - point(best))};
  return is_delaunay(cell) ? best : exact_apex(facet);
}

// Is it certain that none of the neighbors is in its ball, and that it is positively oriented?
bool VertexMove::is_delaunay(const NewCell& cell) const {
  if (!cell.way.is_known()) return false;
  const Point& corner = point(cell.vertex[3]);
  return std::ranges::all_of(link_, [&](Vertex v) {
    if (std::ranges::find(cell.vertex, v) != cell.vertex.end()) return true;
    const auto is_inside = is_in_ball(cell.way, corner, point(v));
    return is_inside ? !*is_inside : !delaunay_.is_in_circumball(corners(cell), point(v));
  });
}

VertexMove::Vertex VertexMove::exact_apex(const Open& facet) const {
  const auto& [i, j, k] = facet.corner;
  Vertex best = Delaunay::kNone;
  for (const Vertex v : link_) {
    if (v == i || v == j || v == k) continue;
    if (orientation(point(i), point(j), point(k), point(v)) <= 0) continue;
    if (best == Delaunay::kNone ||
        delaunay_.is_in_circumball({point(i), point(j), point(k), point(best)}, point(v)))
      best = v;
  }
  return best;
}

// Where a vertex is, there is no place for another: it would be in conflict with no cell, and a
// cell that has both has no ball. A vertex further away is in no ball that is asked here.
bool VertexMove::is_any_at(std::span<const Vertex> vertices, const Point& q) const {
  return std::ranges::any_of(vertices,
                             [&](Vertex v) { return v != Delaunay::kInfinite && point(v) == q; });
}

bool VertexMove::is_in_conflict(std::uint32_t cell, const Point& q) const {
  if ((cell & kNew) == 0) return delaunay_.is_in_conflict(cell, q);
  const NewCell& of_hole = hole_[cell & ~kNew];
  const auto is_inside = is_in_ball(of_hole.way, point(of_hole.vertex[3]), q);
  return is_inside ? *is_inside : delaunay_.is_in_circumball(corners(of_hole), q);
}

std::uint32_t VertexMove::beyond(std::uint32_t cell, int index) const {
  if (cell & kNew) return hole_[cell & ~kNew].neighbor[std::size_t(index)];
  const Cell next = delaunay_.neighbor(cell, index);
  if (marks_[next].star != star_stamp_ || star_.empty()) return next;
  return kNew | std::ranges::find_if(rim_, [&](const Rim& r) {
                  return r.outer == cell && r.index == index;
                })->inner;
}

VertexMove::Seen& VertexMove::seen(std::uint32_t cell) {
  if (cell & kNew) return seen_in_hole_[cell & ~kNew];
  Mark& mark = marks_[cell];
  if (std::exchange(mark.place, place_stamp_) != place_stamp_) mark.seen = Seen::kNot;
  return mark.seen;
}

bool VertexMove::find(const Point& q, const Limits& limits, Change& change) {
  if (is_any_at(link_, q)) return false;
  ++place_stamp_;
  seen_in_hole_.assign(hole_.size(), Seen::kNot);
  inside_.clear();
  for (std::uint32_t h = 0; h < hole_.size() && inside_.empty(); ++h)
    if (is_in_conflict(kNew | h, q))
      inside_.push_back(kNew | h);
    else
      seen_in_hole_[h] = Seen::kOutside;
  return !inside_.empty() && spread(q, limits) && make_cells(q, change);
}

bool VertexMove::find_insertion(const Point& q, Cell start, const Limits& limits, Change& change) {
  if (is_any_at(delaunay_.vertices(start), q) || !delaunay_.is_in_conflict(start, q)) return false;
  ++place_stamp_;
  seen_in_hole_.clear();
  inside_.assign(1, start);
  return spread(q, limits) && make_cells(q, change);
}

namespace {

// All but the angles.
bool is_too_large(const VertexMove::Limits& limits, const std::array<Point, 4>& corners,
                  const WayToCenter& way) {
  constexpr double kSlack = 1e-6;  // relative, of what is not known to the last bit
  const Point twice = way.is_known() ? way.vector() : Point{};
  const double squared_radius =
      way.is_known() ? 0.25 * (1 + kSlack) * (1 + kSlack) * dot(twice, twice)
                     : circumball(corners, std::numeric_limits<double>::infinity()).squared_radius;
  return !(squared_radius < limits.squared_radius) ||
         !is_round(squared_radius, corners, limits.radius_edge);
}

}  // namespace

// From the first cell in conflict to all of them, and their border. Shapes are asked first: they
// decide most often, and need only two cells to be known.
bool VertexMove::spread(const Point& q, const Limits& limits) {
  border_.clear();
  seen(inside_[0]) = Seen::kInside;
  for (std::size_t n = 0; n < inside_.size(); ++n) {
    const std::uint32_t here = inside_[n];
    for (int i = 0; i < 4; ++i) {
      const std::uint32_t next = beyond(here, i);
      Seen& known = seen(next);
      if (known == Seen::kNot) {
        known = is_in_conflict(next, q) ? Seen::kInside : Seen::kOutside;
        if (known == Seen::kInside) inside_.push_back(next);
      }
      if (known == Seen::kInside) continue;
      const auto corner = facet_of(vertices(here), i);
      if (std::ranges::find(corner, Delaunay::kInfinite) != corner.end()) return false;
      const Point &a = point(corner[0]), &b = point(corner[1]), &c = point(corner[2]);
      const WayToCenter way = way_to_center(a - q, b - q, c - q);
      if (limits.are_any() && is_too_large(limits, {a, b, c, q}, way)) return false;
      const double cosine = largest_cosine({a, b, c, q});
      if (limits.are_any() && cosine > limits.cosine) return false;
      border_.push_back({here, next, corner, way, cosine});
    }
    if (border_.size() > kMaxFacets) return false;
  }
  return true;
}

std::uint32_t VertexMove::place_on_border(Vertex v) {
  OnBorder& at = on_border_[v];
  if (std::exchange(at.stamp, border_stamp_) != border_stamp_) at.place = num_on_border_++;
  return at.place;
}

// One for each facet of the border, and what is left of the hole.
bool VertexMove::make_cells(const Point& q, Change& change) {
  change.vertex = vertex_;
  change.place = q;
  change.gone = star_;
  for (const std::uint32_t c : inside_)
    if ((c & kNew) == 0) change.gone.push_back(c);
  change.made.clear();
  cosines_.clear();
  if (hole_cosines_.empty())
    for (const NewCell& cell : hole_) hole_cosines_.push_back(largest_cosine(corners(cell)));
  ++border_stamp_;
  num_on_border_ = 0;
  for (std::size_t n = 0; n < border_.size(); ++n) {
    const auto& [a, b, c] = border_[n].corner;
    NewCell& cell = change.made.emplace_back();
    cell.vertex = {a, b, c, vertex_};
    cell.neighbor[3] = border_[n].beyond;
    cell.way = border_[n].way;
    cosines_.push_back(border_[n].cosine);
    const std::uint32_t i = place_on_border(a), j = place_on_border(b), k = place_on_border(c);
    if (num_on_border_ > kMaxVertices) return false;
    facet_at_edge_[i][j] = facet_at_edge_[j][k] = facet_at_edge_[k][i] =
        static_cast<std::uint8_t>(n);
  }
  if (2 * std::size_t{num_on_border_} != border_.size() + 4) return false;
  for (std::size_t n = 0; n < border_.size(); ++n) {
    const auto& [a, b, c] = border_[n].corner;
    const std::uint32_t i = on_border_[a].place, j = on_border_[b].place, k = on_border_[c].place;
    auto& neighbor = change.made[n].neighbor;
    neighbor[0] = kNew | facet_at_edge_[k][j];
    neighbor[1] = kNew | facet_at_edge_[i][k];
    neighbor[2] = kNew | facet_at_edge_[j][i];
  }
  // What stays of the hole comes after the cells at the place.
  std::uint32_t next = static_cast<std::uint32_t>(border_.size());
  std::vector<std::uint32_t> index(hole_.size());
  for (std::uint32_t h = 0; h < hole_.size(); ++h)
    if (seen_in_hole_[h] != Seen::kInside) index[h] = kNew | next++;
  for (std::uint32_t h = 0; h < hole_.size(); ++h) {
    if (seen_in_hole_[h] == Seen::kInside) continue;
    NewCell& cell = change.made.emplace_back(hole_[h]);
    cosines_.push_back(hole_cosines_[h]);
    for (std::uint32_t& beyond : cell.neighbor)
      if ((beyond & kNew) && seen_in_hole_[beyond & ~kNew] != Seen::kInside)
        beyond = index[beyond & ~kNew];
  }
  for (std::uint32_t n = 0; n < border_.size(); ++n) {
    const auto& [inside, beyond, corner, way, cosine] = border_[n];
    if ((beyond & kNew) == 0) continue;
    const std::uint32_t h = beyond & ~kNew;
    const auto& before = hole_[h].neighbor;
    std::size_t i = 0;
    while (before[i] != inside) ++i;
    change.made[n].neighbor[3] = index[h];
    change.made[index[h] & ~kNew].neighbor[i] = kNew | n;
  }
  return true;
}

}  // namespace locvol
