// What a cell of a surface's buckets knows of creases, and what of one crease several cells have.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "engine/ingest/part_joiner.h"
#include "engine/shared/compensated_sum.h"
#include "octree/crease.h"
#include "octree/geometry.h"
#include "octree/mesh_facet.h"

namespace locvol {

// Of a vertex or an edge of the surface: 3 t + k is corner k of the triangle with id t, and the
// edge from there to the next corner. The least of all that it could be called.
using SurfaceName = std::uint64_t;
inline constexpr SurfaceName kNoName = std::numeric_limits<SurfaceName>::max();

// An edge that may be part of a crease. A cell has those that meet its closed box.
struct CellEdge {
  CreaseEdge edge;                         // its crease: the part that it is in
  SurfaceName name = kNoName;              // the same in all cells
  std::array<SurfaceName, 2> end_names{};  // the same in all cells whose closed box has the end
  bool is_given = false;                   // sharp, whatever its angle
  // Where more than two triangles meet, a hash of their sheets; else 0.
  std::uint64_t junction = 0;
};

struct SurfaceCorner {
  SurfaceName name = kNoName;
  Point position;
  friend bool operator==(const SurfaceCorner&, const SurfaceCorner&) = default;
};

// A cell has the corners in its closed box.
struct CellCreases {
  std::vector<CellEdge> edges;
  std::vector<SurfaceCorner> corners;
};

// Edges that hang together, or those of them that are counted in one cell.
struct CreasePart {
  SurfaceName first_edge = kNoName;
  std::uint64_t num_edges = 0;
  CompensatedSum length = {};
  std::uint64_t num_ends = 0;  // of its edges, where they are corners
  Box box;                     // of all its edges in the cells
  std::array<SheetId, 2> sheets = {1, 1};
  std::array<SurfaceName, 2> corners = {kNoName, kNoName};  // where it ends, as far as known

  // Edges that hang together are noise if they are in a small place, or in short chains.
  bool is_noise(double least_extent) const {
    return norm(box.max - box.min) < least_extent ||
           2 * length.value() < least_extent * static_cast<double>(num_ends);
  }

  void add_corner(SurfaceName corner) { corners[corners[0] == kNoName ? 0 : 1] = corner; }
  void add(const CreasePart& other, bool /*is_turned*/) {
    first_edge = std::min(first_edge, other.first_edge);
    num_edges += other.num_edges;
    length.add(other.length);
    num_ends += other.num_ends;
    box = box.joined(other.box);
    for (const SurfaceName corner : other.corners)
      if (corner != kNoName) add_corner(corner);
  }
};

// Of the creases of a surface, the parts that a process knows.
struct CreasePieces {
  JoinedParts<CreasePart> joined;
  std::vector<std::uint32_t> places;   // by part of this process, its place among all
  std::vector<SurfaceCorner> corners;  // each in one cell
  bool is_too_many = false;            // then nothing else is known
};

}  // namespace locvol
