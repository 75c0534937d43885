// RunTimeline samples a run as it goes, for those who look at it later. It is no part of the
// result: nothing that the run does depends on it.
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>

#include "storage/records.h"

namespace locvol {

// Tells since when this process has been at work.
class WorkClock {
 public:
  WorkClock();
  std::uint64_t milliseconds() const;                 // since construction; monotonic
  std::uint64_t started() const { return started_; }  // seconds since 1970

 private:
  std::chrono::steady_clock::time_point start_;
  std::uint64_t started_;
};

// Keeps kMaxSamples at most, however long the run: of too many, one goes whose neighbors are
// closest in time. So the samples stay about evenly spread, and totals are those of all.
class RunTimeline {
 public:
  static constexpr std::size_t kMaxSamples = 256;

  // Begins another sitting after those that `earlier` tells of, at WorkClock::started().
  RunTimeline(TimelineRecord earlier, std::uint64_t started);

  // `now`: all but time and sitting, which are filled in; `milliseconds`: of this sitting, not less
  // than in the call before.
  void add(TimelineSample now, std::uint64_t milliseconds);
  bool is_empty() const { return record_.samples.empty(); }
  const TimelineRecord& record() const { return record_; }

 private:
  void drop_one();

  TimelineRecord record_;
  std::uint64_t started_;
  std::uint64_t sitting_ = 0, milliseconds_before_ = 0;
};

// Of work in each stage up to RunStage::kRefine.
std::array<std::uint64_t, 3> milliseconds_by_stage(const TimelineRecord& timeline);

}  // namespace locvol
