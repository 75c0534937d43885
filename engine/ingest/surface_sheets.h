// The sheets of a surface: what of a named group hangs together by edges that are not sharp.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "engine/ingest/ingest_share.h"
#include "engine/ingest/ingest_watch.h"
#include "engine/ingest/sheet_plan.h"
#include "engine/ingest/surface_input.h"
#include "engine/shared/workers.h"
#include "storage/records.h"

namespace locvol {

// More sharp edges than this, and more components or sheets than kMaxSheets, are noise: then sheets
// are the named groups, and a note says so.
inline constexpr std::uint64_t kMaxSharpEdges = 1'000'000;

// From here on, load() gives triangles with their sheets. A surface that is one sheet and has no
// name gives none; if nothing hints at others, it is not looked at.
// Memory: 64 bytes a part of a sheet in a cell, 32 a border of two, as much for what parts join to,
// and what a cell takes for each thread. Throws std::system_error, Stopped.
SurfaceSheets number_sheets(CheckedSurface& surface, const SheetLaw& law, IngestWatch& watch,
                            Workers& workers, const IngestShare& share);

}  // namespace locvol
