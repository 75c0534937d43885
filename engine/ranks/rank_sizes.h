// What ranks tell each other where sizes vary: of the surface that is far from their leaves, of
// leaves that they split, and of sums.
#pragma once

#include <span>
#include <vector>

#include "engine/exchange/exchange.h"
#include "engine/run/leaf_loader.h"
#include "engine/run/run_state.h"
#include "refine/far_surface.h"

namespace locvol {

// Each is called by all ranks.

// Adds what the rank's leaves may ask of other ranks' surface, and of the sizes that it asks for:
// the less, the farther it is. Memory: messages.
void share_far_surface(RunState& state, LeafLoader& loader, FarSurface& far, Exchange& exchange);

// The rank has split these own leaves, each with `ranks` that have copies, by split_empty_leaf():
// all do so.
struct SplitLeaf {
  MortonKey leaf;
  std::vector<int> ranks;
};
void share_splits(RunState& state, const std::vector<SplitLeaf>& split, Exchange& exchange);

SizeTotals total_sizes(const SizeTotals& own, Exchange& exchange);

}  // namespace locvol
