// `locvol inspect DIR`: the run as a whole.
#pragma once

#include <cstdint>

#include "storage/store.h"

namespace locvol {

// Prints it; returns how many damaged records it met. `reads_all`: looks at every record.
std::uint64_t inspect_summary(const Store& store, bool reads_all, bool is_json);

}  // namespace locvol
