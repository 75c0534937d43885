#include "engine/run/run_work.h"

#include <string>
#include <utility>

#include "engine/plan/phases.h"
#include "engine/run/visit_error.h"
#include "engine/shared/workers.h"

namespace locvol {

RunWork::RunWork(Store& store, const MemoryPlan& plan, int num_threads,
                 const TellProgress& on_progress, const StopSource& stop, const WorkClock& clock)
    : on_progress_(on_progress),
      plan_(plan),
      budget_(plan.heap()),
      state_(store, budget_.free_bytes(), plan.max_unwritten()),
      stop_(stop, !state_.ranks().is_rank()),
      model_(state_, budget_, &stop_),
      num_threads_(plan.num_threads(num_threads > 0 ? num_threads : num_usable_threads())),
      pipeline_(state_, budget_, num_threads_),
      clock_(clock),
      timeline_(store.snapshot().timeline(), clock.started()) {
  note_sample(timeline_.is_empty() ? Phase::kIngest : state_.run().phase);
}

void RunWork::visit(std::vector<QueueEntry> leaves, LeafVisits& visits,
                    const VisitPipeline::Take& take) try {
  pipeline_.visit(std::move(leaves), visits, take, [this] { return stop_.ask(); });
} catch (const VisitError& e) {
  commit();  // so that the visit can be made again, as it was
  throw VisitError(e.leaf(), std::string(e.what()) + "; this is a bug of locvol. The store " +
                                 state_.store().directory().string() +
                                 " holds all that was done before");
} catch (const OverBudget& e) {
  commit();
  throw OverBudget(std::string(e.what()) + "; go on with a larger one, at least " +
                       memory_text(plan_.cap_with_heap(e.bytes())) +
                       ": nothing that was done is lost",
                   e.bytes());
}

void RunWork::note_visit() {
  state_.commits().note_visit();
  if (state_.commits().is_due())
    commit();
  else
    tell_progress();
}

void RunWork::commit_if_due() {
  if (state_.commits().is_due()) commit();
}

void RunWork::commit() {
  note_sample(state_.run().phase);
  state_.commits().commit(memory_use(), &timeline_.record());
  tell_progress();
}

void RunWork::begin_phase(Phase next) {
  note_sample(state_.run().phase);
  state_.begin_phase(next);
}

// Of several ranks, all tell what all have, between two supersteps.
void RunWork::tell_progress() {
  const LeafQueue& queue = state_.queue().entries();
  if (!state_.ranks().is_rank())
    tell(state_.run().counts, state_.octree().size(), queue.size(),
         queue.num_in_epoch(state_.run().epoch));
}

void RunWork::tell(const RunCounts& counts, std::uint64_t num_leaves, std::uint64_t num_queued,
                   std::uint64_t num_in_epoch) const {
  const RunRecord& run = state_.run();
  if (on_progress_)
    on_progress_({.phase = run.phase,
                  .counts = counts,
                  .num_leaves = num_leaves,
                  .num_queued = num_queued,
                  .num_in_epoch = num_in_epoch,
                  .epoch = run.epoch,
                  .first_epoch = first_epoch(run, Phase::kRefine)});
}

// `phase`: what took the time since the last sample.
void RunWork::note_sample(Phase phase) {
  const RunRecord& run = state_.run();
  timeline_.add({.num_threads = static_cast<std::uint64_t>(num_threads_),
                 .memory_cap = plan_.cap(),
                 .resident = resident_memory(),
                 .phase = phase,
                 .epoch = run.epoch,
                 .num_leaves = state_.octree().size(),
                 .num_queued = state_.queue().entries().size(),
                 .counts = run.counts},
                clock_.milliseconds());
}

MemoryRecord RunWork::memory_use() const {
  MemoryRecord memory = plan_.record();
  memory.visits = budget_.largest_reservation();
  memory.cache = plan_.heap() - memory.visits;
  memory.peak_resident = peak_resident_memory();
  return memory;
}

}  // namespace locvol
