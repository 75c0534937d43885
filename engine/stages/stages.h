// The stages of a run: for each phase that works on leaves, what is done in it.
#pragma once

#include <memory>

#include "engine/exchange/exchange.h"
#include "engine/run/leaf_stage.h"
#include "engine/run/run_state.h"
#include "engine/run/whole_model.h"
#include "engine/shared/memory_budget.h"
#include "octree/stop.h"
#include "storage/records.h"

namespace locvol {

// What stages work with; all of it has to outlive them.
struct StageTools {
  RunState& state;
  HeldModel& model;
  MemoryBudget& budget;
  const StopToken& stop;
  Exchange& exchange;            // for what ranks say in supersteps
  Exchange& outside_supersteps;  // for knowledge that is shared
};

// REQUIRES: the phase has leaves to work on
std::unique_ptr<LeafStage> stage_in(Phase phase, const StageTools& tools);

// Of each such phase; a file each.
std::unique_ptr<LeafStage> measure_stage(const StageTools& tools);
std::unique_ptr<LeafStage> size_stage(const StageTools& tools);
std::unique_ptr<LeafStage> scatter_stage(const StageTools& tools);
std::unique_ptr<LeafStage> crease_stage(const StageTools& tools);
std::unique_ptr<LeafStage> cover_stage(const StageTools& tools);
std::unique_ptr<LeafStage> fill_stage(const StageTools& tools);
std::unique_ptr<LeafStage> refine_stage(const StageTools& tools);
std::unique_ptr<LeafStage> mend_stage(const StageTools& tools);
std::unique_ptr<LeafStage> mend_surface_stage(const StageTools& tools);  // of the surface alone

}  // namespace locvol
