#include "engine/run/run_timeline.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "engine/plan/phases.h"

namespace locvol {
namespace {

// Gaps at the end of a phase or a sitting count as so much wider than they are.
constexpr std::uint64_t kEndWeight = 16;

bool is_end(const TimelineSample& sample, const TimelineSample& next) {
  return sample.phase != next.phase || sample.sitting != next.sitting;
}

}  // namespace

WorkClock::WorkClock()
    : start_(std::chrono::steady_clock::now()),
      started_(static_cast<std::uint64_t>(std::chrono::duration_cast<std::chrono::seconds>(
                                              std::chrono::system_clock::now().time_since_epoch())
                                              .count())) {}

std::uint64_t WorkClock::milliseconds() const {
  const auto passed = std::chrono::steady_clock::now() - start_;
  return static_cast<std::uint64_t>(
      std::chrono::duration_cast<std::chrono::milliseconds>(passed).count());
}

RunTimeline::RunTimeline(TimelineRecord earlier, std::uint64_t started)
    : record_(std::move(earlier)), started_(started) {
  if (record_.samples.empty()) return;
  sitting_ = record_.samples.back().sitting + 1;
  milliseconds_before_ = record_.samples.back().milliseconds;
}

void RunTimeline::add(TimelineSample now, std::uint64_t milliseconds) {
  now.milliseconds = milliseconds_before_ + milliseconds;
  now.sitting = sitting_;
  now.started = started_;
  record_.samples.push_back(now);
  if (record_.samples.size() > kMaxSamples) drop_one();
}

void RunTimeline::drop_one() {
  auto& samples = record_.samples;
  std::size_t least = 1;
  std::uint64_t least_gap = std::numeric_limits<std::uint64_t>::max();
  for (std::size_t i = 1; i + 1 < samples.size(); ++i) {
    const std::uint64_t weight = is_end(samples[i], samples[i + 1]) ? kEndWeight : 1;
    // Of equal gaps the first: samples within one millisecond are not all to be recent ones.
    const std::uint64_t gap =
        weight * (samples[i + 1].milliseconds - samples[i - 1].milliseconds + 1);
    if (gap < least_gap) {
      least_gap = gap;
      least = i;
    }
  }
  samples.erase(samples.begin() + static_cast<std::ptrdiff_t>(least));
}

std::array<std::uint64_t, 3> milliseconds_by_stage(const TimelineRecord& timeline) {
  std::array<std::uint64_t, 3> milliseconds{};
  std::uint64_t before = 0;
  for (const TimelineSample& sample : timeline.samples) {
    const auto stage = static_cast<std::size_t>(stage_of(sample.phase));
    milliseconds[stage] += sample.milliseconds - std::exchange(before, sample.milliseconds);
  }
  return milliseconds;
}

}  // namespace locvol
