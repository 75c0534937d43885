// LeafDomain answers exact questions about a piece of the domain: which body has a place, and where
// a segment crosses the surface. README.md beside it says how.
//
// Consistency (refine/ALGORITHM.md): state(p) and what crossings(a, b) change are functions of the
// points and of the whole domain alone, whatever piece was loaded. Degenerate positions (a segment
// through an edge or a vertex, a point on a triangle) are decided by moving all query points by the
// same infinitesimal vector (ε, ε², ε³): what is crossed from a to b leads from the state of a to
// that of b. A triangle without area is never crossed.
//
// Cost: about 30 bytes per grid cell and triangle reference; label of a point 10 ns away from the
// surface and 0.2 µs beside it.
// Threads: const functions are safe from many threads.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "octree/crease.h"
#include "octree/domain_state.h"
#include "octree/geometry.h"
#include "octree/stop.h"
#include "refine/domain/box_tree.h"
#include "refine/domain/domain_piece.h"

namespace locvol {

// Where a segment from a to b crosses the surface.
struct Crossing {
  Point position;  // rounded
  double t = 0;    // 0 at a, 1 at b
  std::uint64_t triangle = 0;
  SheetId sheet = kOnlySheet;
  DomainState change;  // of the state, there
};

// Walks along crossings in order, from a place of this state: visit(crossing, before, after) is
// told the bodies on its sides. Returns the state at the end.
template <class Visit>
DomainState follow(DomainState state, std::span<const Crossing> crossings, const Visit& visit) {
  for (const Crossing& crossing : crossings) {
    const BodyId before = state.body();
    state = state.crossed(crossing.change);
    visit(crossing, before, state.body());
  }
  return state;
}
inline DomainState follow(DomainState state, std::span<const Crossing> crossings) {
  return follow(state, crossings, [](const Crossing&, BodyId, BodyId) {});
}

// Of a label. What is not loaded is in none.
inline bool is_in_body(std::optional<BodyId> label) { return label.value_or(kNoBody) != kNoBody; }

// Where a sheet faces itself, normals tell its sides apart.
struct SurfaceSide {
  SheetId sheet = kOnlySheet;
  Point normal = {};  // outwards, of any length; 0: both sides
  friend bool operator==(const SurfaceSide&, const SurfaceSide&) = default;
};
inline bool are_same(const SurfaceSide& a, const SurfaceSide& b) {
  return a.sheet == b.sheet && dot(a.normal, b.normal) >= 0;
}
inline Point normal_of(const std::array<Point, 3>& corners) {  // of any length
  return cross(corners[1] - corners[0], corners[2] - corners[0]);
}

struct SurfacePoint {
  Point position;
  SurfaceSide side;
};
struct CreasePoint {
  Point position;
  std::size_t edge = 0;  // its place in creases()
};

class LeafDomain {
 public:
  explicit LeafDomain(DomainPiece piece, const StopToken* stop = nullptr);  // throws Stopped
  LeafDomain(LeafDomain&&) noexcept;
  LeafDomain& operator=(LeafDomain&&) noexcept;
  ~LeafDomain();

  const Box& region() const;
  bool has_surface() const { return !triangles().empty(); }
  std::span<const Triangle> triangles() const;
  // All that meet the region, and some that only come close, in order of their ends; all corners in
  // the region, in order of id.
  std::span<const CreaseEdge> creases() const;
  std::span<const CornerPoint> corners() const;
  double crease_floor() const;  // DomainPiece's
  // The sheet of all of the surface that is loaded; null if there are several, or none.
  std::optional<SheetId> only_sheet() const;
  // The body that all of the domain which is loaded is of; null if there are several. Where none
  // is, the only one.
  std::optional<BodyId> only_body() const { return only_body_; }

  // ---- Of a place. Null: it lies out of the region, and the piece is not the whole domain.
  std::optional<DomainState> state(const Point& p) const { return locate(p).state; }
  std::optional<BodyId> label(const Point& p) const { return locate(p).label(); }
  struct Location {
    std::optional<DomainState> state;
    double distance_bound = 0;
    std::optional<BodyId> label() const {
      return state ? std::optional(state->body()) : std::nullopt;
    }
  };
  Location locate(const Point& p) const;  // both at the price of one

  // ---- Of a segment
  // Finds all crossings with the surface, by t, each triangle at most once. The part of the segment
  // outside region() is ignored.
  void crossings(const Point& a, const Point& b, std::vector<Crossing>& out) const;
  // Tells whether there is one.
  bool is_crossed(const Point& a, const Point& b) const;

  // ---- Of the surface near a place
  // A lower bound of the distance from p to the surface within region(), 0 if nothing better is
  // known cheaply.
  double distance_bound(const Point& p) const;
  // Tells whether some of it is closer to p than `distance`. REQUIRES: the region holds all that is
  bool is_near(const Point& p, double distance) const;
  // The point of it that is closest to p, of several that on the first triangle; null if none is
  // closer than `distance`. REQUIRES: the region holds all that is
  std::optional<SurfacePoint> closest_to(const Point& p, double distance) const;
  // The sheet of a facet with these corners that parts the two bodies: that of the triangle which
  // is closest to their centroid, of several the first; of those that part these bodies, if there
  // are some. So it is a function of the corners, the bodies and the surface alone, whoever lists,
  // changes or mends the facet. REQUIRES: the region holds that triangle
  SheetId sheet_of_facet(const std::array<Point, 3>& corners, BodyId behind, BodyId before) const;
  // What crossing the surface at p changes: of all triangles that are closer than `tolerance`, each
  // change once.
  void changes_at(const Point& p, double tolerance, std::vector<DomainState>& out) const;
  // The point of a crease that is closest to p, of several that on the first edge; null if none is
  // closer than `distance`. REQUIRES: the region holds all that is
  std::optional<CreasePoint> closest_on_crease(const Point& p, double distance) const;
  // Calls visit(place in creases()) for the edges whose boxes are closer to p than `distance`, in
  // no order that matters.
  template <class Visit>
  void for_each_crease_near(const Point& p, double distance, const Visit& visit) const {
    double squared = distance * distance;
    crease_tree().for_each_within(p, squared, visit);
  }
  // Triangles closer to p than `distance`, and some that only come close; in order of id, each
  // once.
  void triangles_near(const Point& p, double distance, std::vector<Triangle>& out) const;
  // Their vertices, in lexicographic order, each once.
  void vertices_near(const Point& p, double distance, std::vector<Point>& out) const;
  // Likewise of all triangles.
  std::vector<Point> vertices() const;
  // Tells whether two parts of it face each other, both closer to p than `distance`.
  bool is_fold(const Point& p, double distance) const;

 private:
  const BoxTree& crease_tree() const;
  struct Closest {
    Point place;
    std::uint32_t triangle = 0;  // its place in triangles()
  };
  std::optional<Closest> closest_triangle(const Point& p, double distance,
                                          const std::optional<DomainState>& change) const;

  struct Impl;
  std::unique_ptr<Impl> impl_;
  std::optional<BodyId> only_body_;  // asked for each cell
};

}  // namespace locvol
