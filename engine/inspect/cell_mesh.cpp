#include "engine/inspect/cell_mesh.h"

#include <algorithm>

#include "engine/formats/mesh_arrays.h"
#include "engine/inspect/vtu_file.h"

namespace locvol {

std::array<Point, 4> CellMesh::corners(std::size_t cell) const {
  std::array<Point, 4> corners;
  for (std::size_t i = 0; i < 4; ++i) corners[i] = vertices[cells[cell][i]].position;
  return corners;
}

CellQuality worst_quality(const CellMesh& mesh) {
  CellQuality worst;
  for (std::size_t i = 0; i < mesh.cells.size(); ++i) {
    const CellQuality q = quality_of(mesh.corners(i));
    worst.circumradius = std::max(worst.circumradius, q.circumradius);
    worst.radius_edge_ratio = std::max(worst.radius_edge_ratio, q.radius_edge_ratio);
    worst.min_dihedral_degrees = std::min(worst.min_dihedral_degrees, q.min_dihedral_degrees);
    worst.max_dihedral_degrees = std::max(worst.max_dihedral_degrees, q.max_dihedral_degrees);
  }
  return worst;
}

std::uint64_t write_vtu(const CellMesh& mesh, double size, const std::filesystem::path& file) {
  const std::size_t num_vertices = mesh.vertices.size(), num_cells = mesh.cells.size();
  std::vector<CellQuality> qualities(num_cells);
  for (std::size_t i = 0; i < num_cells; ++i) qualities[i] = quality_of(mesh.corners(i));
  VtuGrid grid;
  grid.num_points = num_vertices;
  grid.cells = {{.type = kVtkTetra, .num_vertices = 4, .num = num_cells}};
  grid.point = [&](std::size_t i) { return mesh.vertices[i].position; };
  grid.vertex = [&](std::size_t cell, std::size_t i) {
    return static_cast<std::int64_t>(mesh.cells[cell][i]);
  };
  // No bytes: VTK takes those for colors.
  grid.point_data = {
      vtu_array("id", num_vertices, [&](std::size_t i) { return mesh.vertices[i].id; }),
      vtu_array("kind", num_vertices,
                [&](std::size_t i) { return static_cast<std::int64_t>(mesh.vertices[i].kind); }),
      vtu_array("own", num_vertices,
                [&](std::size_t i) { return std::int64_t{mesh.vertices[i].is_own}; })};
  grid.cell_data = {vtu_array("circumradius", num_cells,
                              [&](std::size_t i) { return qualities[i].circumradius / size; }),
                    vtu_array("radius_edge_ratio", num_cells,
                              [&](std::size_t i) { return qualities[i].radius_edge_ratio; }),
                    vtu_array("min_dihedral_degrees", num_cells,
                              [&](std::size_t i) { return qualities[i].min_dihedral_degrees; }),
                    vtu_array("max_dihedral_degrees", num_cells,
                              [&](std::size_t i) { return qualities[i].max_dihedral_degrees; })};
  return write_vtu_grid(grid, file);
}

}  // namespace locvol
