// `locvol inspect DIR`: the run as a whole.
#pragma once

#include <cstdint>

#include "engine/inspect/run_part.h"

namespace locvol {

// Called by all ranks, of which the first prints it; returns how many damaged records this one met.
// `reads_all`: looks at every record.
std::uint64_t inspect_summary(const RunPart& part, bool reads_all, bool is_json);

}  // namespace locvol
