#include "refine/leaf_mesh.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cassert>
#include <cmath>
#include <iterator>
#include <utility>

#include "octree/morton_key.h"
#include "refine/circumcenter.h"

namespace locvol {
namespace {

// Half of the reach; where the reach is infinite, a radius at which every center is outside.
double far_radius_of(const Criteria& criteria, const LeafDomain& domain, const SizeField& sizes) {
  if (!sizes.is_uniform()) return 0.5 * kReach * sizes.largest();
  if (std::isfinite(criteria.reach)) return 0.5 * criteria.reach;
  const Box& region = domain.region();
  return 2 * norm(region.max - region.min);
}

// Whether two balls around the ends, without surface in them, cover the segment.
bool is_clear_between(const Point& a, const Point& b, double sum_of_radii) {
  return squared_distance(a, b) < sum_of_radii * sum_of_radii;
}

constexpr std::uint64_t kFenceId = std::numeric_limits<std::uint64_t>::max();

// Of the points: Morton order of the cells of a fine grid that they lie in.
std::vector<std::uint32_t> curve_order(std::span<const Point> points) {
  if (points.empty()) return {};
  Box box = Box::around(points[0]);
  for (const Point& p : points) box = box.joined(p);
  const Point sides = box.max - box.min;
  const double longest = std::max({sides.x, sides.y, sides.z});
  const auto cell = [&](double length) {
    constexpr std::uint32_t kLast = (std::uint32_t{1} << MortonKey::kMaxLevel) - 1;
    return longest > 0 ? static_cast<std::uint32_t>(kLast * (length / longest)) : 0;
  };
  std::vector<std::pair<MortonKey, std::uint32_t>> keyed;
  keyed.reserve(points.size());
  for (std::uint32_t i = 0; i < points.size(); ++i) {
    const Point p = points[i] - box.min;
    keyed.emplace_back(
        MortonKey::containing({cell(p.x), cell(p.y), cell(p.z)}, MortonKey::kMaxLevel), i);
  }
  std::ranges::sort(keyed);
  std::vector<std::uint32_t> order;
  order.reserve(points.size());
  for (const auto& [key, i] : keyed) order.push_back(i);
  return order;
}

bool has_edge_longer_than(double length, const std::array<Point, 3>& corners) {
  const auto& [a, b, c] = corners;
  return std::max({squared_distance(a, b), squared_distance(b, c), squared_distance(c, a)}) >
         length * length;
}

// Does it take an odd number of exchanges to sort them?
bool is_oddly_sorted(const std::array<Point, 3>& corners) {
  const auto& [a, b, c] = corners;
  return (a > b) != ((b > c) != (a > c));
}

[[noreturn]] void throw_coincident(std::vector<Point> points) {
  std::ranges::sort(points);
  const auto place = std::ranges::adjacent_find(points);
  const Point p = place == points.end() ? Point{} : *place;
  throw RefineError(
      fmt::format("two points of the mesh have the same coordinates ({}, {}, {})", p.x, p.y, p.z));
}

// Points around all that is loaded, so far away that no ball that counts has one in it: balls at
// own points reach as far as the reach, and those below λ with an inserted point in them λ farther.
// Without them a plane sheet's samples make flat cells on its outside, by the rounding of their
// coordinates: what falls into their balls, nearly half-spaces, takes exact arithmetic. The
// distances differ, lest cells at them be cospherical.
std::array<Point, 8> fence_around(const Box& leaf, double reach) {
  std::array<Point, 8> fence;
  for (std::size_t k = 0; k < 8; ++k)
    for (int axis = 0; axis < 3; ++axis) {
      const double away = (2 + 0.03 * double((5 * k + 3 * std::size_t(axis)) % 8)) * reach;
      fence[k][axis] = k >> axis & 1 ? leaf.max[axis] + away : leaf.min[axis] - away;
    }
  return fence;
}

// Whether a far cell's circumcenter lies on the cell's side of its facet: where the vertex off the
// facet (null: infinite) is outside the facet's smallest circumball. Flat cells of nearly
// cocircular points are far, and rounding would take some for others.
bool leads_past(const Point* off, const std::array<Point, 3>& corners) {
  return off == nullptr || is_outside_smallest_ball(corners, *off);
}

}  // namespace

// The reach of the leaf's box is farther than that of its points: a third of the ghosts is out of
// it, and left out, until a point is inserted near them.
LeafMesh::LeafMesh(const LeafInput& input, const Surroundings& around, OwnPoints own)
    : input_(input),
      surroundings_(around),
      far_radius_(far_radius_of(input.criteria, around.domain, around.sizes)),
      is_around_(own == OwnPoints::kInBox) {
  const double reach = input.criteria.reach;
  std::optional<PointCubes> own_cubes;
  // A part without C7 is given nothing out of its points' reach.
  if (std::isfinite(reach) && (is_around_ || input.criteria.min_dihedral > 0)) {
    std::vector<Point> positions;
    positions.reserve(input.own.size());
    for (const MeshPoint& p : input.own) positions.push_back(p.position);
    constexpr double kMostCubes = 128;  // in a row
    own_cubes.emplace(input.box, reach, kMostCubes, positions);
  }
  std::vector<Local> locals;
  locals.reserve(input.own.size() + input.ghosts.size());
  for (const MeshPoint& p : input.own) locals.push_back({p, p.id, true});
  // C7 looks at cells whose circumcenters lie in the leaf, too: their balls reach half as far from
  // these as from their other points.
  const bool has_centers = is_around_ && input.criteria.min_dihedral > 0;
  const auto is_near_centers = [&](const Point& p) {
    const double distance = 0.5 * around.sizes.reach_of_balls(p, kNeighborhood);
    return has_centers && input.box.squared_distance(p) < distance * distance;
  };
  for (const MeshPoint& p : input.ghosts) {
    const bool is_own_one = own == OwnPoints::kInBox && is_in_leaf(input.box, p.position);
    const double reach_of_p = reach_at(p.position);
    if (!is_own_one && own_cubes && own_cubes->is_free(p.position, reach_of_p) &&
        !is_near_centers(p.position))
      left_out_.push_back({p, reach_of_p});
    else
      locals.push_back({p, p.id, is_own_one});
  }
  constexpr std::size_t kLeastFenced = 10;  // fewer may be all in a plane: no cells of theirs yet
  if (std::isfinite(reach) && locals.size() >= kLeastFenced)
    for (const Point& p : fence_around(
             input.box, around.sizes.is_uniform()
                            ? reach
                            : reach_factor(around.sizes.growth(), kReach) * around.sizes.largest()))
      locals.push_back({{kFenceId, p, PointKind::kSurface}, kFenceId, false});
  add_to_triangulation(std::move(locals));
  if (!has_cells() && !left_out_.empty()) {
    locals.clear();
    for (const auto& [p, reach_of_p] : std::exchange(left_out_, {})) locals.push_back({p, p.id});
    add_to_triangulation(std::move(locals));
  }
  first_stamp_ = stamp_;
}

// Local points are numbered along a curve.
void LeafMesh::add_to_triangulation(std::vector<Local> locals) {
  std::vector<Point> points;
  points.reserve(locals.size());
  for (const Local& local : locals) points.push_back(local.point.position);
  const std::vector<std::uint32_t> order = curve_order(points);
  for (std::size_t i = 0; i < order.size(); ++i) {
    const Local& local = locals[order[i]];
    add_local(local.point, local.ref, local.is_own, local.is_core);
    points[i] = local.point.position;
  }
  if (!delaunay_.build(points, surroundings_.stop)) throw_coincident(std::move(points));
  make_all_fresh();
}

void LeafMesh::add_local(const MeshPoint& p, VertexRef ref, bool is_own, bool is_core) {
  const bool at_core = is_at_core(p, is_own);
  locals_.push_back({p, ref, is_own, is_core, at_core});
  marks_.push_back({is_own, is_hidden(p), locvol::is_on_surface(p.kind), at_core});
  num_own_ += is_own;
}

// Samples hide a point from the surface if each point of that is closer to one of them. Lattice
// points all are (cover_leaf). Of a volume point only what is certain: that no surface is as close
// as samples are to all of it.
bool LeafMesh::is_hidden(const MeshPoint& p) const {
  if (locvol::is_on_surface(p.kind) || !std::isfinite(input_.criteria.cover_radius)) return false;
  if (p.kind == PointKind::kLattice) return true;
  const double radius = cover_radius_from(p.position);
  const Box around = Box::around(p.position).expanded(radius);
  const Box& region = surroundings_.domain.region();
  return region.contains(around.min) && region.contains(around.max) &&
         !surroundings_.domain.is_near(p.position, radius);
}

// Of a ghost, neighbors may lie farther away than the core is known.
bool LeafMesh::is_at_core(const MeshPoint& p, bool is_own) const {
  if (!has_site(p) || surroundings_.core == nullptr) return false;
  if (!is_own) return true;
  const LatticeSite site = site_of(p.id);
  return std::ranges::any_of(kLatticeNeighbors, [&](const LatticeSite& step) {
    return surroundings_.core->contains(site + step);
  });
}

// Of a ball without local points in it. A center that is closer to a core point than to all others
// lies in its Voronoi cell, which is the lattice's, and none but neighbors of that point are within
// kLatticeCircumradius of the cell's corners: so others, and with them the radius, exceed the
// distance by more than rounding, in squares by 0.0014 of the size's and more.
bool LeafMesh::has_core_point(const Point& center, double squared_radius) const {
  if (surroundings_.core == nullptr) return false;
  const double size = surroundings_.core->size();
  const double least = squared_radius - 0.0007 * size * size;
  return least > 0 && surroundings_.core->has_within(
                          center, std::min(std::sqrt(least), kLatticeCircumradius * size));
}

// All marks at once, each in a byte of its own: bit i is vertex i's.
CellState LeafMesh::fresh_state(const std::array<Marks, 4>& marks) {
  CellState state;
  std::uint32_t bits = 0;
  for (std::size_t i = 0; i < 4; ++i) bits |= std::bit_cast<std::uint32_t>(marks[i]) << i;
  const auto marked = std::bit_cast<std::array<std::uint8_t, 4>>(bits);
  state.own = marked[0] & 0b1111u, state.hidden = marked[1] & 0b1111u;
  state.on_surface = marked[2] & 0b1111u, state.at_core = marked[3] & 0b1111u;
  return state;
}

void LeafMesh::make_fresh(Cell c) {
  if (c >= states_.size()) {
    states_.resize(delaunay_.cell_bound());
    balls_.resize(delaunay_.cell_bound());
  }
  std::array<Marks, 4> marks;
  for (int i = 0; i < 4; ++i)
    if (const LocalIndex v = delaunay_.vertex(c, i); v != kInfiniteVertex)
      marks[std::size_t(i)] = marks_[v];
  CellState state = fresh_state(marks);
  state.stamp = ++stamp_;
  states_[c] = state;
  if (state.own != 0) fresh_.push_back({c, stamp_});
}

void LeafMesh::make_all_fresh() {
  states_.assign(delaunay_.cell_bound(), CellState{});
  balls_.resize(delaunay_.cell_bound());
  fresh_.clear();
  are_all_fresh_ = true;
  for (Cell c = 0; c < delaunay_.cell_bound(); ++c)
    if (delaunay_.is_cell(c)) make_fresh(c);
}

void LeafMesh::note_gone(Cell c) {
  if (has_own_vertex(c)) {
    const BodyId its = body(c);
    has_gone_others_ |= gone_body_.value_or(its) != its;
    gone_body_ = its;
  }
  states_[c].stamp = 0;
}

// If all cells that went and came are in one body, or in none, every facet is as it was.
bool LeafMesh::is_boundary_changed() const {
  if (!gone_body_ || has_gone_others_) return true;  // the first: only just built
  return std::ranges::any_of(fresh_, [&](const CellRef& fresh) {
    return is_alive(fresh) && body(fresh.cell) != *gone_body_;
  });
}

void LeafMesh::clear_fresh_cells() {
  fresh_.clear();
  are_all_fresh_ = false;
  gone_body_.reset();
  has_gone_others_ = false;
}

// A ball at an own vertex that is near has no point in it but of the core. So a hidden vertex is
// the nearest point to each place on the way from there to the center that may be on the surface,
// and no such place is: the center is in the same body. Where there are several, to look up the
// vertex takes as long as to look up the center.
//
// Only points that have neighbors in the core have other stars for want of it.
Side LeafMesh::find_side(const std::array<Point, 4>& corners, CellState& state,
                         CellBall& ball) const {
  state.side = Side::kFar;
  const Circumball circumball = locvol::circumball(corners, far_radius_);
  ball.center = circumball.center;
  ball.squared_radius = circumball.squared_radius;
  if (!(ball.squared_radius <= far_radius_ * far_radius_)) return state.side;
  if (!surroundings_.sizes.is_uniform() &&
      !surroundings_.sizes.is_below(ball.squared_radius, 0.5 * kReach, ball.center))
    return state.side;
  state.is_hollow = state.at_core == 0b1111 && has_core_point(ball.center, ball.squared_radius);
  if (const auto only = surroundings_.domain.only_body();
      only && state.own != 0 && state.hidden != 0)
    return state.side = side_in(*only);
  const LeafDomain::Location location = surroundings_.domain.locate(ball.center);
  if (!location.state)
    return state.side = is_deep(state, ball) ? side_of_deep(corners) : Side::kNotLoaded;
  ball.clearance = location.distance_bound;
  state.has_clearance = true;
  return state.side = side_in(location.state->body());
}

// All of the cell is in the body that each of its corners is in.
Side LeafMesh::side_of_deep(const std::array<Point, 4>& corners) const {
  if (const auto only = surroundings_.domain.only_body()) return side_in(*only);
  for (const Point& corner : corners)
    if (const auto label = surroundings_.domain.label(corner)) return side_in(*label);
  return Side::kNotLoaded;
}

BodyId LeafMesh::body_around(const Point& p) const {
  if (const auto only = surroundings_.domain.only_body()) return *only;
  return surroundings_.domain.label(p).value_or(kNoBody);
}

// Out of what is loaded, where cells are larger than on the surface: are all its corners so deep
// that no dual edge of the cell meets the surface?
bool LeafMesh::is_deep(CellState& state, CellBall& ball) const {
  if (surroundings_.sizes.is_uniform()) return false;
  ball.clearance = surroundings_.sizes.least_depth(ball.center);
  state.has_clearance = true;
  const double of_corners = ball.clearance - surroundings_.sizes.on_surface_at(ball.center);
  return of_corners > 0 && ball.squared_radius < of_corners * of_corners;
}

// Of a near cell's center.
double LeafMesh::clearance(CellState& state, CellBall& ball) const {
  if (!state.has_clearance) ball.clearance = surroundings_.domain.distance_bound(ball.center);
  state.has_clearance = true;
  return ball.clearance;
}

// Do balls around places on the axis that pass through the facet's corners come as small as count?
bool LeafMesh::is_axis_near(const Axis& axis) const {
  const double radius = far_radius_at(axis.center);
  return axis.squared_radius <= radius * radius;
}

Point LeafMesh::far_end(const Point& axis_center, const Point& direction,
                        double squared_circumradius) const {
  const auto end = [&](double radius) {
    const double t = std::sqrt(std::max(0.0, radius * radius - squared_circumradius));
    return axis_center + t * direction;
  };
  if (surroundings_.sizes.is_uniform()) return end(far_radius_);
  // Where the ball is as large as can be there: comes close in a few steps, for h changes slowly.
  Point p = end(far_radius_at(axis_center));
  for (int step = 0; step < 3; ++step) p = end(far_radius_at(p));
  return p;
}

// Whether the dual edge from `from` to `to` cannot meet the surface: around each of its points
// there is an empty ball that touches `corner`, and none around a point of the surface is that
// large. Where a part of the domain may end, or the mesh, the surface is asked all the same.
bool LeafMesh::is_off_surface(BodyId here, BodyId there, const Point& from, const Point& to,
                              const Point& corner) const {
  if (here != there) return false;
  const Point edge = to - from, offset = corner - from;
  const double length = dot(edge, edge);
  const double t = length > 0 ? std::clamp(dot(offset, edge) / length, 0.0, 1.0) : 0.0;
  const double radius = cover_radius_from(corner);
  return squared_distance(corner, from + t * edge) > radius * radius;
}

std::optional<LeafMesh::BoundaryFacet> LeafMesh::boundary_facet(Facet f) const {
  const Cell beyond = delaunay_.neighbor(f.cell, f.index);
  BodyId behind = body(f.cell), before = body(beyond);
  if (behind == before) return std::nullopt;
  if (behind < before) {
    f = {beyond, delaunay_.index_of_neighbor(beyond, f.cell)};
    std::swap(behind, before);
  }
  const auto& [a, b, c] = kFacetCorners[std::size_t(f.index)];
  const std::array vertices = {delaunay_.vertex(f.cell, a), delaunay_.vertex(f.cell, c),
                               delaunay_.vertex(f.cell, b)};
  const LocalIndex smallest =
      std::ranges::min(vertices, {}, [&](LocalIndex v) { return delaunay_.point(v); });
  return BoundaryFacet{vertices, smallest, behind, before};
}

FacetLabels LeafMesh::labels(const BoundaryFacet& facet) const {
  const auto& [a, b, c] = facet.vertices;
  return {facet.behind, facet.before,
          surroundings_.domain.sheet_of_facet(
              {delaunay_.point(a), delaunay_.point(b), delaunay_.point(c)}, facet.behind,
              facet.before)};
}

bool LeafMesh::is_between(LocalIndex v, const std::array<BodyId, 2>& bodies) const {
  if (surroundings_.domain.only_body()) return true;
  if (changes_.size() <= v) changes_.resize(locals_.size());
  if (changes_[v].empty())
    surroundings_.domain.changes_at(locals_[v].point.position, off_surface(), changes_[v]);
  return std::ranges::find(changes_[v], DomainState::between(bodies[0], bodies[1])) !=
         changes_[v].end();
}

bool LeafMesh::is_between(const Point& p, const std::array<BodyId, 2>& bodies) const {
  if (surroundings_.domain.only_body()) return true;
  std::vector<DomainState> changes;
  surroundings_.domain.changes_at(p, off_surface(), changes);
  return std::ranges::find(changes, DomainState::between(bodies[0], bodies[1])) != changes.end();
}

// What is not loaded counts as outside.
DomainState LeafMesh::state_at(const Point& p) const {
  return surroundings_.domain.state(p).value_or(DomainState());
}

// The dual edge runs between the circumcenters of the facet's two cells. Where one of them is far,
// the edge is cut on the facet's axis at the radius up to which balls are known to be empty.
DualCrossings LeafMesh::dual_crossings(Facet f) const {
  const Cell there = delaunay_.neighbor(f.cell, f.index);
  side(f.cell), side(there);
  if (is_hidden(f)) return {};
  std::array<Point, 3> corners;
  for (std::size_t k = 0; k < 3; ++k)
    corners[k] = point(f.cell, kFacetCorners[std::size_t(f.index)][k]);
  return dual_crossings(corners, at_facet(f),
                        at_facet({there, delaunay_.index_of_neighbor(there, f.cell)}),
                        has_hidden_own_vertex(f));
}

DualCrossings LeafMesh::dual_crossings(const std::array<Point, 3>& corners, const CellAtFacet& here,
                                       const CellAtFacet& there, bool is_past_surface) const {
  DualCrossings result;
  const Side side_here = here.state->side, side_there = there.state->side;
  const bool is_here_near = !is_far(side_here), is_there_near = !is_far(side_there);
  double clear = 0;
  if (!is_past_surface)
    clear = (is_here_near ? clearance(*here.state, *here.ball) : 0) +
            (is_there_near ? clearance(*there.state, *there.ball) : 0);
  Point from = here.ball->center, to = there.ball->center;
  if (is_here_near && is_there_near && is_clear_between(from, to, clear)) return result;
  if (!is_here_near && !is_there_near && has_edge_longer_than(2.001 * far_radius_, corners))
    return result;  // its circumcircle is too large for a near point of the axis
  if (!is_here_near || !is_there_near) {
    const Axis axis = axis_of(corners);
    // Two far ends on one side of the facet: the edge does not come near it.
    if (!is_here_near && !is_there_near &&
        !(is_axis_near(axis) && leads_past(here.off, corners) && leads_past(there.off, corners)))
      return result;
    // axis.direction is right-handed for the sorted corners; count the sort's parity to know on
    // which side of the facet it points.
    const Point outwards = is_oddly_sorted(corners) ? axis.direction : -1.0 * axis.direction;
    if (!is_here_near) from = far_end(axis.center, -1.0 * outwards, axis.squared_radius);
    if (!is_there_near) to = far_end(axis.center, outwards, axis.squared_radius);
    if (!is_here_near && !is_past_surface) clear += surroundings_.domain.distance_bound(from);
    if (!is_there_near && !is_past_surface) clear += surroundings_.domain.distance_bound(to);
  }
  if (is_past_surface || is_clear_between(from, to, clear) ||
      is_off_surface(body_at(side_here), body_at(side_there), from, to, corners[0]))
    crossings_.clear();
  else  // always in one direction, so that both cells see the same bits
    surroundings_.domain.crossings(std::min(from, to), std::max(from, to), crossings_);

  // The state is that of the cell here, where that is known, and changes on the way.
  const bool is_known = is_here_near || input_.criteria.is_surface_only;
  const DomainState at_from = is_known ? DomainState::in(body_at(side_here)) : state_at(from);
  const DomainState at_to = follow(at_from, crossings_);
  const Point& corner = *std::ranges::min_element(corners);
  follow(to < from ? at_to : at_from, crossings_,
         [&](const Crossing& c, BodyId before, BodyId after) {
           if (before == after) return;
           const double squared_radius = squared_distance(c.position, corner);
           if (result.count++ > 0 && squared_radius <= result.squared_radius) return;
           result.ball_center = c.position;
           result.squared_radius = squared_radius;
         });
  if (!is_there_near && at_to.body() != kNoBody)
    result.open_end = to;
  else if (!is_here_near && at_from.body() != kNoBody)
    result.open_end = from;
  if (!result.open_end) return result;
  result.open_radius = far_radius_at(*result.open_end);
  if (has_core_point(*result.open_end, result.open_radius * result.open_radius))
    result.open_end.reset();
  return result;
}

void LeafMesh::boundary_at(LocalIndex v, std::vector<Facet>& out) const {
  out.clear();
  delaunay_.cells_around(v, around_);
  for (const Cell c : around_) {
    if (!is_member(c)) continue;
    const int at = delaunay_.index_of(c, v);
    for (int i = 0; i < 4; ++i)
      if (i != at && is_behind(Facet{c, i})) out.push_back({c, i});
  }
}

Side LeafMesh::find_side(Cell c) const {
  CellState& state = states_[c];
  if (delaunay_.is_infinite(c))
    state.side = Side::kFar;
  else
    find_side(corners(c), state, balls_[c]);
  if (input_.criteria.is_surface_only && state.side == Side::kFar && state.own != 0)
    state.side = far_in(body_of_far(c));
  return state.side;
}

// Of a cell with an own vertex. Its circumcenter may be an artifact, but it lies beyond where a
// Voronoi edge, or the way there from an own vertex, is cut. From there to the circumcenter the
// closest points of P are the same, and farther than any is from the surface: so the place of the
// cut is in the body that the circumcenter is in.
BodyId LeafMesh::body_of_far(Cell c) const {
  for (int i = 0; i < 4; ++i)
    if (const Facet facet{c, i}; has_own_vertex(facet) && !delaunay_.is_infinite(facet))
      if (const auto place = far_place_by(facet)) return state_at(*place).body();
  const auto place = far_place(c);
  return place ? state_at(*place).body() : kNoBody;
}

// Whether a cell is far, before its body is asked for.
bool LeafMesh::is_far_away(Cell c) const {
  CellState& state = states_[c];
  if (state.side != Side::kUnknown) return is_far(state.side);
  if (delaunay_.is_infinite(c)) return true;
  CellState found = state;
  CellBall ball;
  if (is_far(find_side(corners(c), found, ball))) return true;
  state = found;
  balls_[c] = ball;
  return false;
}

// Where the facet's dual edge is cut on the side of its cell, which is far; null if it is not.
std::optional<Point> LeafMesh::far_place_by(Facet f) const {
  std::array<Point, 3> corners;
  for (std::size_t k = 0; k < 3; ++k)
    corners[k] = point(f.cell, kFacetCorners[std::size_t(f.index)][k]);
  if (has_edge_longer_than(2.001 * far_radius_, corners)) return std::nullopt;
  const Axis axis = axis_of(corners);
  if (!is_axis_near(axis) || !leads_past(at_facet(f).off, corners)) return std::nullopt;
  const Cell there = delaunay_.neighbor(f.cell, f.index);
  const Facet back{there, delaunay_.index_of_neighbor(there, f.cell)};
  if (is_far_away(there) && !leads_past(at_facet(back).off, corners)) return std::nullopt;
  const Point inwards = is_oddly_sorted(corners) ? -1.0 * axis.direction : axis.direction;
  return far_end(axis.center, inwards, axis.squared_radius);
}

// The same on the way from an own vertex, which is the closest point of P to all of that way. For
// well-shaped cells alone it is as good; flat ones need an exact circumcenter.
std::optional<Point> LeafMesh::far_place(Cell c) const {
  int own = 0;
  while ((states_[c].own >> own & 1) == 0) ++own;
  const Point& p = point(c, own);
  Point way;
  if (delaunay_.is_infinite(c)) {
    const int infinite = delaunay_.index_of(c, kInfiniteVertex);
    const auto& [i, j, k] = kFacetCorners[std::size_t(infinite)];
    // The corners turn counterclockwise seen from the infinite vertex.
    way = cross(point(c, j) - point(c, i), point(c, k) - point(c, i));
  } else {
    way = circumball(corners(c)).center - p;
  }
  const double length = norm(way);
  if (!(length > 0) || !std::isfinite(length)) return std::nullopt;
  return p + far_radius_at(p) / length * way;
}

LeafMesh::Prospect LeafMesh::appraise(const Delaunay::Change& change, std::size_t made,
                                      PointKind kind) const {
  const Marks moved{true, is_hidden({0, change.place, kind}), locvol::is_on_surface(kind), false};
  const Delaunay::NewCell& cell = change.made[made];
  std::array<Marks, 4> marks;
  for (std::size_t i = 0; i < 4; ++i)
    marks[i] = cell.vertex[i] == change.vertex ? moved : marks_[cell.vertex[i]];
  Prospect prospect{fresh_state(marks), {}};
  find_side(corners(change, cell), prospect.state, prospect.ball);
  return prospect;
}

std::array<Point, 4> LeafMesh::corners(const Delaunay::Change& change,
                                       const Delaunay::NewCell& cell) const {
  return {place(change, cell.vertex[0]), place(change, cell.vertex[1]),
          place(change, cell.vertex[2]), place(change, cell.vertex[3])};
}

CellView LeafMesh::view(const Delaunay::Change& change, const std::vector<Prospect>& prospects,
                        std::size_t cell) const {
  const CellBall& ball = prospects[cell].ball;
  return {ball.center, ball.squared_radius, corners(change, change.made[cell])};
}

FacetView LeafMesh::view(const Delaunay::Change& change, const std::vector<Prospect>& prospects,
                         std::size_t cell, int index) const {
  const Delaunay::NewCell& here = change.made[cell];
  const std::array<LocalIndex, 3> vertices = facet_of(here.vertex, index);
  std::array<Point, 3> corners;
  for (std::size_t k = 0; k < 3; ++k) corners[k] = place(change, vertices[k]);
  // The states are their caller's, who has more of them: what they learn here is lost.
  Prospect mine = prospects[cell], others;
  const CellAtFacet at_here{&mine.state, &mine.ball,
                            &place(change, here.vertex[std::size_t(index)])};
  const bool is_past_surface = has_vertex(mine.state.own & mine.state.hidden, {0, index});
  const std::uint32_t beyond = here.neighbor[std::size_t(index)];
  const std::size_t n = beyond & ~Delaunay::kNewCell;
  const bool is_new = n != beyond;
  const auto& other = is_new ? change.made[n].vertex : delaunay_.vertices(beyond);
  std::size_t off = 0;
  while (std::ranges::find(vertices, other[off]) != vertices.end()) ++off;
  if (is_new)
    others = prospects[n];
  else
    side(beyond);
  const CellAtFacet at_there =
      is_new ? CellAtFacet{&others.state, &others.ball, &place(change, other[off])}
             : at_facet({beyond, static_cast<int>(off)});
  return {dual_crossings(corners, at_here, at_there, is_past_surface),
          (mine.state.on_surface | 1 << index) == 0b1111};
}

void LeafMesh::find_conflict(const Point& q, Cell hint, Conflict& conflict) const {
  delaunay_.find_conflict(q, hint, conflict);
  conflict.nearest = conflict.coincident;
  conflict.squared_distance = 0;
  if (conflict.nearest != kInfiniteVertex) return;
  // The nearest point is a Delaunay neighbor of q, so it is a vertex of a cell in conflict.
  conflict.squared_distance = std::numeric_limits<double>::infinity();
  for (const Cell c : conflict.cells)
    for (const LocalIndex v : delaunay_.vertices(c)) {
      if (v == kInfiniteVertex) continue;
      const double d = squared_distance(delaunay_.point(v), q);
      if (d < conflict.squared_distance) {
        conflict.squared_distance = d;
        conflict.nearest = v;
      }
    }
}

// Own points of P are all there, but for those whose stars are not this visit's to see.
LocalIndex LeafMesh::insert(const MeshPoint& q, VertexRef ref, const Conflict& conflict) {
  if ((ref & kNewPoint) == 0) taken_in_.insert(ref);
  add_local(q, ref, (ref & kNewPoint) != 0 && is_in_leaf(input_.box, q.position));
  return insert_last_local(conflict);
}

LocalIndex LeafMesh::insert_core(const MeshPoint& q, const Conflict& conflict) {
  taken_in_.insert(q.id);
  add_local(q, q.id, false, true);
  return insert_last_local(conflict);
}

LocalIndex LeafMesh::insert_last_local(const Conflict& conflict) {
  are_all_fresh_ = false;
  for (const Cell c : conflict.cells) note_gone(c);
  const LocalIndex index = delaunay_.insert(locals_.back().point.position, conflict);
  for (const Cell c : delaunay_.new_cells()) make_fresh(c);
  return index;
}

LocalIndex LeafMesh::insert_first(const MeshPoint& q, VertexRef ref) {
  add_to_triangulation({{q, ref, is_in_leaf(input_.box, q.position)}});
  return static_cast<LocalIndex>(locals_.size() - 1);
}

void LeafMesh::remove(std::span<const LocalIndex> leaving) {
  are_all_fresh_ = false;
  for (const LocalIndex i : leaving) {
    delaunay_.cells_around(i, around_);
    for (const Cell c : around_)
      if (states_[c].stamp != 0) note_gone(c);
    locals_[i].is_alive = false;
    num_own_ -= locals_[i].is_own;
  }
  if (!delaunay_.remove(leaving)) return make_all_fresh();
  for (const Cell c : delaunay_.new_cells()) make_fresh(c);
}

void LeafMesh::move(const Delaunay::Change& change, PointKind kind, VertexRef ref) {
  are_all_fresh_ = false;
  for (const Cell c : change.gone) note_gone(c);
  Local& local = locals_[change.vertex];
  if (is_deletable(local.point.kind) && change.vertex < num_in_grid_)
    std::erase(volume_points_[grid_cell(local.point.position)], change.vertex);
  local.point = {ref, change.place, kind};
  local.ref = ref;
  local.is_at_core = false;
  if (change.vertex < changes_.size()) changes_[change.vertex].clear();
  marks_[change.vertex] = {true, is_hidden(local.point), locvol::is_on_surface(kind), false};
  if (is_deletable(kind) && change.vertex < num_in_grid_)
    volume_points_[grid_cell(change.place)].push_back(change.vertex);
  delaunay_.move(change);
  for (const Cell c : delaunay_.new_cells()) make_fresh(c);
}

void LeafMesh::insert(const Delaunay::Change& change, PointKind kind, VertexRef ref) {
  Conflict conflict;
  find_conflict(change.place, change.gone.front(), conflict);
  insert({ref, change.place, kind}, ref, conflict);
}

void LeafMesh::take_in_ghosts(const Point& q, Cell hint, std::vector<MeshPoint>& taken) {
  taken.clear();
  if (left_out_.empty()) return;
  if (is_around_ && surroundings_.sizes.is_uniform() &&
      input_.box.expanded(-input_.criteria.reach).contains(q))
    return;
  const auto near = std::ranges::stable_partition(left_out_, [&](const LeftOut& p) {
    return squared_distance(p.point.position, q) > p.reach * p.reach;
  });
  std::ranges::transform(near, std::back_inserter(taken), &LeftOut::point);
  left_out_.erase(near.begin(), near.end());
  insert_all(taken, false, hint);
}

void LeafMesh::insert_all(const std::vector<MeshPoint>& points, bool are_core, Cell hint) {
  Conflict conflict;
  for (const MeshPoint& p : points) {
    find_conflict(p.position, hint, conflict);
    are_core ? insert_core(p, conflict) : insert(p, p.id, conflict);
    hint = delaunay_.newest_cell();
  }
}

// Of all points in a ball, the least reach_at().
double LeafMesh::least_reach_in(const Point& center, double radius) const {
  const double growth = surroundings_.sizes.growth();
  constexpr double kRoom = 0.9;  // h is interpolated
  return kRoom * reach_factor(growth, kReach) * (surroundings_.sizes.at(center) - growth * radius);
}

bool LeafMesh::is_loaded(const CellBall& ball) const {
  const double reach = input_.criteria.reach, radius = std::sqrt(ball.squared_radius);
  const double loaded = !std::isfinite(reach)              ? kNeighborhood * input_.criteria.size
                        : surroundings_.sizes.is_uniform() ? reach
                                                           : least_reach_in(ball.center, radius);
  return std::sqrt(input_.box.squared_distance(ball.center)) + radius < loaded &&
         std::ranges::none_of(left_out_, [&](const LeftOut& p) {
           return squared_distance(p.point.position, ball.center) <= ball.squared_radius;
         });
}

// All cells at q that belong to the mesh have vertices within twice the size.
void LeafMesh::take_in_core(const Point& q, Cell hint, std::vector<MeshPoint>& taken) {
  taken.clear();
  if (surroundings_.core == nullptr) return;
  surroundings_.core->within(q, kNeighborhood * surroundings_.core->size(), taken);
  std::erase_if(taken, [&](const MeshPoint& p) { return is_known(p.id); });
  insert_all(taken, true, hint);
}

bool LeafMesh::is_known(std::uint64_t id) const {
  if (known_.empty()) {
    for (const auto* points : {&input_.own, &input_.ghosts})
      for (const MeshPoint& p : *points) known_.push_back(p.id);
    std::ranges::sort(known_);
  }
  return std::ranges::binary_search(known_, id) || taken_in_.contains(id);
}

// A neighbor that takes a point is asked first for the next, which is likely to be close by.
std::optional<Point> LeafMesh::farthest_in_voronoi_cell(LocalIndex i, const PointCubes& points,
                                                        double least, double bound) const {
  delaunay_.neighbors_of(i, neighbors_);
  const Point& center = delaunay_.point(i);
  std::optional<Point> farthest;
  double most = least * least;
  points.for_each_around(center, bound, [&](const Point& q) {
    const double distance = squared_distance(q, center);
    if (distance >= bound * bound || distance < most) return true;
    if (farthest ? distance == most && *farthest < q : distance == most) return true;
    const auto taker = std::ranges::find_if(neighbors_, [&](LocalIndex v) {
      return squared_distance(q, delaunay_.point(v)) <= distance;
    });
    if (taker != neighbors_.end()) {
      std::swap(*taker, neighbors_.front());
    } else {
      farthest = q;
      most = distance;
    }
    return true;
  });
  return farthest;
}

LeafMesh::GridCell LeafMesh::grid_cell(const Point& p) const {
  const double size = input_.criteria.size;
  return {static_cast<std::int64_t>(std::floor(p.x / size)),
          static_cast<std::int64_t>(std::floor(p.y / size)),
          static_cast<std::int64_t>(std::floor(p.z / size))};
}

void LeafMesh::volume_points_near(const Point& q, double distance,
                                  std::vector<LocalIndex>& out) const {
  for (; num_in_grid_ < locals_.size(); ++num_in_grid_) {
    const MeshPoint& p = locals_[num_in_grid_].point;
    if (is_deletable(p.kind)) volume_points_[grid_cell(p.position)].push_back(num_in_grid_);
  }
  out.clear();
  const auto [x, y, z] = grid_cell(q);
  for (std::int64_t i = x - 1; i <= x + 1; ++i)
    for (std::int64_t j = y - 1; j <= y + 1; ++j)
      for (std::int64_t k = z - 1; k <= z + 1; ++k) {
        const auto found = volume_points_.find({i, j, k});
        if (found == volume_points_.end()) continue;
        for (const LocalIndex v : found->second)
          if (locals_[v].is_alive &&
              squared_distance(locals_[v].point.position, q) < distance * distance)
            out.push_back(v);
      }
  std::ranges::sort(out);
}

// The points of a ball around q hang together in the Delaunay graph: from each, neighbors come
// closer and closer to q until the nearest.
bool LeafMesh::has_other_point_within(const Point& q, double radius, LocalIndex nearest,
                                      const std::vector<LocalIndex>& leaving) const {
  const auto is_within = [&](LocalIndex i) {
    return squared_distance(locals_[i].point.position, q) < radius * radius;
  };
  if (nearest == kInfiniteVertex || !is_within(nearest)) return false;
  std::vector<LocalIndex> seen{nearest};
  for (std::size_t n = 0; n < seen.size(); ++n) {
    if (!std::ranges::binary_search(leaving, seen[n])) return true;
    delaunay_.neighbors_of(seen[n], neighbors_);
    for (const LocalIndex v : neighbors_)
      if (is_within(v) && std::ranges::find(seen, v) == seen.end()) seen.push_back(v);
  }
  return false;
}

}  // namespace locvol
