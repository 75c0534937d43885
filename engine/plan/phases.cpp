#include "engine/plan/phases.h"

#include <algorithm>
#include <iterator>

namespace locvol {

namespace {

bool any_run(const RunRecord&) { return true; }
bool run_of_paper(const RunRecord& run) { return run.parameters.init == Initialization::kPaper; }
bool run_of_cover(const RunRecord& run) { return run.parameters.init == Initialization::kCover; }
bool run_of_volume(const RunRecord& run) {
  return run_of_cover(run) && !run.parameters.is_surface_only;
}
bool run_with_sizes(const RunRecord& run) {
  return run_of_cover(run) && !run.parameters.sizes().is_uniform();
}
bool run_with_measures(const RunRecord& run) {
  return run_with_sizes(run) && run.parameters.is_measured();
}
bool run_with_creases(const RunRecord& run) { return run_of_cover(run) && run.has_creases; }

// In the order in which they come.
constexpr PhaseFacts kPhases[] = {
    {Phase::kIngest, "ingest", RunStage::kIngest, any_run},
    {Phase::kMeasure, "initialize", RunStage::kInitialize, run_with_measures},
    {Phase::kSize, "initialize", RunStage::kInitialize, run_with_sizes},
    {Phase::kScatter, "initialize", RunStage::kInitialize, run_of_paper},
    {Phase::kCrease, "initialize", RunStage::kInitialize, run_with_creases,
     LeavesMove::kOnceSized},  // copies reach as far as sizes ask for
    {Phase::kCover, "initialize", RunStage::kInitialize, run_of_cover, LeavesMove::kOnceSized},
    {Phase::kFill, "initialize", RunStage::kInitialize, run_of_volume},
    {Phase::kRefine, "refine", RunStage::kRefine, any_run,
     LeavesMove::kUnlessBalanced},                       // most of the work begins
    {Phase::kMend, "mend", RunStage::kRefine, any_run},  // if it is called for
    {Phase::kDone, "done", RunStage::kRefine, any_run},
};

}  // namespace

const PhaseFacts& facts_of(Phase phase) { return kPhases[place_of(phase)]; }

std::size_t place_of(Phase phase) {
  const auto facts = std::ranges::find(kPhases, phase, &PhaseFacts::phase);
  return static_cast<std::size_t>(facts - std::begin(kPhases));
}

Phase phase_at(std::size_t place) { return kPhases[place].phase; }

Phase next_phase(const RunRecord& run, Phase phase) {
  return std::ranges::find_if(kPhases,
                              [&](const PhaseFacts& facts) {
                                return comes_before(phase, facts.phase) && facts.is_of(run);
                              })
      ->phase;
}

std::uint32_t first_epoch(const RunRecord& run, Phase phase) {
  std::uint32_t num_before = 0;
  for (Phase p = next_phase(run, Phase::kIngest); comes_before(p, phase); p = next_phase(run, p))
    ++num_before;
  return num_before;
}

Phase next_move(const RunRecord& run, Phase moved_at) {
  const auto moves = [&](const PhaseFacts& facts) {
    return facts.leaves_move == LeavesMove::kUnlessBalanced ||
           (facts.leaves_move == LeavesMove::kOnceSized && run_with_sizes(run) &&
            facts.phase == next_phase(run, Phase::kSize));
  };
  const auto next = std::ranges::find_if(kPhases, [&](const PhaseFacts& facts) {
    return moves(facts) && comes_before(moved_at, facts.phase) &&
           !comes_before(facts.phase, run.phase);
  });
  return next == std::end(kPhases) ? Phase::kDone : next->phase;
}

}  // namespace locvol
