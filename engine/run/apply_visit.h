// What a visit found becomes the run's next state.
#pragma once

#include "engine/run/leaf_loader.h"
#include "engine/run/run_state.h"
#include "refine/cover_leaf.h"
#include "refine/fill_leaf.h"
#include "refine/leaf.h"

namespace locvol {

// Applies the delta of a visit of `leaf` in memory, to be committed: points of the leaf and of its
// neighbors, cells, unresolved sites, counts, the queue; an overfull leaf is split.
// Throws RefineError if the delta contradicts the run; the state is then not to be committed.
void apply_visit(RunState& state, LeafLoader& loader, MortonKey leaf, const LeafDelta& delta);

// The same for the sizes of a leaf, in the first epoch of a run whose sizes vary.
void apply_sizes(RunState& state, MortonKey leaf, std::vector<SizeCube> cubes);
// The same for the first points of a leaf, in the next epoch of cover mode.
void apply_cover(RunState& state, MortonKey leaf, const CoverPoints& points);
// The points that fill holes, in the epoch after that.
void apply_fill(RunState& state, MortonKey leaf, const FillPoints& points);
// The next epoch, once all leaves have their first points: every leaf with points of its own to
// look at. The core's cells are known, and counted. Throws Stopped before any change.
void enqueue_for_refinement(RunState& state, const StopToken* stop = nullptr);

}  // namespace locvol
