// The phases of a run: which of them it has, in which order, and what is known in each. All that
// compares phases, or counts epochs, asks here.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>

#include "storage/records.h"

namespace locvol {

// What takes time, one after another; in the first three is a run in some Phase.
enum class RunStage { kIngest, kInitialize, kRefine, kMeasure, kWrite, kAudit };
inline constexpr std::size_t kNumStages = 5;  // of a run: no audit

// Before a phase, leaves move to other ranks. kOnceSized: before the first phase that knows sizes,
// if they vary.
enum class LeavesMove { kNever, kOnceSized, kUnlessBalanced };

struct PhaseFacts {
  Phase phase;
  std::string_view name;  // as users see it
  RunStage stage;         // mending is the end of refinement
  bool (*is_of)(const RunRecord&);
  LeavesMove leaves_move = LeavesMove::kNever;
};

const PhaseFacts& facts_of(Phase phase);
inline RunStage stage_of(Phase phase) { return facts_of(phase).stage; }

std::size_t place_of(Phase phase);  // in the order of phases
Phase phase_at(std::size_t place);
inline bool comes_before(Phase a, Phase b) { return place_of(a) < place_of(b); }
// Is h known in all leaves, or λ all that there is?
inline bool are_sizes_known(Phase phase) { return comes_before(Phase::kSize, phase); }
// Those that cover the domain, or paper mode's few; refinement has begun, or is about to.
inline bool are_first_points_known(Phase phase) { return !comes_before(phase, Phase::kRefine); }

Phase next_phase(const RunRecord& run, Phase phase);  // REQUIRES: it is not the last
// Each phase before refinement visits leaves in one epoch, or has none to visit; refinement goes on
// from its first epoch.
std::uint32_t first_epoch(const RunRecord& run, Phase phase);
// Of a run whose leaves have last moved in the phase `moved_at`: before which phase they are to
// move next; Phase::kDone: before none.
Phase next_move(const RunRecord& run, Phase moved_at);

}  // namespace locvol
