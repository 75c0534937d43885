// Streams the finished mesh out of a store, in any format.
#pragma once

#include <cstdint>
#include <filesystem>

#include "engine/formats/mesh_format.h"
#include "engine/shared/step_progress.h"
#include "octree/stop.h"
#include "storage/store.h"

namespace locvol {

struct WriteSummary {
  std::uint64_t num_vertices = 0, num_cells = 0, bytes = 0;
  std::uint64_t num_boundary_facets = 0;  // of formats that hold the boundary
};

// Writes the used vertices, numbered leaf by leaf in Morton order, and tetrahedra in the same
// order, positively oriented; or the boundary alone. What each format holds: formats/formats.h. The
// file appears under its name only when it is whole.
// Memory: one leaf and the id tables of its neighbors, and for each thread a mebibyte or a leaf
// more. Steps are cells. Throws StoreError; FormatLimit before a byte is written;
// std::runtime_error with the file's name when it cannot be written; Stopped, with nothing written.
WriteSummary write_mesh(const Store& store, const std::filesystem::path& file,
                        const OutputOptions& options, int num_threads = 1,
                        const StepProgress& on_step = {}, const StopToken* stop = nullptr);
// The same as VTU, without the quality.
WriteSummary write_vtu(const Store& store, const std::filesystem::path& file, int num_threads = 1,
                       const StepProgress& on_step = {});

}  // namespace locvol
