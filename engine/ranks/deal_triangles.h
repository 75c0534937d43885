// Triangles of a surface go from the ranks that have read them to those that judge them, and cut
// them by leaves.
#pragma once

#include <cstdint>
#include <span>

#include "engine/exchange/exchange.h"
#include "engine/ingest/ingest_watch.h"
#include "engine/ingest/surface_input.h"
#include "engine/ranks/common_stop.h"
#include "octree/frame.h"
#include "octree/shares.h"

namespace locvol {

// Both are called by all ranks, each with the part of a surface that it has read, whose ids count
// on from `first_id`.

// With about as many triangles each, cut where nodes of `level` begin: by a sample of them, whose
// places all ranks have. Memory: 512 KiB for these.
Shares shares_of_triangles(const RawSurface& part, std::uint64_t first_id,
                           std::uint64_t num_triangles, const Frame& frame, int level,
                           Exchange& exchange);

// Then the rank has all triangles that may meet its share, and none else, as a list from each rank.
// `groups`: by those of the rank's part, the numbers of groups in the whole surface.
// Memory: a message to each rank, and 32 KB for each. Throws std::system_error, Stopped.
void deal_triangles(RawSurface& surface, std::uint64_t first_id, std::span<const SheetId> groups,
                    const Frame& frame, const Shares& shares, Exchange& exchange, CommonStop& stop,
                    IngestWatch& watch);

}  // namespace locvol
