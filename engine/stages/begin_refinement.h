#pragma once

#include "engine/run/run_state.h"
#include "octree/stop.h"

namespace locvol {

// Once all leaves have their first points: every leaf with points of its own to look at waits for
// the next epoch. The core's cells are known, and counted. Throws Stopped before any change.
void begin_refinement(RunState& state, const StopToken* stop);

}  // namespace locvol
