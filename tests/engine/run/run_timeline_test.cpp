#include "engine/run/run_timeline.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "engine/engine.h"
#include "tests/engine/closed_shapes.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

using namespace testing_shapes;

TimelineSample sample(Phase phase, std::uint64_t num_visits) {
  return {.phase = phase, .counts = {.num_visits = num_visits, .num_insertions = {}}};
}

TEST(RunTimeline, KeepsABoundedNumberOfSamplesSpreadOverTheRun) {
  constexpr std::uint64_t kStep = 40, kNum = 20'000;
  RunTimeline timeline({}, 0);
  for (std::uint64_t i = 1; i <= kNum; ++i)
    timeline.add(sample(i <= kNum / 10 ? Phase::kCover : Phase::kRefine, i), kStep * i);
  const auto& samples = timeline.record().samples;
  ASSERT_EQ(samples.size(), RunTimeline::kMaxSamples);
  EXPECT_EQ(samples.front().counts.num_visits, 1U);
  EXPECT_EQ(samples.back().counts.num_visits, kNum);
  const std::uint64_t fair = kStep * kNum / RunTimeline::kMaxSamples;
  for (std::size_t i = 1; i < samples.size(); ++i) {
    EXPECT_LT(samples[i - 1].milliseconds, samples[i].milliseconds);
    EXPECT_LE(samples[i].milliseconds - samples[i - 1].milliseconds, 4 * fair) << i;
  }
  const auto end = std::ranges::find(samples, Phase::kRefine, &TimelineSample::phase);
  EXPECT_EQ((end - 1)->counts.num_visits, kNum / 10) << "the end of the phase is kept";
  EXPECT_EQ(milliseconds_by_stage(timeline.record()),
            (std::array<std::uint64_t, 3>{0, kStep * kNum / 10, kStep * kNum * 9 / 10}));
}

TEST(RunTimeline, GoesOnWhereTheLastSittingEnded) {
  RunTimeline first({}, 1000);
  first.add(sample(Phase::kIngest, 0), 300);
  first.add(sample(Phase::kRefine, 7), 900);
  RunTimeline second(first.record(), 5000);
  second.add(sample(Phase::kRefine, 7), 10);
  second.add(sample(Phase::kDone, 9), 50);
  const auto& samples = second.record().samples;
  ASSERT_EQ(samples.size(), 4U);
  EXPECT_EQ(samples[1].sitting, 0U);
  EXPECT_EQ(samples[2].sitting, 1U);
  EXPECT_EQ(samples[2].milliseconds, 910U);
  EXPECT_EQ(samples[3].milliseconds, 950U);
  EXPECT_EQ(samples[1].started, 1000U);
  EXPECT_EQ(samples[3].started, 5000U);
  EXPECT_EQ(milliseconds_by_stage(second.record()), (std::array<std::uint64_t, 3>{300, 0, 650}));
}

// Thousands of sittings must not outgrow the bound either.
TEST(RunTimeline, BoundsTheSamplesOfManySittings) {
  TimelineRecord record;
  for (std::uint64_t sitting = 0; sitting < 2000; ++sitting) {
    RunTimeline timeline(record, sitting);
    timeline.add(sample(Phase::kRefine, sitting), 5);
    record = timeline.record();
  }
  EXPECT_EQ(record.samples.size(), RunTimeline::kMaxSamples);
  EXPECT_EQ(record.samples.back().sitting, 1999U);
  EXPECT_EQ(record.samples.back().milliseconds, 10'000U);
}

TEST(RunTimeline, TellsOfAnInterruptedRun) {
  const TempDir scratch;
  const std::filesystem::path input = scratch / "sphere.off";
  write_off(sphere(1, 15, 32), input);
  const MeshOptions options{{.size = {0.2}, .store = scratch / "store", .leaf_capacity = 100},
                            input};
  RunControl control;
  control.is_stopped = [left = 20]() mutable { return left-- == 0; };
  ASSERT_EQ(mesh(options, control).outcome, RunOutcome::kInterrupted);
  const RunSummary summary = resume(options.store);

  const auto held_samples = [&] {
    return Store::open(options.store, {.read_only = true}).snapshot().timeline().samples;
  };
  const auto samples = held_samples();
  ASSERT_GE(samples.size(), 6U);
  EXPECT_EQ(samples.front().phase, Phase::kIngest);
  EXPECT_EQ(samples.front().counts.num_visits, 0U);
  EXPECT_GT(samples.front().started, 1'600'000'000U);
  EXPECT_GT(samples.front().resident, 1U << 20);
  for (std::size_t i = 1; i < samples.size(); ++i) {
    EXPECT_LE(samples[i - 1].milliseconds, samples[i].milliseconds);
    EXPECT_LE(samples[i - 1].sitting, samples[i].sitting);
    EXPECT_LE(samples[i - 1].counts.num_visits, samples[i].counts.num_visits);
  }
  const TimelineSample& last = samples.back();
  EXPECT_EQ(last.sitting, 1U);
  EXPECT_EQ(last.phase, Phase::kDone);
  EXPECT_EQ(last.counts, summary.run.counts);
  EXPECT_EQ(last.num_queued, 0U);
  EXPECT_LT(samples.size(), RunTimeline::kMaxSamples);

  // A finished run is left as it is; one that begins anew has another timeline.
  resume(options.store);
  EXPECT_EQ(held_samples(), samples);
  MeshOptions other = options;
  other.size.value = 0.25;
  other.is_forced = true;
  mesh(other);
  EXPECT_EQ(held_samples().back().sitting, 0U);
}

}  // namespace
}  // namespace locvol
