// RunState is the run in memory: what the engine has read of the store, and what the next commit
// will write. There is no other state: dropped at any time and read again from the store, it goes
// on from the last commit with the same result.
//
// It is made of parts, each with a header of its own. Whatever changes the run is a verb of one of
// them, which keeps what belongs together. Who needs only one is given that one, and a reader who
// changes nothing a RunView.
#pragma once

#include <cstddef>

#include "engine/run/leaf_records.h"
#include "engine/run/run_commits.h"
#include "engine/run/run_points.h"
#include "engine/run/run_queue.h"
#include "engine/run/run_ranks.h"
#include "engine/run/run_view.h"
#include "storage/store.h"

namespace locvol {

inline constexpr std::size_t kDefaultCacheBytes = std::size_t{128} << 20;
inline constexpr std::size_t kDefaultUnwrittenBytes = std::size_t{32} << 20;

class RunState : public RunView {
 public:
  // REQUIRES: the store holds a run that is past Phase::kIngest
  explicit RunState(Store& store, std::size_t cache_bytes = kDefaultCacheBytes,
                    std::size_t max_unwritten_bytes = kDefaultUnwrittenBytes);
  RunState(const RunState&) = delete;
  RunState& operator=(const RunState&) = delete;

  RunQueue& queue() { return queue_; }
  RunPoints& points() { return points_; }
  LeafRecords& records() { return records_; }
  RunRanks& ranks() { return ranks_; }
  RunCommits& commits() { return commits_; }

  void begin_phase(Phase next);
  void note_sizes(const SizeTotals& totals) { all_.run.sizes = totals; }

 private:
  RunData all_;
  RunQueue queue_;
  RunPoints points_;
  LeafRecords records_;
  RunRanks ranks_;
  RunCommits commits_;
};

}  // namespace locvol
