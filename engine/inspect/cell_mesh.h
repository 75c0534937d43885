// CellMesh is a small piece of mesh in memory, to be measured and looked at: a leaf's cells.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

#include "engine/shared/cell_quality.h"
#include "octree/geometry.h"

namespace locvol {

struct CellMesh {
  struct Vertex {
    std::int64_t id = -1;  // -1: of a point that has none yet
    Point position;
    PointKind kind = PointKind::kSurface;
    bool is_own = false;  // in the leaf whose cells these are
  };
  std::vector<Vertex> vertices;
  std::vector<std::array<std::uint32_t, 4>> cells;  // positively oriented

  std::array<Point, 4> corners(std::size_t cell) const;
};

// The largest radius, ratio and angle, and the least angle, of the cells; as it is made without
// any.
CellQuality worst_quality(const CellMesh& mesh);

// Cell data: circumradius over `size`, radius_edge_ratio, min_dihedral_degrees,
// max_dihedral_degrees; point data: id, kind (of PointKind), own. Returns the file's size.
std::uint64_t write_vtu(const CellMesh& mesh, double size, const std::filesystem::path& file);

}  // namespace locvol
