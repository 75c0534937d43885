// What a leaf's visit takes and gives: LeafInput, of which refine_leaf makes a LeafDelta.
#pragma once

#include <array>
#include <concepts>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

#include "octree/geometry.h"
#include "octree/mesh_facet.h"
#include "octree/size_field.h"
#include "octree/stop.h"
#include "refine/core_index.h"
#include "refine/domain/leaf_domain.h"

namespace locvol {

// The reach (below) that cover mode gives a visit, over λ. More than 2 is needed: balls of radius λ
// must be known to be empty. Measured: 2.1 makes some surface points more, 2.5 a tenth more ghosts.
inline constexpr double kReach = 2.25;

// Likewise, how far from its leaf a visit inserts, and asks for points of the lattice core: 2 λ
// around what it inserts.
inline constexpr double kInsertion = kReach - 1;
inline constexpr double kCoreReach = kInsertion + 2.1;

// How far, over λ, an insertion matters: it destroys balls that contain it, and those of stars are
// smaller than λ (the radius of N_v in Dey and Slatton 2011).
inline constexpr double kNeighborhood = 2;

struct Criteria {
  // Of a run's visits. `spacing_floor`: over λ
  static Criteria of_cover(double size, double radius_edge_bound, double spacing_floor,
                           double min_dihedral = 0, double growth = 0);
  static Criteria of_paper(double size, double radius_edge_bound, double spacing_floor,
                           double min_dihedral = 0);

  double size = 0;  // λ, in the units of the coordinates: of cells at the surface
  double radius_edge_bound = 2;
  // All of P within this distance of the leaf is loaded; may be infinite. A ball through an own
  // point is known to be empty of P only up to a radius of reach / 2: what is larger is taken for
  // an artifact of points that were not loaded, and ends of dual edges are cut there. Where sizes
  // vary, this is so at the surface, and elsewhere the reach is as much larger as h is.
  double reach = 0;
  // Of the dihedral angles of cells, in degrees (C7); 0: none.
  double min_dihedral = 0;
  double spacing_floor = 0;  // no insertion closer than this to a point of P, same units
  // Every point of the surface is this close to a point of P, or closer. Spares questions of the
  // surface farther from P; infinite: none.
  double cover_radius = std::numeric_limits<double>::infinity();
  // All of P is on the surface, and only facets are asked for and listed: C1 to C4. REQUIRES: the
  // reach and the cover radius are finite
  bool is_surface_only = false;
  friend bool operator==(const Criteria&, const Criteria&) = default;
};

// Looks up points of P that the leaf has not loaded (paper mode).
class PointIndex {
 public:
  virtual ~PointIndex() = default;
  // The point of P nearest to q, if one is at most `radius` away, leaving out those whose ids
  // `is_deleted` claims; ties by lexicographic order.
  virtual std::optional<MeshPoint> nearest(
      const Point& q, double radius,
      const std::function<bool(std::uint64_t)>& is_deleted) const = 0;
};

// What the visits of paper mode share: all of the surface and of P, which stay in memory. Cover
// mode's have neither.
struct WholeModel {
  const LeafDomain* domain = nullptr;  // null: it is built from LeafInput::domain
  const PointIndex* points = nullptr;  // null: the ghosts are all that can matter
};

// A bug or a rounding fault, never bad input: with the leaf's place in the message.
class RefineError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// Names a vertex: the id of a point of the input, or kNewPoint | index into LeafDelta::inserted.
using VertexRef = std::uint64_t;
inline constexpr VertexRef kNewPoint = VertexRef{1} << 63;

struct MeshCell {
  std::array<std::uint32_t, 4> vertices{};  // places in a list of vertices; positively oriented
  BodyId body = kOnlyBody;
  friend auto operator<=>(const MeshCell&, const MeshCell&) = default;
};
struct NamedCell {
  std::array<VertexRef, 4> vertices{};  // likewise
  BodyId body = kOnlyBody;
  friend auto operator<=>(const NamedCell&, const NamedCell&) = default;
};

struct CellList {
  using Item = MeshCell;
  using Name = NamedCell;

  std::vector<VertexRef> vertices;  // of the cells, ascending: points of the input come first
  std::vector<MeshCell> cells;      // ascending

  std::size_t size() const { return cells.size(); }
  std::array<VertexRef, 4> refs(std::size_t i) const {
    const auto& [a, b, c, d] = cells[i].vertices;
    return {vertices[a], vertices[b], vertices[c], vertices[d]};
  }
  friend bool operator==(const CellList&, const CellList&) = default;
};

struct NamedFacet {
  std::array<VertexRef, 3> vertices{};  // as MeshFacet has them
  FacetLabels labels;
  friend auto operator<=>(const NamedFacet&, const NamedFacet&) = default;
};

// Facets of the mesh's boundary, and of that between bodies.
struct FacetList {
  using Item = MeshFacet;
  using Name = NamedFacet;

  std::vector<VertexRef> vertices;  // as those of a CellList
  std::vector<MeshFacet> facets;    // ascending
  friend bool operator==(const FacetList&, const FacetList&) = default;
};

// What follows is for both kinds of lists.
template <class T, class Struct>
concept Maybe = std::same_as<std::remove_const_t<T>, Struct>;  // Struct or const Struct

auto& items_of(Maybe<CellList> auto& list) { return list.cells; }
auto& items_of(Maybe<FacetList> auto& list) { return list.facets; }
auto& vertices_in(Maybe<MeshCell> auto& cell) { return cell.vertices; }
auto& vertices_in(Maybe<NamedCell> auto& cell) { return cell.vertices; }
auto& vertices_in(Maybe<MeshFacet> auto& facet) { return facet.vertices; }
auto& vertices_in(Maybe<NamedFacet> auto& facet) { return facet.vertices; }

// Has the items refer to another list of vertices, ascending. REQUIRES: those in use are in it
template <class List>
void name_vertices(List& list, std::vector<VertexRef> names);
template <class List>
void drop_unused_vertices(List& list);

// Takes items out of a list, and puts others in; vertices that none has any more go.
template <class List>
struct Changes {
  std::vector<typename List::Name> gone, made;
  bool is_strict = true;  // what goes is there, and what comes is not: throws RefineError otherwise
};
template <class List>
void apply(const Changes<List>& changes, List& list);

// How the last visit of a leaf left it. REQUIRES: no point within `reach` of the leaf was deleted
// since
struct LastVisit {
  std::uint64_t first_new_id = 0;  // points from here on came later, and not from that visit
  CellList cells;                  // LeafDelta::cells, with ids for all vertices
  FacetList facets = {};           // likewise
  // Since then: within 2λ, core points that became explicit, and LeafDelta::left of others
  // visits; and their PoorCell::others.
  std::vector<Point> asked = {};
  friend bool operator==(const LastVisit&, const LastVisit&) = default;
};

// One change that a visit makes, or finds forbidden. The points that an insertion deletes come
// right before it.
struct RefineStep {
  enum class Action { kInsert, kDelete, kTakeIn, kBlocked, kMove };
  Action action = Action::kInsert;
  int condition = 0;  // 1 … 7, the one that is restored
  double radius = 0;  // of its surface ball or circumsphere; 0 if it has none
  // The point inserted, deleted, moved to this position, or taken in from P; kBlocked: that the
  // spacing floor forbids.
  VertexRef point = 0;  // kBlocked: nothing
  Point position;
  PointKind kind = PointKind::kSurface;  // kBlocked: nothing
};

// All that a visit depends on, as a value: it can be stored, sent, and visited elsewhere. (But for
// WholeModel, in paper mode.)
struct LeafInput {
  Criteria criteria;
  Box box;  // of the leaf, half-open: own points have min <= p < max
  // In order of id: where points get inserted, the result depends on the order.
  std::vector<MeshPoint> own;        // P_v
  std::vector<MeshPoint> ghosts;     // P within `reach` of the box (paper: within 2λ), without own
  DomainPiece domain;                // its region contains the box expanded by reach / 2
  CoreRows core;                     // within kCoreReach λ, in cover mode
  SizeCubes sizes = {};              // around all of these; no cubes: λ everywhere
  std::uint64_t max_own_points = 0;  // κ: the visit stops above it, to be split; 0: no bound
  // If given, only what may have changed since is looked at, which is far less work: the same cells
  // come out, and where points must be inserted, possibly others.
  // REQUIRES: that visit was not overfull, and left nothing unresolved
  std::optional<LastVisit> last_visit = std::nullopt;
  std::uint64_t max_insertions = 0;  // beyond it the visit is taken for a bug; 0: no bound
  // Leaves around that have not been visited yet. C7 leaves most of the work on cells whose
  // circumcenters lie there to them.
  std::vector<Box> waiting = {};
  // Where creases are near: those of P on creases within kReach + kCreaseStep, the leaf's own and
  // ghosts among them. The balls around ghosts are known with these.
  std::vector<MeshPoint> crease_points = {};
  // Vertices are told apart by sheets, and by sides that face each other; so where creases are
  // near.
  bool are_sides_apart = false;
  friend bool operator==(const LeafInput&, const LeafInput&) = default;
};

// Who looks on, and changes nothing.
struct VisitWatch {
  std::function<void(const RefineStep&)> on_step = {};  // told each step in order; may be empty
  const StopToken* stop = nullptr;                      // may be null
};

struct InsertedPoint {
  Point position;
  PointKind kind = PointKind::kSurface;
  bool is_deleted = false;  // again, by a later insertion of the same visit
  // Other leaves' points within 2 λ whose stars it changed, other than for C7. Unknown: any that
  // near may be.
  std::optional<std::vector<Point>> changed;
  friend bool operator==(const InsertedPoint&, const InsertedPoint&) = default;
};

struct Violation {    // unresolved: the spacing floor forbids the cure
  int condition = 0;  // 1 … 6
  Point position;     // where a point would have been inserted
  double radius = 0;
  friend bool operator==(const Violation&, const Violation&) = default;
};

// A cell that C7 could not improve, and does not leave to a leaf that waits.
struct PoorCell {
  Point position;      // of its circumcenter
  double degrees = 0;  // its smallest dihedral angle
  // Its vertices that are other leaves', and its circumcenter if that is: if those leaves have not
  // tried it, each is to be asked to.
  std::vector<Point> others;
  friend bool operator==(const PoorCell&, const PoorCell&) = default;
};

// An item that another leaf lists.
template <class List>
struct OfOther {
  typename List::Name name;  // a cell's vertices ascend as far as the orientation permits
  Point smallest;            // of its vertices: the leaf that owns that one lists the item
  friend bool operator==(const OfOther&, const OfOther&) = default;
};
using OthersCell = OfOther<CellList>;
using OthersFacet = OfOther<FacetList>;

struct VisitStats {
  std::array<std::uint64_t, 7> insertions{};  // by condition
  std::uint64_t moves = 0;                    // of points, for C7
  std::uint64_t deletions = 0;
  std::uint64_t points_added = 0;  // points of P that were not triangulated at first, and taken in
  std::uint64_t cells_made = 0;    // by the triangulation, in all
  friend bool operator==(const VisitStats&, const VisitStats&) = default;
};

struct LeafDelta {
  std::vector<InsertedPoint> inserted;  // in order of insertion
  std::vector<MeshPoint> deleted;       // points of the input
  // Points of the input that C7 moved: each is inserted anew, at its new place. Stars that moves
  // and insertions for C7 change need no visit, for all conditions hold there: what other leaves
  // list changes as `others_gone` and `others_made` say.
  std::vector<MeshPoint> moved;
  // From where C7 moved points of the kinds kInserted and kSurface, this visit's or not. Leaves
  // that wait to look at what such a point changed are to look around that place.
  std::vector<Point> left;
  std::vector<OthersCell> others_gone, others_made;  // ascending
  std::vector<OthersFacet> others_facets_gone, others_facets_made;
  // Of the mesh, whose smallest vertex (not counting core points) is own and lies in the box;
  // positively oriented.
  CellList cells;
  // Of the boundary, whose smallest vertex is own.
  FacetList facets;
  // Ids of core points at which an inserted one changes cells, ascending: all cells at them are
  // no longer the lattice's.
  std::vector<std::uint64_t> met_core;
  std::vector<Violation> unresolved;
  std::vector<PoorCell> poor;
  VisitStats stats;
  bool is_overfull = false;  // more than max_own_points: to be split; cells and facets are
                             // empty
  // Where sizes vary, and the delta is applied by one who may not know them there: h at `inserted`,
  // then at `deleted`, then at `left`. Empty: to be looked up.
  std::vector<double> sizes = {};
  friend bool operator==(const LeafDelta&, const LeafDelta&) = default;
};

}  // namespace locvol
