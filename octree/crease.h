// Where the surface is sharp, or its sheets meet: to be kept by the mesh.
#pragma once

#include <array>
#include <cstdint>

#include "octree/geometry.h"
#include "octree/mesh_facet.h"

namespace locvol {

// A chain of sharp edges between two corners, or a closed one. Ids count from 1.
using CreaseId = std::uint32_t;

// An edge of the surface that is part of a crease. Ends, which are different, tell edges apart, and
// edges are listed in the order of these.
struct CreaseEdge {
  std::array<Point, 2> ends;               // the lexicographically smaller one first
  std::array<bool, 2> is_corner{};         // is that end a corner?
  std::array<SheetId, 2> sheets = {1, 1};  // of the triangles on its sides, the smaller first
  CreaseId crease = 1;

  // Does the edge end within a sheet, or run through it?
  bool is_within_sheet() const { return sheets[0] == sheets[1]; }
  Box box() const { return Box::around(ends[0]).joined(ends[1]); }
  Triangle as_triangle() const {
    return {.id = 0, .corners = {ends[0], ends[1], ends[1]}};
  }  // flat
  friend bool operator==(const CreaseEdge&, const CreaseEdge&) = default;
};

// A vertex of the surface that is to be one of the mesh: an end of creases, or the tip of a cone,
// where there are none.
struct CornerPoint {
  Point position;
  std::uint32_t corner = 1;  // its id, from 1 on; they are listed in the order of these
  friend bool operator==(const CornerPoint&, const CornerPoint&) = default;
};

}  // namespace locvol
