// How far apart leaves must be for their visits not to see or change each other, and how far a
// visit reaches into what is known of others.
#pragma once

#include <algorithm>

#include "engine/run/run_view.h"

namespace locvol {

// Over λ, in cover mode. A visit deletes within kReach of its leaf, inserts within kInsertion, and
// makes core points explicit that are closer than kLatticeStar to that: these are the farthest that
// it writes. What it reads of the core is the farthest that it reads. Leaves farther apart than
// both together are independent of each other.
inline constexpr double kConflict = kInsertion + kLatticeStar + kCoreReach;

// Likewise, how far from a leaf a visit of it changes what is known of others: it makes a core
// point explicit, and those around that are to look at it. It reads no farther; sites of two leaves
// that may become one are as near.
inline constexpr double kTouch =
    std::max(kInsertion + kLatticeStar + kNeighborhood, 2 * kReach + 1);
// The same of any run in cover mode, as a length: before sizes are known, of visits that find them.
// Of those that come later, if leaves are not split. REQUIRES: LeafInfo has what is known of sizes
double touch_distance(const RunRecord& run, const LeafInfo& info);

// Leaves farther apart than these of both are independent. Of visits that look at nothing that
// others change:
inline constexpr double kNoConflict = -1;
// It reads points on creases around its box, and writes to its box.
double conflict_of_creases(const RunView& run, MortonKey leaf);
// It reads samples within r_s of its box, and writes to its box; where there are creases, it does
// both farther out.
double conflict_of_cover(const RunView& run, MortonKey leaf);
double conflict_of_fill(const RunView& run, MortonKey leaf);
// Mending writes as far as refinement.
double conflict_of_refinement(const RunView& run, MortonKey leaf);

}  // namespace locvol
