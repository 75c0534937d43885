// VisitPipeline makes the visits of an epoch on several threads, with the result of making them one
// after another, in queue order.
//
// A visit is loaded from the run, computed from that alone, and applied to the run. The first and
// the last are done by one thread at a time and in queue order, so that new points get the same
// ids; meanwhile other threads compute. A leaf is loaded once all visits are applied that may have
// written what it reads: leaves of one color never wait for each other, and of the next color's
// leaves most need not wait either.
//
// Memory: a visit reserves what it takes before it is computed. Beside others, it leaves the cache
// of records its least; the first in the order may take all that there is.
#pragma once

#include <functional>
#include <vector>

#include "engine/run/leaf_stage.h"
#include "engine/run/run_state.h"
#include "engine/shared/memory_budget.h"
#include "engine/shared/workers.h"

namespace locvol {

class VisitPipeline {
 public:
  // Has the run take what was found; or puts it aside.
  using Take = std::function<void(MortonKey leaf, Visit& visit)>;
  using IsStopped = std::function<bool()>;

  VisitPipeline(RunState& state, MemoryBudget& budget, int num_threads)
      : state_(state), budget_(budget), workers_(num_threads) {}

  // Visits these leaves, which wait in the open epoch, in queue order, and calls take() for each in
  // place of applying it, by one thread at a time and in queue order. Throws Stopped before the
  // last of them if that is asked for: before a visit begins, or in its middle by what was loaded
  // for it. What was not applied by then is dropped. Throws the first error in queue order, with
  // all visits before it applied: VisitError, OverBudget with the leaf's name, and what applying a
  // visit throws.
  void visit(std::vector<QueueEntry> leaves, LeafVisits& visits, const Take& take,
             const IsStopped& is_stopped);

 private:
  class Run;

  RunState& state_;
  MemoryBudget& budget_;
  Workers workers_;
};

}  // namespace locvol
