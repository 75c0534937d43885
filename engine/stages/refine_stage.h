// What refine_leaf needs to know of a leaf: for the run, and for those who make a visit again.
#pragma once

#include "engine/run/leaf_stage.h"
#include "engine/run/run_view.h"
#include "engine/run/surroundings.h"
#include "engine/run/whole_model.h"
#include "refine/leaf.h"

namespace locvol {

// In paper mode throws OverBudget: P has outgrown the memory.
Loaded<LeafInput> load_refine(const RunView& run, const Surroundings& around, HeldModel& model,
                              MortonKey leaf);

}  // namespace locvol
