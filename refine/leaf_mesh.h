// LeafMesh: the Delaunay triangulation of a leaf's local points, seen against the surface: which
// cells belong to the mesh, where dual edges cross the surface. Internal to refine/.
//
// Threads: used by one at a time; const functions note what they find, and use scratch.
#pragma once

#include <array>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <utility>
#include <vector>

#include "refine/circumcenter.h"
#include "refine/conditions.h"
#include "refine/delaunay.h"
#include "refine/leaf.h"
#include "refine/point_cubes.h"

namespace locvol {

using LocalIndex = Delaunay::Vertex;  // of a local point; not stored anywhere

inline constexpr LocalIndex kInfiniteVertex = Delaunay::kInfinite;

// Where a cell lies, by its circumcenter: outside of all bodies, in one of them (its id), or where
// none is known. One number, for it is asked for over and over.
enum class Side : BodyId {
  kOutside = kNoBody,
  // The circumradius is infinite, or beyond what is known to be empty (Criteria::reach). In runs of
  // the surface alone, this plus the body that the circumcenter is in.
  kFar = BodyId{1} << 31,
  // Near, but out of what is loaded of the domain and not deep: of cells without own vertex only.
  kNotLoaded = std::numeric_limits<BodyId>::max() - 1,
  kUnknown  // not asked yet
};
constexpr Side side_in(BodyId body) { return static_cast<Side>(body); }
constexpr Side far_in(BodyId body) {
  return static_cast<Side>(static_cast<BodyId>(Side::kFar) | body);
}
constexpr bool is_far(Side side) { return side >= Side::kFar && side < Side::kNotLoaded; }
// Of the mesh's cells. No other cell is in a body.
constexpr BodyId body_at(Side side) {
  return side < Side::kNotLoaded ? static_cast<BodyId>(side) & ~static_cast<BodyId>(Side::kFar)
                                 : kNoBody;
}

// What the checks ask of a cell and its neighbors over and over, in few bytes.
struct CellState {
  std::uint32_t stamp = 0;  // one per cell ever made; 0: dead
  Side side = Side::kUnknown;
  std::uint8_t facets_seen : 4 = 0;  // bit i: facet i has been looked at since the cell was made
  std::uint8_t own : 4 = 0, hidden : 4 = 0, on_surface : 4 = 0;  // bit i: vertex i is
  std::uint8_t at_core : 4 = 0;                                  // likewise; see Local
  bool has_clearance : 1 = false;
  bool is_hollow : 1 = false;  // a point of the lattice core is in its ball: no cell of Del P

  BodyId body() const { return body_at(side); }  // REQUIRES: the side is known
  bool is_member() const { return body() != kNoBody; }
};
static_assert(sizeof(CellState) == 12);

struct CellBall {  // once the side is known, if the cell is not far
  Point center;
  double squared_radius = 0;
  double clearance = 0;  // of the center, once it was asked for: no surface closer
};

// What a visit asks of what is around it, made from its input once.
struct Surroundings {
  const LeafDomain& domain;
  const SizeField& sizes;
  const CoreIndex* core;                          // null: none is near
  const PointIndex* points;                       // null: the ghosts are all that can matter
  const StopToken* stop;                          // may be null
  std::span<const MeshPoint> crease_points = {};  // LeafInput's
  bool are_sides_apart = false;                   // likewise
};

class LeafMesh {
 public:
  using Cell = Delaunay::Cell;
  using Facet = Delaunay::Facet;
  static constexpr Cell kNoCell = Delaunay::kNone;

  struct Local {
    MeshPoint point;
    VertexRef ref = 0;
    bool is_own = false;
    bool is_core = false;     // taken in from the lattice core
    bool is_at_core = false;  // a lattice point that has neighbors in the core, or may have
    bool is_alive = true;
  };

  enum class OwnPoints {
    kInBox,   // all in the leaf's box
    kListed,  // of the input's points, only those that it lists as own
  };
  // Both must outlive it.
  LeafMesh(const LeafInput& input, const Surroundings& around, OwnPoints own);

  // ---- What is there
  const Delaunay& delaunay() const { return delaunay_; }
  const Local& local(LocalIndex i) const { return locals_[i]; }
  std::size_t num_locals() const { return locals_.size(); }
  std::uint64_t num_own() const { return num_own_; }
  std::uint64_t num_cells_made() const { return stamp_; }
  bool has_cells() const { return delaunay_.has_cells(); }
  bool is_known(std::uint64_t id) const;  // a point of P that is there, or was
  const Point& point(Cell c, int i) const { return delaunay_.point(delaunay_.vertex(c, i)); }
  std::array<Point, 4> corners(Cell c) const {
    return {point(c, 0), point(c, 1), point(c, 2), point(c, 3)};
  }
  bool is_own(LocalIndex v) const { return v != kInfiniteVertex && locals_[v].is_own; }
  bool has_own_vertex(Cell c) const { return states_[c].own != 0; }
  bool has_own_vertex(Facet f) const { return has_vertex(states_[f.cell].own, f); }
  bool is_on_surface(Facet f) const {
    return (states_[f.cell].on_surface | 1 << f.index) == 0b1111;
  }
  const CellState& state(Cell c) const { return states_[c]; }
  const CellBall& ball(Cell c) const { return balls_[c]; }
  // How far a ball that is known to be empty reaches from p, if it passes through p.
  double reach_at(const Point& p) const {
    return surroundings_.sizes.is_uniform() ? input_.criteria.reach
                                            : surroundings_.sizes.reach_of_balls(p, kReach);
  }
  // Of a length among the criteria, which are for the largest h on the surface: what it is where h
  // is `size`.
  double scaled(double length, double size) const {
    return surroundings_.sizes.has_shapes() ? length / input_.criteria.size * size : length;
  }
  // Each point of the surface that is as far from p, or farther, is closer to a point of P.
  double cover_radius_from(const Point& p) const {
    const SizeField& sizes = surroundings_.sizes;
    const double radius = input_.criteria.cover_radius;
    if (!sizes.has_shapes()) return radius;
    const double here = scaled(radius, sizes.at(p));
    return std::min(radius, here / (1 - sizes.growth() * scaled(radius, 1)));
  }
  // Are all points of P in the ball there, so that it is known whether it is empty?
  bool is_loaded(const CellBall& ball) const;

  // ---- The cells and facets against the surface.
  Side side(Cell c) const {
    return states_[c].side != Side::kUnknown ? states_[c].side : find_side(c);
  }
  BodyId body(Cell c) const { return body_at(side(c)); }
  bool is_member(Cell c) const { return body(c) != kNoBody; }
  // In place of cells of the lattice at core points that are not loaded.
  bool is_hollow(Cell c) const { return is_member(c) && states_[c].is_hollow; }
  // Is its dual edge, between two near cells, known not to meet the surface? Of facets with an own
  // vertex, where that is the nearest point to all of it as in find_side(): far cheaper than to ask
  // for crossings.
  bool is_hidden(Facet f) const {
    return has_hidden_own_vertex(f) && !is_far(side(f.cell)) &&
           !is_far(side(delaunay_.neighbor(f.cell, f.index)));
  }
  // Do all own vertices of the facet lie on the surface, or near it? Of the others it is known that
  // all cells around them are in the mesh.
  bool may_be_of_boundary(Facet f) const {
    const CellState& state = states_[f.cell];
    return !has_vertex(state.own & state.hidden, f);
  }
  // Is it a facet of the boundary, or between bodies, and its cell the one behind it?
  bool is_behind(Facet f) const { return body(f.cell) > body(delaunay_.neighbor(f.cell, f.index)); }
  // The body around a place that no part of the surface comes close to.
  BodyId body_around(const Point& p) const;
  // Does the facet part the mesh from what is outside, or two bodies?
  struct BoundaryFacet {
    std::array<LocalIndex, 3> vertices{};  // counterclockwise seen from before
    LocalIndex smallest = 0;               // of these, in lexicographic order
    BodyId behind = kNoBody, before = kNoBody;
  };
  std::optional<BoundaryFacet> boundary_facet(Facet f) const;
  // Does a vertex, or a place of one, lie where the surface parts these bodies? One body has all of
  // the surface.
  bool is_between(LocalIndex v, const std::array<BodyId, 2>& bodies) const;
  bool is_between(const Point& p, const std::array<BodyId, 2>& bodies) const;
  FacetLabels labels(const BoundaryFacet& facet) const;
  // REQUIRES: neither cell of the facet is kNotLoaded
  DualCrossings dual_crossings(Facet f) const;
  // The facets of the mesh's boundary at the vertex, and those between bodies, each of its cell
  // behind it.
  void boundary_at(LocalIndex v, std::vector<Facet>& out) const;
  // What conditions.h judges. REQUIRES: the cell is of the mesh; of the facet, as dual_crossings()
  CellView view(Cell c) const { return {balls_[c].center, balls_[c].squared_radius, corners(c)}; }
  FacetView view(Facet f) const { return {dual_crossings(f), is_on_surface(f)}; }

  // ---- The same of cells that a change would make (Delaunay::Change).
  struct Prospect {
    CellState state;
    CellBall ball;
  };
  // Of the cell that `change` makes, if its vertex is then an own point of this kind. Its side is
  // known.
  Prospect appraise(const Delaunay::Change& change, std::size_t made, PointKind kind) const;
  CellView view(const Delaunay::Change& change, const std::vector<Prospect>& prospects,
                std::size_t cell) const;
  FacetView view(const Delaunay::Change& change, const std::vector<Prospect>& prospects,
                 std::size_t cell, int index) const;
  // Where a vertex is then.
  const Point& place(const Delaunay::Change& change, LocalIndex v) const {
    return v == change.vertex ? change.place : delaunay_.point(v);
  }

  void note_facet_seen(Facet f) {
    CellState& state = states_[f.cell];
    state.facets_seen = (state.facets_seen | 1u << f.index) & 0b1111u;
  }

  // ---- Change. Every cell with an own vertex that comes up is put on fresh_cells().
  struct CellRef {
    Cell cell = kNoCell;
    std::uint32_t stamp = 0;
  };
  CellRef ref(Cell c) const { return {c, states_[c].stamp}; }
  bool is_alive(const CellRef& ref) const {
    return ref.cell < states_.size() && states_[ref.cell].stamp == ref.stamp;
  }
  // Than the first triangulation.
  bool is_made_later(const CellRef& ref) const { return ref.stamp > first_stamp_; }
  const std::vector<CellRef>& fresh_cells() const { return fresh_; }
  // Are these all there are with an own vertex?
  bool are_all_fresh() const { return are_all_fresh_; }
  // Whether facets at own vertices may have joined or left the mesh's boundary since the fresh
  // cells were cleared last.
  bool is_boundary_changed() const;
  void clear_fresh_cells();

  // The cells whose circumballs contain q, and the hole's border.
  struct Conflict : Delaunay::Conflict {
    LocalIndex nearest = kInfiniteVertex;
    double squared_distance = std::numeric_limits<double>::infinity();
  };
  void find_conflict(const Point& q, Cell hint, Conflict& conflict) const;
  // `conflict` is that of q.
  LocalIndex insert(const MeshPoint& q, VertexRef ref, const Conflict& conflict);
  // REQUIRES: !has_cells()
  LocalIndex insert_first(const MeshPoint& q, VertexRef ref);
  void remove(std::span<const LocalIndex> leaving);
  // An own point comes to another place, as a point of another kind if it was of the lattice; `ref`
  // names it from now on.
  void move(const Delaunay::Change& change, PointKind kind, VertexRef ref);
  // An own point comes where there was none.
  void insert(const Delaunay::Change& change, PointKind kind, VertexRef ref);
  // Ghosts that were left out and are within the reach of q come, before anything is inserted
  // there; `taken`: they, in order of id.
  void take_in_ghosts(const Point& q, Cell hint, std::vector<MeshPoint>& taken);
  // The same of the lattice core, within 2λ.
  void take_in_core(const Point& q, Cell hint, std::vector<MeshPoint>& taken);
  // Volume points closer to q than `distance`, ascending. REQUIRES: distance <= λ
  void volume_points_near(const Point& q, double distance, std::vector<LocalIndex>& out) const;
  // Of the points in the Voronoi cell of the vertex `i`, the one farthest from it, farther than
  // `least` and closer than `bound`; of several the first in lexicographic order.
  std::optional<Point> farthest_in_voronoi_cell(LocalIndex i, const PointCubes& points,
                                                double least, double bound) const;
  // Is a point closer to q than `radius`, apart from those `leaving` (ascending)? `nearest` is the
  // point closest to q.
  bool has_other_point_within(const Point& q, double radius, LocalIndex nearest,
                              const std::vector<LocalIndex>& leaving) const;

 private:
  using GridCell = std::array<std::int64_t, 3>;  // cubes of side λ
  struct Marks {
    bool is_own = false, is_hidden = false, is_on_surface = false, is_at_core = false;
  };

  GridCell grid_cell(const Point& p) const;
  void add_local(const MeshPoint& p, VertexRef ref, bool is_own, bool is_core = false);
  void add_to_triangulation(std::vector<Local> locals);
  LocalIndex insert_core(const MeshPoint& q, const Conflict& conflict);
  void insert_all(const std::vector<MeshPoint>& points, bool are_core, Cell hint);
  LocalIndex insert_last_local(const Conflict& conflict);
  void make_fresh(Cell c);
  void make_all_fresh();
  Side find_side(Cell c) const;
  BodyId body_of_far(Cell c) const;
  bool is_far_away(Cell c) const;
  std::optional<Point> far_place_by(Facet f) const;
  std::optional<Point> far_place(Cell c) const;
  DomainState state_at(const Point& p) const;
  Side find_side(const std::array<Point, 4>& corners, CellState& state, CellBall& ball) const;
  void note_gone(Cell c);
  bool is_hidden(const MeshPoint& p) const;
  bool is_at_core(const MeshPoint& p, bool is_own) const;
  bool has_core_point(const Point& center, double squared_radius) const;
  static bool has_vertex(int bits, Facet f) { return (bits & ~(1 << f.index)) != 0; }
  bool has_hidden_own_vertex(Facet f) const {
    return has_vertex(states_[f.cell].own, f) && has_vertex(states_[f.cell].hidden, f);
  }
  // A cell at a facet, and its vertex off that; null if that is infinite.
  struct CellAtFacet {
    CellState* state;
    CellBall* ball;
    const Point* off;
  };
  CellAtFacet at_facet(Facet f) const {
    const LocalIndex off = delaunay_.vertex(f.cell, f.index);
    return {&states_[f.cell], &balls_[f.cell],
            off == kInfiniteVertex ? nullptr : &delaunay_.point(off)};
  }
  // `corners`: with the vertex off the facet in `here`, positively oriented.
  DualCrossings dual_crossings(const std::array<Point, 3>& corners, const CellAtFacet& here,
                               const CellAtFacet& there, bool is_past_surface) const;
  static CellState fresh_state(const std::array<Marks, 4>& marks);
  std::array<Point, 4> corners(const Delaunay::Change& change, const Delaunay::NewCell& cell) const;
  double clearance(CellState& state, CellBall& ball) const;
  bool is_deep(CellState& state, CellBall& ball) const;
  Side side_of_deep(const std::array<Point, 4>& corners) const;
  bool is_off_surface(BodyId here, BodyId there, const Point& from, const Point& to,
                      const Point& corner) const;
  bool is_axis_near(const Axis& axis) const;
  // How far points on the surface may be off it, by rounding.
  double off_surface() const { return 1e-6 * input_.criteria.size; }
  double least_reach_in(const Point& center, double radius) const;
  Point far_end(const Point& axis_center, const Point& direction,
                double squared_circumradius) const;
  // Up to which radius a ball around the point is known to be empty if it passes through an own
  // point.
  double far_radius_at(const Point& center) const {
    return surroundings_.sizes.is_uniform() ? far_radius_
                                            : 0.5 * kReach * surroundings_.sizes.at(center);
  }

  const LeafInput& input_;
  const Surroundings& surroundings_;
  double far_radius_;  // the largest of far_radius_at()
  bool is_around_;     // no point of the box is left out
  struct LeftOut {
    MeshPoint point;
    double reach = 0;
  };
  std::vector<LeftOut> left_out_;  // ghosts out of reach of all own points, in order of id
  std::vector<Local> locals_;
  std::vector<Marks> marks_;  // of locals, close together: a cell asks for those of its vertices
  mutable std::vector<std::uint64_t> known_;  // ids of the input's points, once they are asked for
  std::set<std::uint64_t> taken_in_;          // ids of other points of P
  // Also those no longer alive. Of locals below num_in_grid_: seldom asked for, and filled when it
  // is.
  mutable std::map<GridCell, std::vector<LocalIndex>> volume_points_;
  mutable LocalIndex num_in_grid_ = 0;
  std::uint64_t num_own_ = 0;
  std::uint32_t stamp_ = 0, first_stamp_ = 0;
  Delaunay delaunay_;
  mutable std::vector<CellState> states_;  // of cells
  mutable std::vector<CellBall> balls_;    // likewise
  std::vector<CellRef> fresh_;
  bool are_all_fresh_ = false;
  mutable std::vector<Cell> around_;
  mutable std::vector<LocalIndex> neighbors_;
  // Of locals on the surface, as far as they were asked for: LeafDomain::changes_at().
  mutable std::vector<std::vector<DomainState>> changes_;
  // Of the cells with an own vertex that went, the body; null: there are none. Or are there others?
  std::optional<BodyId> gone_body_;
  bool has_gone_others_ = false;
  mutable std::vector<Crossing> crossings_;
};

}  // namespace locvol
