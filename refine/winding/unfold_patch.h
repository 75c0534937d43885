// Takes folds out of what closes holes. Internal to refine/winding.
#pragma once

#include <cstddef>

#include "refine/winding/chain.h"

namespace locvol {

// Triangles between the rim of a hole and the level over it may lie folded back on each other, or
// on what is beside them: their corners are what there is. Where two of those that close holes
// (kOverHole) turn by more than 135 degrees against each other or a neighbor, their edge goes to
// their two other corners, if none of these five turns by more than 90 degrees then. What is closed
// stays closed. Returns how many edges went.
std::size_t unfold_patch(Chain& chain);

}  // namespace locvol
