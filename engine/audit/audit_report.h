// What the audit of a mesh has found.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "octree/geometry.h"
#include "octree/morton_key.h"

namespace locvol {

struct AuditReport {
  std::uint64_t num_leaves = 0, num_checked_leaves = 0;  // fewer, if it is a sample
  bool is_sample() const { return num_checked_leaves < num_leaves; }
  // Facets alone: what is said of cells is not asked.
  bool is_surface_only = false;
  // What was checked is counted here.
  std::uint64_t num_cells = 0, num_vertices = 0, num_boundary_facets = 0, num_boundary_vertices = 0;
  double volume = 0, surface_volume = 0;
  std::vector<double> body_volumes, surface_body_volumes;  // by body, where there are several
  double max_circumradius = 0;     // over λ, of cells, or in runs of the surface alone of facets
  double min_facet_degrees = 180;  // the smallest angle of a facet there
  double max_radius_edge_ratio = 0;
  double min_dihedral_degrees = 180, max_dihedral_degrees = 0;
  MortonKey worst_leaf;  // of the cell with the smallest angle
  Point worst_place;     // the center of its circumball
  // Cells with an angle below what the run asks for. No violations: such a cell stays where nothing
  // helps it.
  double min_dihedral_bound = 0;  // 0: any
  std::uint64_t num_poor_cells = 0;
  double max_surface_distance = 0;  // of a boundary vertex, over λ
  // Facts of the mesh's boundary; `surface_…`: of the input. A difference is no violation: parts of
  // the input smaller than λ may be lost.
  std::int64_t euler_characteristic = 0, surface_euler_characteristic = 0;
  std::uint64_t num_components = 0, surface_num_components = 0;
  // Of creases, if the run keeps them: from point to point along them, and what of it is no edge of
  // the mesh. Then they are as long as the input's.
  double crease_length = 0, lost_crease_length = 0, surface_crease_length = 0;
  std::uint64_t num_unresolved = 0;  // as listed in the store
  // Near unresolved sites, and so no violations: cells too large or badly shaped, boundary vertices
  // off the surface, lost creases. Boundary and cells fit together there as everywhere.
  std::uint64_t num_open = 0;

  // Violations, counted; the first few of each kind are described in `violations` with leaf and
  // coordinates. Bounds allow for rounding, a relative 1e-9; signs and emptiness are exact.
  std::uint64_t num_nonempty_circumballs = 0;
  std::uint64_t num_overused_facets = 0;        // in more than two cells, or twice on one side
  std::uint64_t num_bad_boundary_edges = 0;     // not in exactly two boundary facets
  std::uint64_t num_bad_boundary_vertices = 0;  // link is not a single cycle
  std::uint64_t num_wrong_facets = 0;           // listed as boundary and none, or not listed
  // Of runs of the surface alone: facets whose circumradius is above h, by h within it; edges whose
  // two facets face other ways.
  std::uint64_t num_large_facets = 0, num_misoriented_edges = 0;
  std::uint64_t num_off_surface_vertices = 0;  // boundary vertices not on the surface
  std::uint64_t num_large_cells = 0;           // circumradius >= λ
  // Radius-edge ratio above the bound, if the shortest edge does not lead from sheet to sheet.
  std::uint64_t num_badly_shaped_cells = 0;
  std::uint64_t num_lost_creases = 0;       // between two points, or two leaves: no edge
  std::uint64_t num_lost_corners = 0;       // of creases: no vertex
  std::uint64_t num_misoriented_cells = 0;  // flat or negative
  std::uint64_t num_repeated_cells = 0;
  std::uint64_t num_misplaced_cells = 0;   // their smallest vertex is not of their leaf
  std::uint64_t num_unknown_vertices = 0;  // named by a cell, but in no leaf within 2λ
  std::uint64_t num_misplaced_points = 0;  // outside the box of their leaf, or not finite
  std::uint64_t num_repeated_points = 0;   // an id or a position that came before, within 2λ
  std::uint64_t num_run_faults = 0;        // not finished; leaves that do not tile the root
  std::vector<std::string> violations;

  friend bool operator==(const AuditReport&, const AuditReport&) = default;

  std::uint64_t num_violations() const {
    return num_nonempty_circumballs + num_overused_facets + num_bad_boundary_edges +
           num_bad_boundary_vertices + num_wrong_facets + num_large_facets + num_misoriented_edges +
           num_off_surface_vertices + num_large_cells + num_badly_shaped_cells + num_lost_creases +
           num_lost_corners + num_misoriented_cells + num_repeated_cells + num_misplaced_cells +
           num_unknown_vertices + num_misplaced_points + num_repeated_points + num_run_faults;
  }
  // No violation, and at least one cell or facet, unless it is a sample.
  bool is_valid() const {
    return num_violations() == 0 && (num_cells + num_boundary_facets > 0 || is_sample());
  }
};

}  // namespace locvol
