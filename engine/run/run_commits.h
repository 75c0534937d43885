// RunCommits write what has changed in a run, all at once.
#pragma once

#include <chrono>
#include <cstddef>
#include <optional>

#include "engine/run/run_queue.h"
#include "engine/run/run_ranks.h"
#include "engine/run/run_view.h"

namespace locvol {

class RunCommits : RunView {
 public:
  // `max_unwritten_bytes`: of changes as decoded, before a commit is due.
  RunCommits(RunData& data, RunQueue& queue, RunRanks& ranks, std::size_t max_unwritten_bytes)
      : RunView(data), queue_(queue), ranks_(ranks), max_unwritten_bytes_(max_unwritten_bytes) {}

  bool is_due() const;
  void note_visit();
  // One batch with all changes; durable on return.
  void commit(const std::optional<MemoryRecord>& memory = std::nullopt,
              const TimelineRecord* timeline = nullptr);

 private:
  RunQueue& queue_;
  RunRanks& ranks_;
  std::size_t max_unwritten_bytes_;
  int num_unwritten_visits_ = 0;
  std::chrono::steady_clock::time_point last_commit_ = std::chrono::steady_clock::now();
};

}  // namespace locvol
