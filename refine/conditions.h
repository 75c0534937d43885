// The conditions that a mesh is to meet (refine/ALGORITHM.md), each in one place. Refinement asks
// them of what there is, and C7 of what a change would make. Internal to refine/. (What judges a
// finished mesh is other code on purpose: engine/audit.)
//
//   C1  Surface Delaunay balls have radii below h at their centers.
//   C2  A facet whose dual edge meets the surface has all three vertices on the surface.
//   C3  The boundary facets at a surface vertex form a disk; of several bodies, those of each.
//   C4  The dual edge of a facet meets the surface at most once.
//   C5  Cells of the mesh have circumradii below h at their circumcenters; no dual edge ends inside
//       where balls are no longer known to be empty.
//   C6  Cells of the mesh have radius-edge ratios of at most a bound.
//   C7  Cells of the mesh have no dihedral angle below a bound. Asked in improve_angles alone.
//
// Each function is pure: it tells from a view which condition is broken, of several the one that
// comes first in the list, or that none is. A view is what a mesh and a proposed change both know
// of a cell, a facet or a vertex (LeafMesh::view). A new condition is a line in one of these
// functions, with what the view lacks for it; then Refinement::restore_next says when it has its
// turn, and what its cure is.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "octree/domain_state.h"
#include "octree/geometry.h"
#include "octree/size_field.h"
#include "refine/cell_shape.h"
#include "refine/vertex_link.h"

namespace locvol {

enum Condition : std::uint8_t { kC1 = 1, kC2, kC3, kC4, kC5, kC6, kC7 };  // as reports have them

// What they compare with.
struct Bounds {
  const SizeField& sizes;  // h
  double radius_edge = 0;
};

// ---- Cells

// Of a cell of the mesh.
struct CellView {
  Point center;  // of its circumball
  double squared_radius = 0;
  std::array<Point, 4> corners;
};

inline bool is_round(double squared_radius, const std::array<Point, 4>& corners, double bound) {
  return squared_radius <= bound * bound * shortest_edge_squared(corners);
}

inline std::optional<Condition> judge(const CellView& cell, const Bounds& bounds) {
  if (!bounds.sizes.is_below(cell.squared_radius, 1, cell.center)) return kC5;
  if (!is_round(cell.squared_radius, cell.corners, bounds.radius_edge)) return kC6;
  return std::nullopt;
}

// C2 as it shows in cells: around a vertex that is not on the surface all cells are inside.
// `on_surface`: bit i: vertex i is.
inline bool must_be_inside(unsigned on_surface) { return on_surface != 0b1111; }

// ---- Facets

// How the dual edge of a facet meets the surface.
struct DualCrossings {
  int count = 0;
  Point ball_center;              // of the largest surface ball
  double squared_radius = 0;      // of that ball
  std::optional<Point> open_end;  // an end that was cut at the reach and lies inside the domain
  double open_radius = 0;
};

struct FacetView {
  DualCrossings dual;
  bool is_on_surface = false;  // all three vertices are
};

// `size`: h at the largest ball's center.
inline bool has_small_balls(const DualCrossings& dual, double size) {
  return dual.squared_radius < size * size;
}

inline std::optional<Condition> judge(const FacetView& facet, const Bounds& bounds) {
  const DualCrossings& dual = facet.dual;
  if (dual.count == 0) return std::nullopt;
  if (!has_small_balls(dual, bounds.sizes.on_surface_at(dual.ball_center))) return kC1;
  if (!facet.is_on_surface) return kC2;
  if (dual.count > 1) return kC4;
  return std::nullopt;
}

// Of the same facet, whatever else it breaks: an open end has a cure of its own.
inline std::optional<Condition> judge_end(const FacetView& facet) {
  return facet.dual.open_end ? std::optional(kC5) : std::nullopt;
}

// ---- Stars of surface vertices

// The edges opposite a surface vertex in its boundary facets. They change places.
struct StarView {
  std::span<LinkEdge> link;
};

// A vertex without boundary facets, inside or unused, breaks nothing.
inline std::optional<Condition> judge(const StarView& star) {
  return star.link.empty() || is_cycle(star.link) ? std::nullopt : std::optional(kC3);
}

// The same where several bodies meet at the vertex.
struct BodyStarView {
  std::span<const BodyLinkEdge> link;
};

inline std::optional<Condition> judge(const BodyStarView& star) {
  return has_cycle_of_each_body(star.link) ? std::nullopt : std::optional(kC3);
}

// Of a vertex that meets C3, whose star is not known as a whole: edges of its link that a change
// takes away, and that it brings.
struct StarChange {
  std::vector<LinkEdge> gone, made;
};

// A disk stays one if a part of its link, a path, gives way to a path between the same ends. Of
// what lies between them, nothing may be in the link already: is_off(w) says so of a vertex w.
template <class IsOff>
std::optional<Condition> judge(const StarChange& star, const IsOff& is_off) {
  if (star.gone.empty() && star.made.empty()) return std::nullopt;
  const auto before = path_of(star.gone), after = path_of(star.made);
  if (!before || !after || before->ends != after->ends) return kC3;
  const bool is_kept = std::ranges::all_of(after->between, [&](Delaunay::Vertex w) {
    return std::ranges::find(before->between, w) != before->between.end() || is_off(w);
  });
  return is_kept ? std::nullopt : std::optional(kC3);
}

}  // namespace locvol
