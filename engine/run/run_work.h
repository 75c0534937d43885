// RunWork is what a process does for a run, whoever works on it besides: it makes visits on its
// threads, commits, and tells how far it is.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <vector>

#include "engine/plan/options.h"
#include "engine/run/leaf_stage.h"
#include "engine/run/run_state.h"
#include "engine/run/run_timeline.h"
#include "engine/run/visit_pipeline.h"
#include "engine/run/whole_model.h"
#include "engine/shared/memory_budget.h"
#include "engine/shared/stop_source.h"

namespace locvol {

using TellProgress = std::function<void(const Progress&)>;

// The user's wish to stop, where the run may.
class AllowedStop : public StopToken {
 public:
  AllowedStop(const StopSource& wish, bool is_allowed) : wish_(wish), is_allowed_(is_allowed) {}
  bool is_stopped() const override { return is_allowed_ && wish_.is_stopped(); }
  bool ask() const { return is_allowed_ && wish_.ask(); }
  void allow(bool is_allowed) { is_allowed_ = is_allowed; }

 private:
  const StopSource& wish_;
  std::atomic<bool> is_allowed_;
};

class RunWork {
 public:
  // All that is given has to outlive it, but `clock`.
  RunWork(Store& store, const MemoryPlan& plan, int num_threads, const TellProgress& on_progress,
          const StopSource& stop, const WorkClock& clock);

  RunState& state() { return state_; }
  HeldModel& model() { return model_; }
  MemoryBudget& budget() { return budget_; }
  AllowedStop& stop() { return stop_; }  // of several ranks allowed where they say so
  int num_threads() const { return num_threads_; }

  // As VisitPipeline does, which tells of errors; what was applied is committed then.
  void visit(std::vector<QueueEntry> leaves, LeafVisits& visits, const VisitPipeline::Take& take);
  void note_visit();  // one that was applied
  void commit_if_due();
  void commit();
  void begin_phase(Phase next);

  // Of a run by one process it is told by itself: after each visit and each commit.
  void tell(const RunCounts& counts, std::uint64_t num_leaves, std::uint64_t num_queued,
            std::uint64_t num_in_epoch) const;

 private:
  void tell_progress();
  void note_sample(Phase phase);
  MemoryRecord memory_use() const;

  const TellProgress& on_progress_;
  const MemoryPlan& plan_;
  MemoryBudget budget_;
  RunState state_;
  AllowedStop stop_;
  HeldModel model_;
  int num_threads_;
  VisitPipeline pipeline_;
  WorkClock clock_;
  RunTimeline timeline_;
};

}  // namespace locvol
