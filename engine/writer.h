// Streams the finished mesh out of a store.
#pragma once

#include <cstdint>
#include <filesystem>

#include "engine/step_progress.h"
#include "storage/store.h"

namespace locvol {

struct WriteSummary {
  std::uint64_t num_vertices = 0, num_cells = 0, bytes = 0;
};

// Writes VTU (XML, appended raw binary, UInt64 headers, 64-bit ids): used vertices, numbered leaf
// by leaf in Morton order; tetrahedra in the same order, positively oriented; cell data `leaf` (the
// leaf's place in Morton order). The file appears under its name only when it is whole.
// Memory: one leaf and the id tables of its neighbors, and for each thread a mebibyte or a leaf
// more. Steps are cells. Throws StoreError; std::runtime_error with the file's name when it cannot
// be written.
WriteSummary write_vtu(const Store& store, const std::filesystem::path& file, int num_threads = 1,
                       const StepProgress& on_step = {});

}  // namespace locvol
