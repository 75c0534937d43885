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
// With what another rank may have to know of sizes to apply it.
LeafDelta with_sizes(RunState& state, LeafDelta delta);

// The same for what the surface in a leaf asks for, in the first epoch of a run whose sizes depend
// on it.
void apply_measure(RunState& state, MortonKey leaf, std::vector<SizedNode> nodes);
// The same for the sizes of a leaf, in the next epoch, if they vary.
void apply_sizes(RunState& state, MortonKey leaf, std::vector<SizeCube> cubes);
// Will the leaf have more points than it is meant to, or too small cells for its width?
bool is_to_be_full(RunState& state, MortonKey leaf);
// Its children wait for the epoch that it waited for. REQUIRES: it has no points yet
void split_empty_leaf(RunState& state, MortonKey leaf);
SizeTotals size_totals(RunState& state, MortonKey leaf);
// The same for the first points of a leaf, in the next epoch of cover mode.
void apply_cover(RunState& state, MortonKey leaf, const CoverPoints& points);
// The points that fill holes, in the epoch after that.
void apply_fill(RunState& state, MortonKey leaf, const FillPoints& points);
// The next epoch, once all leaves have their first points: every leaf with points of its own to
// look at. The core's cells are known, and counted. Throws Stopped before any change.
void enqueue_for_refinement(RunState& state, const StopToken* stop = nullptr);

}  // namespace locvol
