// The creases of a run's surface as a file to look at.
#pragma once

#include <cstdint>
#include <filesystem>

#include "engine/inspect/run_part.h"
#include "storage/records.h"

namespace locvol {

// Edges of creases as lines, with the cell data `crease` and `sheet`, `other_sheet` of their sides;
// corners as vertices, with `corner`. Elsewhere these are 0. Called by all ranks, written by the
// first, which returns the numbers of both and of bytes. Memory: there 100 bytes for each edge.
// Errors as PartialFile.
struct WrittenCreases {
  std::uint64_t num_edges = 0, num_corners = 0, bytes = 0;
};
WrittenCreases write_creases_vtu(const RunPart& part, const RunRecord& run,
                                 const std::filesystem::path& file);

}  // namespace locvol
