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

// A leaf that waits for the epoch.
struct LeafToColor {
  MortonKey leaf;
  double distance = 0;       // from which on others are independent of it; < 0: all are
  std::uint64_t weight = 0;  // how long its visit will take, over that of others
};

// The same where these differ: two leaves have different colors if they are at most the larger of
// their distances apart. Greedily in order of falling weight, in Morton order where that is the
// same: so visits that take long share a color, and fewer threads wait at its end.
std::vector<std::uint32_t> color_leaves(const LinearOctree& octree, const Frame& frame,
                                        std::span<const LeafToColor> leaves,
                                        const StopToken* stop = nullptr);

}  // namespace locvol
