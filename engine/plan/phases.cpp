#include "engine/plan/phases.h"

#include <algorithm>
#include <iterator>

namespace locvol {

namespace {

bool any_run(const RunParameters&) { return true; }
bool run_of_paper(const RunParameters& p) { return p.init == Initialization::kPaper; }
bool run_of_cover(const RunParameters& p) { return p.init == Initialization::kCover; }
bool run_with_sizes(const RunParameters& p) { return run_of_cover(p) && !p.sizes().is_uniform(); }
bool run_with_measures(const RunParameters& p) { return run_with_sizes(p) && p.is_measured(); }

// In the order in which they come.
constexpr PhaseFacts kPhases[] = {
    {Phase::kIngest, "ingest", RunStage::kIngest, any_run},
    {Phase::kMeasure, "initialize", RunStage::kInitialize, run_with_measures},
    {Phase::kSize, "initialize", RunStage::kInitialize, run_with_sizes},
    {Phase::kScatter, "initialize", RunStage::kInitialize, run_of_paper},
    {Phase::kCover, "initialize", RunStage::kInitialize, run_of_cover,
     LeavesMove::kIfSizesVary},  // copies reach as far as sizes ask for
    {Phase::kFill, "initialize", RunStage::kInitialize, run_of_cover},
    {Phase::kRefine, "refine", RunStage::kRefine, any_run,
     LeavesMove::kUnlessBalanced},                       // most of the work begins
    {Phase::kMend, "mend", RunStage::kRefine, any_run},  // if it is called for
    {Phase::kDone, "done", RunStage::kRefine, any_run},
};

}  // namespace

const PhaseFacts& facts_of(Phase phase) {
  return *std::ranges::find(kPhases, phase, &PhaseFacts::phase);
}

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
  return next == std::end(kPhases) ? Phase::kDone : next->phase;
}

}  // namespace locvol
