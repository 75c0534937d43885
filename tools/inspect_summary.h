// `locvol inspect DIR`: the run as a whole.
#pragma once

#include <cstdint>

#include "engine/inspect/run_part.h"
#include "tools/results.h"

namespace locvol {

// What `locvol inspect DIR --json` prints of a run that one process makes.
Json inspected(const RunPart& whole, bool reads_all);
// Called by all ranks, of which the first prints it; returns how many damaged records this one met.
// `reads_all`: looks at every record.
std::uint64_t inspect_summary(const RunPart& part, bool reads_all, bool is_json);

}  // namespace locvol
