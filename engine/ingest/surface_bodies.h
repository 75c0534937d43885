// The bodies of a surface: which of its components bound which, and what lies in what.
#pragma once

#include <vector>

#include "engine/ingest/ingest_watch.h"
#include "engine/ingest/surface_input.h"
#include "engine/shared/workers.h"
#include "storage/records.h"

namespace locvol {

// At most so many.
inline constexpr std::size_t kMaxBodies = 10'000;

// From here on, load() gives triangles with their changes of the state, and what is a group is of
// one pair of bodies. Without a law there is one body, nothing is looked at, and none is told.
// Memory: 100 bytes a part of a component in a cell, and what a cell takes for each thread. Throws
// InputError, where a body bounds nothing, or a name is none of a body; std::system_error, Stopped.
// REQUIRES: one process has all of the surface
std::vector<BodyFacts> number_bodies(CheckedSurface& surface, const BodyLaw& law,
                                     IngestWatch& watch, Workers& workers);

}  // namespace locvol
