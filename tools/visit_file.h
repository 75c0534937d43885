// A visit in a file, so that what went wrong in one run can be repeated elsewhere, without its
// store.
#pragma once

#include <filesystem>

#include "engine/inspect/replay.h"

namespace locvol {

// JSON; numbers as they are, to the last bit. The file appears only when it is whole.
void write_visit(const StoredVisit& visit, const std::filesystem::path& file);
// Throws std::runtime_error on a file that write_visit() did not write, and what is wrong with it.
StoredVisit read_visit(const std::filesystem::path& file);

}  // namespace locvol
