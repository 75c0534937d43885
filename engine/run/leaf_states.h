// In which bodies the center of each leaf's box lies, found without rays through the model.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "octree/domain_state.h"
#include "octree/octree.h"

namespace locvol {

// Element i: the state of the center of octree.leaves()[i], whose center_to_corners() are
// `corners[i]`. The states spread from the root's corners, which lie outside, from leaf to leaf
// through the corners that they share: each segment stays inside one leaf.
// REQUIRES: `corners` of each leaf, a closed surface inside the root box
std::vector<DomainState> center_states(const LinearOctree& octree,
                                       std::span<const CornerStates> corners);

// Of the centers of a leaf's eight children, for a leaf whose center's state is known. `corners[c]`
// are the child's own.
std::array<DomainState, 8> center_states_of_children(DomainState center,
                                                     const std::array<CornerStates, 8>& corners);

}  // namespace locvol
