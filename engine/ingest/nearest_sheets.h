// Sheets that sizes are given for by a place: the one that is closest to it.
#pragma once

#include <vector>

#include "engine/ingest/ingest_share.h"
#include "engine/ingest/ingest_watch.h"
#include "engine/ingest/surface_input.h"
#include "storage/records.h"

namespace locvol {

// SurfaceSheets::nearest, once sheets are numbered. Of sheets as close as others it is the one with
// the least id. Where no size is given by a place, the surface is not looked at. Throws
// std::system_error, Stopped.
std::vector<SheetId> nearest_sheets(const CheckedSurface& surface,
                                    const std::vector<PartSize>& sheet_sizes, IngestWatch& watch,
                                    const IngestShare& share);

}  // namespace locvol
