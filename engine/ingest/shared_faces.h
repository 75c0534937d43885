// Surfaces of several bodies whose faces between two of them are given once: which regions of space
// they bound.
//
// At each edge the triangles are put in order around it, exactly: between one and the next lies the
// same region. So sides of triangles hang together, cell by cell, and then across cells, and what
// they enclose has a volume: positive where they are the outer boundary of a region, which is a
// body. Then each triangle is given once with each body that it bounds, as where each body brings
// its own.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "engine/ingest/ingest_watch.h"
#include "engine/ingest/surface_check.h"
#include "engine/ingest/triangle_buckets.h"
#include "engine/ingest/triangle_spill.h"
#include "engine/shared/workers.h"
#include "octree/geometry.h"

namespace locvol {

// Why there are no regions.
struct FaceObstacle {
  enum class Kind {
    kOpen,    // an edge is of this triangle alone
    kFold,    // it lies on another one, but for its corners
    kWithin,  // the same region lies on both of its sides
    kThin,    // it bounds a region of no volume, to within rounding errors
  };
  Kind kind = Kind::kOpen;
  Triangle triangle;
};

struct RegionFaces {
  std::optional<FaceObstacle> obstacle = {};  // of the first triangle that has one: nothing is done
  std::uint64_t num_shared = 0;               // triangles with a region on both of their sides
  TriangleList triangles = {};                // in order of id, those of pieces (kMostPieces)
  std::vector<std::uint32_t> region_of_group = {};  // by Triangle::sheet, from 1 on
  std::vector<SheetId> group_before = {};           // likewise, what it was
  // Of each region, which of the bodies that are given all triangles have that bound it alone;
  // null: several have them, or there are none.
  std::vector<std::optional<std::uint32_t>> given_body = {};
};

// `given`: by group, what names a region. `buckets` have the surface, whole, in `spill`. Of
// triangles at one place the first stands for all. Regions are numbered by their first triangles.
// Memory: 24 MB, 100 bytes for each part of a region in a cell, and what a cell takes for each
// thread. Throws std::system_error, Stopped.
RegionFaces faces_of_regions(TriangleSpill& spill, const TriangleBuckets& buckets,
                             std::span<const std::uint32_t> given, const Box& box, bool has_pieces,
                             IngestWatch& watch, Workers& workers);

}  // namespace locvol
