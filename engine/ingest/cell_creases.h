// Creases in one cell of a surface's buckets. Whoever looks at an edge or a vertex finds the same:
// all that decides is in each bucket whose closed cell has it.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "engine/ingest/crease_parts.h"
#include "engine/ingest/given_edges.h"
#include "engine/ingest/sharp_edges.h"
#include "engine/ingest/sheet_plan.h"
#include "engine/ingest/triangle_buckets.h"
#include "octree/geometry.h"
#include "octree/morton_key.h"

namespace locvol {

// An edge that other cells have, too.
struct SharedEdge {
  SurfaceName name = kNoName;
  std::uint32_t part = 0;  // of the cell
  bool is_last = false;    // no later cell has it
};

struct CellParts {
  CellCreases creases;
  std::vector<CreasePart> parts;
  std::vector<SharedEdge> shared;
  std::vector<SurfaceCorner> owned;  // corners that the cell owns
};

// Two edges of a crease that meet at a larger angle, in degrees, are two creases.
inline constexpr double kCreaseTurn = 45;

// The edges that are given, those where other than two triangles meet, and if there is an angle,
// those between sheets, and those where the
// surface turns by more than it; and, as corners, the tips of cones: vertices without such edges,
// around which the surface leans by more than the angle on average. `pieces`: what the triangles
// are of, or empty: edges beside strips are none. Edges within a sheet that are not given may be
// noise: they are in parts that hang together at their vertices, and parts that are noise and that
// no other cell has are left out. Others are in none: kNoPart.
inline constexpr CreaseId kNoPart = 0;
CellParts edges_of_cell(std::vector<Triangle> triangles, std::span<const SheetPiece> pieces,
                        MortonKey cell, const TriangleBuckets& buckets, const SharpAngle& angle,
                        const NeedleNormals& needles, const EdgeSet& given, bool has_contacts,
                        double least_extent);

// Of these edges the parts that are chains between corners; a corner is also where other than two
// of them meet, or two that are not of one crease: that turn, or part other sheets, where more than
// two meet.
CellParts chains_of_cell(CellCreases creases, MortonKey cell, const TriangleBuckets& buckets);

}  // namespace locvol
