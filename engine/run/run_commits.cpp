#include "engine/run/run_commits.h"

namespace locvol {
namespace {

constexpr int kMaxVisitsOfCommit = 64;  // what a crash may cost
constexpr std::chrono::seconds kMaxTimeOfCommit{1};

}  // namespace

void RunCommits::note_visit() {
  ++num_unwritten_visits_;
  leaves().trim();
}

bool RunCommits::is_due() const {
  return num_unwritten_visits_ >= kMaxVisitsOfCommit ||
         leaves().unwritten_bytes() > max_unwritten_bytes_ ||
         std::chrono::steady_clock::now() - last_commit_ > kMaxTimeOfCommit;
}

void RunCommits::commit(const std::optional<MemoryRecord>& memory, const TimelineRecord* timeline) {
  Batch batch = data_.store.begin();
  data_.leaves.write_to(batch);
  queue_.queue_.write_to(batch);
  batch.put_run(run());
  if (memory) batch.put_memory(*memory);
  if (timeline) batch.put_timeline(*timeline);
  ranks_.write_to(batch);
  batch.commit();
  num_unwritten_visits_ = 0;
  last_commit_ = std::chrono::steady_clock::now();
  leaves().trim();
  data_.store.release_pages();
}

}  // namespace locvol
