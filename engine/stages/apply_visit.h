// What a visit that refines found becomes the run's next state.
#pragma once

#include "engine/run/run_state.h"
#include "engine/run/whole_model.h"
#include "refine/leaf.h"

namespace locvol {

// Applies the delta of a visit of `leaf` in memory, to be committed: points of the leaf and of its
// neighbors, cells, unresolved sites, counts, the queue; an overfull leaf is split.
// Throws RefineError if the delta contradicts the run; the state is then not to be committed.
void apply_visit(RunState& state, HeldModel& model, MortonKey leaf, const LeafDelta& delta);
// With what another rank may have to know of sizes to apply it.
LeafDelta with_sizes(const RunView& run, LeafDelta delta);

}  // namespace locvol
