// LeafMesh: the Delaunay triangulation of a leaf's local points, seen against the surface: which
// cells belong to the mesh, where dual edges cross the surface. Internal to refine/; home of CGAL's
// triangulation.
#pragma once

#include <CGAL/Delaunay_triangulation_3.h>
#include <CGAL/Delaunay_triangulation_cell_base_3.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_cell_base_with_info_3.h>
#include <CGAL/Triangulation_vertex_base_with_info_3.h>

#include <array>
#include <limits>
#include <map>
#include <optional>
#include <span>
#include <unordered_set>
#include <utility>
#include <vector>

#include "refine/circumcenter.h"
#include "refine/refine_leaf.h"

namespace locvol {

using LocalIndex = std::uint32_t;  // of a local point; not stored anywhere
inline constexpr LocalIndex kInfiniteVertex = std::numeric_limits<LocalIndex>::max();

enum class Side : std::uint8_t {
  kUnknown,  // not asked yet
  kOutside,
  kInside,
  kFar,     // the circumradius is infinite, or beyond what is known to be empty (Criteria::reach)
  kBeyond,  // near, but outside the surface patch: of cells without own vertex only
};

struct CellData {
  Point center;
  double squared_radius = 0;
  std::uint32_t stamp = 0;  // one per cell ever made; 0: dead
  Side side = Side::kUnknown;
  std::uint8_t facets_seen = 0;  // bit i: facet i has been looked at since the cell was made
};

class LeafMesh {
 public:
  using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
  using VertexBase = CGAL::Triangulation_vertex_base_with_info_3<LocalIndex, Kernel>;
  using CellBase =
      CGAL::Triangulation_cell_base_with_info_3<CellData, Kernel,
                                                CGAL::Delaunay_triangulation_cell_base_3<Kernel>>;
  using Tds = CGAL::Triangulation_data_structure_3<VertexBase, CellBase>;
  using Triangulation = CGAL::Delaunay_triangulation_3<Kernel, Tds>;
  using Cell = Triangulation::Cell_handle;
  using Vertex = Triangulation::Vertex_handle;

  struct Facet {
    Cell cell;
    int index = 0;  // of the vertex off the facet
  };

  // How the dual edge of a facet meets the surface.
  struct DualCrossings {
    int count = 0;
    Point ball_center;              // of the largest surface ball
    double squared_radius = 0;      // of that ball
    std::optional<Point> open_end;  // an end that was cut at the reach and lies inside the domain
    double open_radius = 0;
  };

  struct Local {
    MeshPoint point;
    VertexRef ref = 0;
    Vertex vertex;
    bool is_own = false;
    bool is_alive = true;
  };

  explicit LeafMesh(const LeafInput& input);

  // ---- What is there
  const Triangulation& triangulation() const { return triangulation_; }
  const Local& local(LocalIndex i) const { return locals_[i]; }
  std::size_t num_locals() const { return locals_.size(); }
  std::uint64_t num_own() const { return num_own_; }
  std::uint64_t num_cells_made() const { return stamp_; }
  bool has_cells() const { return triangulation_.dimension() == 3; }
  bool is_known(std::uint64_t id) const { return ids_.contains(id); }
  const Point& point(Cell c, int i) const { return locals_[c->vertex(i)->info()].point.position; }
  bool is_finite(Vertex v) const { return v->info() != kInfiniteVertex; }
  bool is_own(Vertex v) const { return is_finite(v) && locals_[v->info()].is_own; }
  bool has_own_vertex(Cell c) const;
  bool has_own_vertex(Facet f) const;

  // ---- The cells and facets against the surface.
  Side side(Cell c) const;
  bool is_member(Cell c) const { return side(c) == Side::kInside; }
  // REQUIRES: neither cell of the facet is kBeyond
  DualCrossings dual_crossings(Facet f) const;

  // ---- Change. Every cell that comes up is put on fresh_cells().
  struct CellRef {
    Cell cell;
    std::uint32_t stamp = 0;
    bool is_alive() const { return cell->info().stamp == stamp; }
  };
  const std::vector<CellRef>& fresh_cells() const { return fresh_; }
  // Whether facets at own vertices may have joined or left the mesh's boundary since the fresh
  // cells were cleared last.
  bool is_boundary_changed() const;
  void clear_fresh_cells();

  // The cells whose circumballs contain q, and the hole's border.
  struct Conflict {
    std::vector<Cell> cells;
    std::vector<std::pair<Cell, int>> border;
    LocalIndex nearest = kInfiniteVertex;
    double squared_distance = std::numeric_limits<double>::infinity();
  };
  void find_conflict(const Point& q, Cell hint, Conflict& conflict) const;
  // `conflict` is that of q.
  LocalIndex insert(const MeshPoint& q, VertexRef ref, const Conflict& conflict);
  // REQUIRES: !has_cells()
  LocalIndex insert_first(const MeshPoint& q, VertexRef ref);
  void remove(LocalIndex i);
  // Volume points closer to q than λ, ascending.
  void volume_points_near(const Point& q, std::vector<LocalIndex>& out) const;
  // Is q, a point near the vertex `i`, in its Voronoi cell?
  bool is_in_voronoi_cell(const Point& q, LocalIndex i) const;
  // Is a point closer to q than `radius`, apart from those `leaving` (ascending)? `nearest` is the
  // point closest to q.
  bool has_other_point_within(const Point& q, double radius, LocalIndex nearest,
                              const std::vector<LocalIndex>& leaving) const;

 private:
  using GridCell = std::array<std::int64_t, 3>;  // cubes of side λ

  GridCell grid_cell(const Point& p) const;
  void add_local(const MeshPoint& p, VertexRef ref);
  void make_fresh(Cell c);
  void make_fresh_in_order();  // new_cells_
  void note_gone(Cell c);
  bool leads_past(Cell c, int index, const Axis& axis) const;
  Point far_end(const Point& axis_center, const Point& direction,
                double squared_circumradius) const;

  const LeafInput& input_;
  double far_radius_;
  std::vector<Local> locals_;
  std::unordered_set<std::uint64_t> ids_;  // of points taken from P; asked, never listed
  std::map<GridCell, std::vector<LocalIndex>> volume_points_;  // and those no longer alive
  std::uint64_t num_own_ = 0;
  std::uint32_t stamp_ = 0;
  Triangulation triangulation_;
  std::vector<CellRef> fresh_;
  std::vector<Cell> new_cells_;
  std::vector<std::pair<std::array<LocalIndex, 4>, Cell>> in_order_;
  bool has_gone_member_ = false, has_gone_other_ = false;  // with an own vertex
  mutable std::vector<Crossing> crossings_;
};

}  // namespace locvol
