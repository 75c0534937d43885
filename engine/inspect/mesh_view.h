// MeshView is what it takes to draw a run, cut open by a plane, in bounded memory: leaves, surface,
// cells, sites. A small mesh is there as a whole; of a large one, the cells that meet some planes.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <span>
#include <vector>

#include "engine/exchange/exchange.h"
#include "engine/exchange/one_rank.h"
#include "engine/inspect/leaf_scan.h"
#include "engine/inspect/surface_thinner.h"
#include "octree/crease.h"
#include "octree/geometry.h"
#include "storage/store.h"

namespace locvol {

// How much a view shows. Of leaves and triangles there may be a few times as many before they are
// made fewer.
struct ViewLimits {
  std::uint64_t max_cells = 2'000'000;
  std::uint64_t max_triangles = 300'000;
  std::uint64_t max_leaves = 30'000;
  std::uint64_t max_sites = 5'000;
  std::uint64_t max_creases = 50'000;  // edges of the surface, and corners
};

// A leaf, or a node that stands for the leaves below it if there are too many. Counts with the
// core's.
struct ViewLeaf {
  MortonKey key;
  LeafState state = LeafState::kEmpty;  // of several: the least of them
  std::uint64_t num_leaves = 1;
  std::uint32_t num_visits = 0;  // of several: the most
  std::uint64_t num_points = 0, num_cells = 0, num_insertions = 0, num_unresolved = 0;
};

struct LeafCounts {
  std::uint64_t num_leaves = 0;
  std::map<std::uint64_t, std::uint64_t> by_visits, by_level;  // of leaves that are not empty
};

// Cells with their vertices in the order in which the cells first name them.
struct ViewCells {
  static constexpr int kAll = -1;
  int axis = kAll;      // or those that meet the plane on which this coordinate
  double position = 0;  // is this

  std::vector<Point> vertices;
  std::vector<std::array<std::uint32_t, 4>> cells;  // positively oriented
  // Whose the cells are: places in MeshView::leaves, and how many cells each has, in order.
  std::vector<std::array<std::uint32_t, 2>> leaves;
  std::vector<float> min_dihedral_degrees, radius_edge_ratios, circumradii;  // of each cell
  // Where there are several: bodies, and how many cells each has, in order.
  std::vector<std::array<std::uint32_t, 2>> bodies;
  // Bit i: the facet opposite vertex i is on the boundary of the mesh, or, with bit i + 4, between
  // two bodies. Empty unless all cells are there.
  std::vector<std::uint8_t> boundary;
  // Of these facets, in the order of their bits: the sheet of each, where there are several; 0:
  // that is not known.
  std::vector<SheetId> sheets;
};

struct ViewSite {
  UnresolvedSite site;     // or, of condition 7, a poor cell's ball
  std::uint32_t leaf = 0;  // place in MeshView::leaves
};

struct MeshView {
  LeafCounts leaf_counts;
  std::vector<ViewLeaf> leaves;  // without empty ones, in Morton order
  std::vector<ViewCells> cells;  // one with all cells; or by axis and position; none: see below
  ViewSurface surface;           // left out if all cells are there
  std::vector<ViewSite> sites;
  std::vector<CreaseEdge> creases;  // of the surface
  std::vector<CornerPoint> corners;
  SurfaceSheets sheets;

  bool has_all_cells() const { return cells.size() == 1 && cells[0].axis == ViewCells::kAll; }
};

// The view of a finished run. Of any other, it has no cells: the leaves and the surface only.
// Memory: what the limits allow, some 100 bytes a cell, and 40 MB. Errors: StoreError,
// CorruptRecord.
// `exchange`: of the ranks that have the run together, which all call it, each for its own leaves.
// The first one gets what a single process gets of all, others leaves and sites alone. Memory: the
// same; on others, some 50 bytes for each of their cells that are shown.
MeshView mesh_view(const Store& store, const ViewLimits& limits = {}, Exchange& exchange = alone());

// Planes of the axes at equal distances, as many as `max_cells` allows; none if one is too many.
// `box`: of what they cut; `num_met`: an estimate of the cells that planes meet.
struct ViewPlane {
  int axis = 0;
  double position = 0;
};
std::vector<ViewPlane> view_planes(
    const Box& box, std::uint64_t max_cells,
    const std::function<double(std::span<const ViewPlane> planes)>& num_met);

}  // namespace locvol
