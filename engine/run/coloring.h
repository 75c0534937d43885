// Colors the leaves of an epoch, so that leaves of one color can be visited in any order or at once
// (engine/README.md, "Why the result does not depend on what ran when").
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "octree/frame.h"
#include "octree/octree.h"
#include "octree/stop.h"

namespace locvol {

// The color of each of `leaves`: greedily in Morton order, the smallest that no earlier leaf at
// most `distance` away (box to box, Euclidean) has. Leaves of one size s >= distance need eight
// colors. Throws Stopped. REQUIRES: `leaves` are leaves of the octree in Morton order, distance >=
// 0
std::vector<std::uint32_t> color_leaves(const LinearOctree& octree, const Frame& frame,
                                        std::span<const MortonKey> leaves, double distance,
                                        const StopToken* stop = nullptr);

// The same with a distance for each of the leaves: two of them have different colors if they are at
// most the larger of their distances apart.
std::vector<std::uint32_t> color_leaves(const LinearOctree& octree, const Frame& frame,
                                        std::span<const MortonKey> leaves,
                                        std::span<const double> distances,
                                        const StopToken* stop = nullptr);

}  // namespace locvol
