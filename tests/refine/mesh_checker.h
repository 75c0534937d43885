// Judges the result of refinement from its points alone: an own Delaunay triangulation of all of
// P, own circumcenters, sides and crossings.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "octree/geometry.h"
#include "tests/refine/shapes.h"

namespace locvol {

// A cell by its vertices' positions, ascending: the same in whatever order P is listed.
using CellKey = std::array<Point, 4>;
CellKey key_of(CellKey vertices);

struct BrokenCondition {
  int condition = 0;  // 1 … 6, of refine/ALGORITHM.md
  Point position;
  double radius = 0;
};

class MeshChecker {
 public:
  // `surface` is closed. REQUIRES: points differ, and do not all lie in a plane
  MeshChecker(const std::vector<MeshPoint>& points, const shapes::Mesh& surface);
  MeshChecker(const MeshChecker&) = delete;
  MeshChecker& operator=(const MeshChecker&) = delete;
  ~MeshChecker();

  // The Delaunay cells whose circumcenters are inside, ascending.
  std::vector<CellKey> inside_cells() const;
  // Where C1 to C6 do not hold.
  std::vector<BrokenCondition> broken_conditions(double size, double radius_edge_bound) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Indices into the points; positively oriented if it is to be a mesh.
using IndexedCell = std::array<std::size_t, 4>;

// What is wrong with the cells as a mesh with a boundary that is a 2-manifold on the surface: a
// facet in more than two cells, an edge or a vertex around which the boundary is no disk, a
// boundary vertex off the surface. Empty if nothing.
std::string manifold_fault(const std::vector<IndexedCell>& cells,
                           const std::vector<MeshPoint>& points);
// Vertices - edges + facets of the boundary.
long boundary_euler_characteristic(const std::vector<IndexedCell>& cells);
// Of the boundary's triangles, in degrees.
double smallest_boundary_angle(const std::vector<IndexedCell>& cells,
                               const std::vector<MeshPoint>& points);

}  // namespace locvol
