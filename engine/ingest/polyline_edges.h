// Which edges of a surface polylines run along.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "engine/ingest/ingest_share.h"
#include "engine/ingest/ingest_watch.h"
#include "engine/ingest/surface_input.h"
#include "engine/shared/workers.h"

namespace locvol {

struct GivenPolylines {
  std::filesystem::path file;  // empty: none are given
  std::string digest;          // that the run knows them by
  // Points of the surface that are closer to each other have become one; see RunParameters::weld.
  std::optional<double> weld = {};
};

// Points of polylines are vertices of the surface that are closer than this, over the longest side
// of its box: of several, the closest one. Coordinates in a text file have six digits or more.
inline constexpr double kPolylineTolerance = 1e-5;

// From here on, surface.given has the edges. Each piece of a polyline from point to point is an
// edge of the surface, or a chain of edges that are no farther from it than points may be.
// Memory: that of five sorts (SortedSpill), however many there are; what a cell takes for each
// thread; and 40 MB where a piece is a chain of 100,000 edges, more than which none may have.
// Throws InputError, with file, line and coordinates, for what is no vertex or no chain of edges,
// and where the file is another one by now; std::system_error, Stopped.
void find_given_edges(CheckedSurface& surface, const GivenPolylines& polylines, IngestWatch& watch,
                      Workers& workers, const IngestShare& share);

}  // namespace locvol
