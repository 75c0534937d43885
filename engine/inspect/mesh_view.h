// MeshView is what it takes to draw a run, cut open by a plane, in bounded memory: leaves, surface,
// cells, sites. A small mesh is there as a whole; of a large one, the cells that meet some planes.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <span>
#include <unordered_map>
#include <vector>

#include "engine/exchange/exchange.h"
#include "engine/inspect/leaf_scan.h"
#include "engine/shared/compensated_sum.h"
#include "octree/geometry.h"
#include "octree/table_hash.h"
#include "storage/store.h"

namespace locvol {

// More than these are not shown. Of leaves and triangles there may be a few times as many before
// they are made fewer.
struct ViewLimits {
  std::uint64_t max_cells = 2'000'000;
  std::uint64_t max_triangles = 300'000;
  std::uint64_t max_leaves = 30'000;
  std::uint64_t max_sites = 5'000;
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
  // Whose the cells are: places in MeshView::leaves, and how many cells, in order.
  std::vector<std::array<std::uint32_t, 2>> leaves;
  std::vector<float> min_dihedral_degrees, radius_edge_ratios, circumradii;  // of each cell
  // Bit i: the facet opposite vertex i is on the boundary of the mesh. Empty unless all cells are
  // there.
  std::vector<std::uint8_t> boundary;
};

// The input surface, closed and oriented as it is. Vertices that fall into one cube of a grid may
// have been joined: the triangles are then fewer, and still each edge has as many on one side as on
// the other.
struct ViewSurface {
  std::vector<Point> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  double grid = 0;  // side of these cubes; 0: the surface as it is
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

  bool has_all_cells() const { return cells.size() == 1 && cells[0].axis == ViewCells::kAll; }
};

// Of a finished run. Of any other, no cells: the leaves and the surface only.
// Memory: what the limits allow, some 100 bytes a cell, and 40 MB. Errors: StoreError,
// CorruptRecord.
// `exchange`: null, if one process has all of the run; else all ranks call it, each for its own
// leaves. The first one gets what a single process gets of all, others leaves and sites alone.
// Memory: the same; on others, some 50 bytes for each of their cells that are shown.
MeshView mesh_view(const Store& store, const ViewLimits& limits = {}, Exchange* exchange = nullptr);

// Planes of the axes at equal distances, as many as `max_cells` allows; none if one is too many.
// `box`: of what they cut; `num_met`: an estimate of the cells that planes meet.
struct ViewPlane {
  int axis = 0;
  double position = 0;
};
std::vector<ViewPlane> view_planes(
    const Box& box, std::uint64_t max_cells,
    const std::function<double(std::span<const ViewPlane> planes)>& num_met);

// Joins what falls into one cube of the grid, at the mean of its corners. Memory depends on the
// number of cubes that the surface passes.
class SurfaceThinner {
 public:
  // The corners in one cube.
  struct Vertex {
    std::uint64_t cube = 0;
    std::array<CompensatedSum, 3> sum;
    std::uint64_t count = 0;
  };
  // How many triangles there are with these vertices, less those turned around.
  struct JoinedTriangle {
    std::array<std::uint32_t, 3> vertices{};
    int num = 0;
  };
  // What has been added, for a thinner with the same grid.
  struct Part {
    std::vector<Vertex> vertices;
    std::vector<JoinedTriangle> triangles;
  };

  SurfaceThinner(const Point& origin, double grid) : origin_(origin), grid_(grid) {}
  void add(const Triangle& triangle);
  void add(const Part& part);
  std::size_t num_vertices() const { return vertices_.size(); }  // never falls
  std::size_t num_triangles() const { return triangles_.size(); }
  double grid() const { return grid_; }
  ViewSurface take();
  Part take_part();  // nothing is left

 private:
  std::uint64_t cube_at(const Point& p) const;
  std::uint32_t vertex_of(std::uint64_t cube);
  void add(JoinedTriangle triangle);

  Point origin_;
  double grid_;
  std::unordered_map<std::uint64_t, std::uint32_t> index_;  // of the cubes; asked, never listed
  std::vector<Vertex> vertices_;
  // JoinedTriangle::num by vertices, which ascend.
  std::unordered_map<std::array<std::uint32_t, 3>, int, TableHash> triangles_;
};

}  // namespace locvol
