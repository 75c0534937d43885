// Takes folds out of what closes holes. Internal to refine/winding.
#pragma once

#include <cstddef>

#include "refine/winding/chain.h"

namespace locvol {

// Triangles between the rim of a hole and the level over it may lie folded back on each other, or
// on what is beside them: their corners are what there is. Where two of those that close holes
// (kOverHole) meet at more than 100 degrees, or meet their neighbors so, their edge is turned to
// the two other corners, if the largest of these five angles gets smaller by 20 degrees and more.
// What is closed stays closed. Returns how many edges were turned.
std::size_t unfold_patch(Chain& chain);

}  // namespace locvol
