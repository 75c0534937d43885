// `locvol report`: one page about a run, which needs nothing but a browser.
#pragma once

#include <cstdint>
#include <filesystem>

#include "engine/exchange/exchange.h"
#include "engine/exchange/one_rank.h"
#include "engine/inspect/mesh_view.h"
#include "storage/store.h"

namespace locvol {

struct PageSummary {
  std::uint64_t bytes = 0;
  std::uint64_t num_cells = 0;  // that the page can show
  std::uint64_t num_mesh_cells = 0;
};

// Writes the page about a run that has begun. `num_threads`: to measure the cells with.
// Memory: as mesh_view() and mesh_statistics(). Errors: as those, and as PartialFile: the file
// appears only when it is whole.
// `exchange`: of the ranks that have the run together: all call it, and the first one writes and
// tells.
PageSummary write_page(const Store& store, const std::filesystem::path& file,
                       const ViewLimits& limits, int num_threads, Exchange& exchange = alone());

}  // namespace locvol
