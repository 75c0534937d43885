// RunPhases takes a run that has been ingested to its end: phase after phase, epoch after epoch,
// leaf after leaf; by one process, or as one of several ranks.
#pragma once

#include <functional>
#include <memory>

#include "engine/exchange/exchange.h"
#include "engine/exchange/one_rank.h"
#include "engine/run/run_timeline.h"
#include "engine/run/run_work.h"
#include "engine/shared/memory_budget.h"
#include "engine/shared/stop_source.h"
#include "storage/store.h"

namespace locvol {

// Throws StoreError, OverBudget, RefineError: a VisitError, if it can be made again from the store;
// ExchangeError.
class RunPhases {
 public:
  // If the store is a rank's, the run is worked on by all of `exchange`. `is_behind`: others say
  // again what they said while this one ended (HeldRun). All that is given has to outlive it, but
  // `clock`.
  RunPhases(Store& store, const MemoryPlan& plan, int num_threads, const TellProgress& on_progress,
            const StopSource& stop, const WorkClock& clock, Exchange& exchange = alone(),
            bool is_behind = false);
  ~RunPhases();

  // After a start, by all ranks at once: if some are at a stage with knowledge that is in no store,
  // and none is before it, they tell each other of it again.
  void share_knowledge();
  // Until all is done, or the phase `until` begins, or the user stops it: then all visits that were
  // applied are committed, and Stopped is thrown.
  void run(Phase until, const std::function<void(const RunRecord&)>& on_sizes);
  // In seconds of all threads, of several ranks: of this one's visits, without applying them.
  double cpu_of_visits() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace locvol
