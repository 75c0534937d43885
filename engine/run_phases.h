// RunPhases takes a run that has been ingested to its end: phase after phase, epoch after epoch,
// leaf after leaf; by one process, or as one of several ranks.
#pragma once

#include <functional>
#include <memory>

#include "engine/exchange/exchange.h"
#include "engine/plan/options.h"
#include "engine/run/run_timeline.h"
#include "engine/shared/memory_budget.h"
#include "engine/shared/stop_source.h"
#include "storage/store.h"

namespace locvol {

using TellProgress = std::function<void(const Progress&)>;

// Throws StoreError, OverBudget, RefineError: a VisitError, if it can be made again from the store;
// ExchangeError.
class RunPhases {
 public:
  // `exchange`: of the ranks that work on the run, if several do; `is_behind`: others say again
  // what they said while this one ended (HeldRun). All that is given has to outlive it, but
  // `clock`.
  RunPhases(Store& store, const MemoryPlan& plan, int num_threads, const TellProgress& on_progress,
            const StopSource& stop, const WorkClock& clock, Exchange* exchange = nullptr,
            bool is_behind = false);
  ~RunPhases();

  // What stands for the surface while sizes are found. Of several ranks each is told what it may
  // ask of others' surface: by all at once, when all are at that stage, or past it. It is not in
  // the store: so it is said again after each start, and nobody waits for it in a superstep.
  void find_far_surface();
  // Until all is done, or the phase `until` begins, or the user stops it: then all visits that were
  // applied are committed, and Stopped is thrown.
  void run(Phase until, const std::function<void(const RunRecord&)>& on_sizes);
  // In seconds of all threads, of several ranks: of this one's visits, without applying them.
  double cpu_of_visits() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

// Of Phase::kSize, once leaves are split that an image asks too many sizes of.
std::uint32_t first_stage_with_surface(const RunRecord& run);

}  // namespace locvol
