// Refinement begins, and what a visit found becomes the run's next state.
#pragma once

#include "engine/run/run_state.h"
#include "engine/run/whole_model.h"
#include "octree/stop.h"
#include "refine/leaf.h"

namespace locvol {

// Once all leaves have their first points: every leaf with points of its own to look at waits for
// the next epoch. The core's cells are known, and counted. Throws Stopped before any change.
void begin_refinement(RunState& state, const StopToken* stop);

// Applies the delta of a visit of `leaf` in memory, to be committed: points of the leaf and of its
// neighbors, cells, unresolved sites, counts, the queue; an overfull leaf is split.
// Throws RefineError if the delta contradicts the run; the state is then not to be committed.
void apply_visit(RunState& state, HeldModel& model, MortonKey leaf, const LeafDelta& delta);
// With what another rank may have to know of sizes to apply it.
LeafDelta with_sizes(const RunView& run, LeafDelta delta);

}  // namespace locvol
