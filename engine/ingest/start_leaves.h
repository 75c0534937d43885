// Which leaves a run starts with: small ones near the surface and inside, large ones elsewhere.
#pragma once

#include <cstdint>
#include <vector>

#include "engine/ingest/ingest_share.h"
#include "engine/ingest/ingest_watch.h"
#include "engine/ingest/surface_input.h"
#include "octree/octree.h"

namespace locvol {

// The cells that the surface may come nearer than h, in Morton order (StartSides::is_narrow): the
// leaves that may get surface points, however these are rounded. Those inside are found by their
// sides, later. Memory: 32 MB. Throws InputError, with the cure, if there will be more than 2
// million leaves; Stopped. All that all processes find, each near the triangles of its share.
std::vector<MortonKey> cells_near_surface(const CheckedSurface& surface,
                                          const RunParameters& parameters, IngestWatch& watch,
                                          const IngestShare& share = IngestShare());

}  // namespace locvol
