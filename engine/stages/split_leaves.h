// Leaves that are too much are split before they have points, or are visited.
#pragma once

#include <functional>
#include <vector>

#include "engine/run/leaf_stage.h"
#include "engine/run/run_state.h"
#include "engine/stages/stages.h"

namespace locvol {

// The leaf's points, surface, sizes and the state of its center go to its children.
void split_leaf(RunState& state, MortonKey leaf);

// The step that splits those of the leaves that `find` gives, and their parts, that are the rank's
// own and too much: all ranks that have copies split them, too. REQUIRES: they have no points yet
LeafStage::Step splitting(const StageTools& tools, std::function<std::vector<MortonKey>()> find,
                          std::function<bool(MortonKey leaf)> is_too_much);

// The same of leaves that ask for so many sizes that a visit would be too large: for more than
// most_pieces(). `share`: of that; above 1, a leaf is too much. Throws InputError: there are too
// many.
LeafStage::Step splitting_rich(const StageTools& tools, std::function<double(MortonKey)> share);
std::uint64_t most_pieces(const RunParameters& parameters);
// Of the sizes that the leaf is known to ask for.
double share_of_nodes(const RunView& run, MortonKey leaf);

}  // namespace locvol
