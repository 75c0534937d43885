#include "engine/plan/phases.h"

#include <algorithm>

namespace locvol {

static_assert(std::ranges::all_of(kPhases, [](const PhaseFacts& facts) {
  return facts_of(facts.phase).name.data() == facts.name.data();
}));

Phase next_phase(const RunParameters& parameters, Phase phase) {
  return std::ranges::find_if(kPhases,
                              [&](const PhaseFacts& facts) {
                                return comes_before(phase, facts.phase) && facts.is_of(parameters);
                              })
      ->phase;
}

std::uint32_t first_epoch(const RunParameters& parameters, Phase phase) {
  std::uint32_t num_before = 0;
  for (Phase p = next_phase(parameters, Phase::kIngest); comes_before(p, phase);
       p = next_phase(parameters, p))
    ++num_before;
  return num_before;
}

Phase next_move(const RunRecord& run, Phase moved_at) {
  const bool is_uniform = run.parameters.sizes().is_uniform();
  const auto moves = [&](const PhaseFacts& facts) {
    return facts.leaves_move == LeavesMove::kUnlessBalanced ||
           (facts.leaves_move == LeavesMove::kIfSizesVary && !is_uniform);
  };
  const auto next = std::ranges::find_if(kPhases, [&](const PhaseFacts& facts) {
    return moves(facts) && comes_before(moved_at, facts.phase) &&
           !comes_before(facts.phase, run.phase);
  });
  return next == kPhases.end() ? Phase::kDone : next->phase;
}

}  // namespace locvol
