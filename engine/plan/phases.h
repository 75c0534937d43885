// The phases of a run: which of them it has, in which order, and what is known in each. All that
// compares phases, or counts epochs, asks here.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "storage/records.h"

namespace locvol {

// What takes time, one after another; in the first three is a run in some Phase.
enum class RunStage { kIngest, kInitialize, kRefine, kMeasure, kWrite, kAudit };
inline constexpr std::size_t kNumStages = 5;  // of a run: no audit

// Before a phase, leaves move to other ranks.
enum class LeavesMove { kNever, kIfSizesVary, kUnlessBalanced };

struct PhaseFacts {
  Phase phase;
  std::string_view name;  // as users see it
  RunStage stage;         // mending is the end of refinement
  bool (*is_of)(const RunParameters&);
  LeavesMove leaves_move = LeavesMove::kNever;
};

namespace phase_table {
constexpr bool always(const RunParameters&) { return true; }
inline bool is_paper(const RunParameters& p) { return p.init == Initialization::kPaper; }
inline bool is_cover(const RunParameters& p) { return p.init == Initialization::kCover; }
inline bool is_graded(const RunParameters& p) { return is_cover(p) && !p.sizes().is_uniform(); }
inline bool is_measured(const RunParameters& p) { return is_graded(p) && p.is_measured(); }
}  // namespace phase_table

// In the order in which they come.
inline constexpr std::array kPhases = std::to_array<PhaseFacts>({
    {Phase::kIngest, "ingest", RunStage::kIngest, phase_table::always},
    {Phase::kMeasure, "initialize", RunStage::kInitialize, phase_table::is_measured},
    {Phase::kSize, "initialize", RunStage::kInitialize, phase_table::is_graded},
    {Phase::kScatter, "initialize", RunStage::kInitialize, phase_table::is_paper},
    {Phase::kCover, "initialize", RunStage::kInitialize, phase_table::is_cover,
     LeavesMove::kIfSizesVary},  // copies reach as far as sizes ask for
    {Phase::kFill, "initialize", RunStage::kInitialize, phase_table::is_cover},
    {Phase::kRefine, "refine", RunStage::kRefine, phase_table::always,
     LeavesMove::kUnlessBalanced},  // most of the work begins
    {Phase::kMend, "mend", RunStage::kRefine, phase_table::always},
    {Phase::kDone, "done", RunStage::kRefine, phase_table::always},
});

constexpr const PhaseFacts& facts_of(Phase phase) {
  return kPhases[static_cast<std::size_t>(phase)];
}
constexpr RunStage stage_of(Phase phase) { return facts_of(phase).stage; }

constexpr bool comes_before(Phase a, Phase b) { return a < b; }
// Is h known in all leaves, or λ all that there is?
constexpr bool are_sizes_known(Phase phase) { return comes_before(Phase::kSize, phase); }
// Those that cover the domain, or paper mode's few; refinement has begun, or is about to.
constexpr bool are_first_points_known(Phase phase) { return !comes_before(phase, Phase::kRefine); }

Phase next_phase(const RunParameters& parameters, Phase phase);  // REQUIRES: it is not the last
// Each phase before refinement visits leaves in one epoch, or has none to visit; refinement goes on
// from its first epoch.
std::uint32_t first_epoch(const RunParameters& parameters, Phase phase);
// Of a run whose leaves have last moved in the phase `moved_at`: before which phase they are to
// move next; Phase::kDone: before none.
Phase next_move(const RunRecord& run, Phase moved_at);

}  // namespace locvol
