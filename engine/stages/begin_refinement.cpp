#include "engine/stages/begin_refinement.h"

#include <cstdint>
#include <vector>

#include "engine/run/core_around.h"

namespace locvol {

void begin_refinement(RunState& state, const StopToken* stop) {
  const auto leaves = state.octree().leaves();
  std::vector<std::uint64_t> num_cells;  // of the core: to count them takes most of the time
  num_cells.reserve(leaves.size());
  for (const MortonKey leaf : leaves) {
    throw_if_stopped(stop);
    num_cells.push_back(state.is_own(leaf) ? num_core_cells(state, leaf) : 0);
    state.leaves().trim();
  }
  for (std::size_t i = 0; i < leaves.size(); ++i) {
    const MortonKey leaf = leaves[i];
    if (state.leaves().info(leaf).num_points > 0) state.queue().enqueue(leaf);
    state.records().put_num_core_cells(leaf, num_cells[i]);
    state.leaves().trim();
  }
}

}  // namespace locvol
