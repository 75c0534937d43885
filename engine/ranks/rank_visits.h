// The visits of a run that several ranks work on: epoch after epoch, color after color, all ranks
// at once.
#pragma once

#include <cstdint>

#include "engine/exchange/exchange.h"
#include "engine/run/leaf_stage.h"
#include "engine/run/run_state.h"

namespace locvol {

// Each is called by all ranks at once. What comes next depends on what the stores hold alone: so
// ranks that start again say what they said before.
class RankVisits {
 public:
  RankVisits(RunState& state, Exchange& exchange) : state_(state), exchange_(exchange) {}

  // What all ranks have, as of the last next().
  struct Totals {
    RunCounts counts;
    std::uint64_t num_leaves = 0, num_queued = 0, num_in_epoch = 0;
  };
  const Totals& totals() const { return totals_; }

  // What comes next.
  enum class Step { kOpen, kVisit, kSend, kNone };
  struct Next {
    Step step = Step::kNone;  // kNone: no leaf waits
    QueuePosition position;   // kOpen: the epoch; else the color that it is of
    // kVisit: where ids of new points begin that are of the rank's own leaves, and end for all.
    std::uint64_t first_own_id = 0, end_id = 0;
  };
  // REQUIRES: what has been sent by all is applied
  Next next();
  // Gives all that wait in it their colors, which is to be committed. Memory: 16 bytes for each
  // leaf of the epoch, of all ranks.
  void open_epoch(std::uint32_t epoch, const LeafVisits& visits);

 private:
  RunState& state_;
  Exchange& exchange_;
  Totals totals_;
};

// Before mending: copies get the cells that their leaves have. Memory: all of them.
void share_cells(RunState& state, Exchange& exchange);
// As merge_sites(), by one rank after the other.
void merge_sites_in_turn(RunState& state, Exchange& exchange);

}  // namespace locvol
