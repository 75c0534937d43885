// refine_leaf restores the conditions C1–C6 (refine/ALGORITHM.md) for the own points of one octree
// leaf. A pure function: equal input gives an equal delta, on any thread and any machine.
#pragma once

#include "refine/leaf.h"

namespace locvol {

// Throws Stopped, RefineError.
LeafDelta refine_leaf(LeafInput input, const VisitWatch& watch = {}, const WholeModel& whole = {});

}  // namespace locvol
