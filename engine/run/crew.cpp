#include "engine/run/crew.h"

#include "engine/plan/phases.h"

namespace locvol {

bool OneProcess::has_leaves_of_phase() {
  const RunRecord& run = work_.state().run();
  return work_.state().queue().entries().num_in_epoch(first_epoch(run, run.phase)) > 0;
}

bool OneProcess::is_due(std::uint32_t, bool is_before_visits) {
  return !is_before_visits || (has_leaves_of_phase() && !work_.state().queue().is_epoch_open());
}

// Epoch after epoch, in queue order.
void OneProcess::visit(LeafVisits& visits) {
  RunState& state = work_.state();
  RunQueue& queue = state.queue();
  const auto distance = [&](MortonKey leaf) { return visits.conflict_distance(leaf); };
  while (!visits.is_once() || has_leaves_of_phase()) {
    if (queue.open_epoch(distance, &work_.stop())) work_.commit();
    if (queue.entries().is_empty()) return;
    work_.visit(queue.entries().front_epoch(), visits, [&](MortonKey, Visit& visit) {
      state.points().begin_ids();
      visit.apply();
      state.points().end_ids();
      work_.note_visit();
    });
  }
}

bool OneProcess::end_round(bool has_more) {
  if (has_more) work_.commit();
  return has_more;
}

void OneProcess::end_phase(Phase next) {
  work_.begin_phase(next);
  work_.commit();
}

}  // namespace locvol
