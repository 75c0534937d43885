#include "tools/forecast.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "tests/directories.h"

namespace locvol {
namespace {

RunEstimate law(double ingest, double initialize, double refine, double measure, double write) {
  RunEstimate estimate;
  estimate.seconds = {ingest, initialize, refine, measure, write};
  return estimate;
}

Progress refining(std::uint32_t epoch, std::uint64_t now, std::uint64_t next) {
  return {.phase = Phase::kRefine, .num_queued = now + next, .num_in_epoch = now, .epoch = epoch};
}

TEST(Forecast, KnowsNothingBeforeTheRunIsKnown) {
  Forecast forecast;
  forecast.note({.phase = Phase::kIngest, .num_triangles = 1000}, 3);
  EXPECT_EQ(forecast.seconds_left(3), std::nullopt);
  forecast.expect(law(1, 1, 8, 0, 1), true);
  EXPECT_GT(forecast.seconds_left(3), 10);  // and it has taken thrice what the law says
}

TEST(Forecast, OfARunThatKeepsTheLawIsRightAllAlong) {
  Forecast forecast;
  forecast.note({.phase = Phase::kIngest}, 0);
  forecast.expect(law(1, 2, 10, 1, 4), true);
  // 20 leaves to cover, all of which are then filled: 31 units, of 2 s.
  double covered = 0;
  for (int i = 0; i <= 20; ++i) {
    const double now = 1 + 2 / 31.0 * i;
    forecast.note({.phase = Phase::kCover, .num_queued = 20, .num_in_epoch = 20u - i}, now);
    EXPECT_NEAR(*forecast.seconds_left(now), 18 - now, 0.3) << i;
    EXPECT_GE(forecast.fraction_done(), covered);
    covered = forecast.fraction_done();
  }
  for (int i = 0; i <= 20; ++i) {
    const double now = 1 + 2 / 31.0 * (20 + 0.55 * i);
    forecast.note(
        {.phase = Phase::kFill, .num_queued = 20u - i, .num_in_epoch = 20u - i, .epoch = 1}, now);
    EXPECT_NEAR(*forecast.seconds_left(now), 18 - now, 0.3) << i;
    EXPECT_GE(forecast.fraction_done(), covered);
    covered = forecast.fraction_done();
  }
  // 100 visits, and 80 more that take a fifth of one: 116 units, of 10 s.
  for (int i = 0; i <= 100; i += 4) {
    const double now = 3 + 10 / 116.0 * i;
    forecast.note(refining(1, 100u - i, 8u * i / 10), now);
    EXPECT_NEAR(*forecast.seconds_left(now), 18 - now, 0.5) << i;
  }
  for (int i = 0; i <= 80; i += 4) {
    const double now = 3 + 10 / 116.0 * (100 + 0.2 * i);
    forecast.note(refining(2, 80u - i, 0), now);
    EXPECT_NEAR(*forecast.seconds_left(now), 18 - now, 0.5) << i;
  }
  forecast.note({.phase = Phase::kDone, .epoch = 2}, 13);
  EXPECT_EQ(forecast.stage(), RunStage::kMeasure);
  for (std::uint64_t i = 1; i <= 10; ++i) {
    forecast.note(RunStage::kMeasure, i, 10, 13 + 0.1 * static_cast<double>(i));
    EXPECT_NEAR(*forecast.seconds_left(13 + 0.1 * static_cast<double>(i)),
                5 - 0.1 * static_cast<double>(i), 0.2);
  }
  // The vertices are numbered before the first of them is written.
  forecast.note(RunStage::kWrite, 0, 0, 14);
  for (std::uint64_t i = 1; i <= 20; ++i) {
    const double now = 14 + 2 + 0.1 * static_cast<double>(i);
    forecast.note(RunStage::kWrite, i, 20, now);
    EXPECT_NEAR(*forecast.seconds_left(now), 18 - now, 0.7) << i;
  }
  EXPECT_NEAR(*forecast.seconds_left(18), 0, 1e-9);
  EXPECT_EQ(forecast.fraction_done(), 1);
}

TEST(Forecast, LearnsThatAMachineIsSlower) {
  Forecast forecast;
  forecast.note({.phase = Phase::kIngest}, 0);
  forecast.expect(law(0.1, 1, 10, 0.2, 1), false);
  forecast.note({.phase = Phase::kCover, .num_queued = 10, .num_in_epoch = 10}, 0.5);
  forecast.note(refining(0, 0, 50), 5.5);  // five times as slow
  const double at_first = *forecast.seconds_left(5.5);
  EXPECT_NEAR(at_first, 5 * 10.2, 12);
  for (std::uint64_t i = 0; i <= 50; ++i)
    forecast.note(refining(1, 50 - i, i * 8 / 10), 5.5 + static_cast<double>(i));
  EXPECT_NEAR(*forecast.seconds_left(55.5), 0.2 * 40 + 5 * 0.2, 2);
}

// Without an output, and without what the run did before it was interrupted.
TEST(Forecast, OfARunThatGoesOnIsByItsPace) {
  Forecast forecast;
  forecast.expect(law(1, 2, 100, 0, 50), false);
  for (std::uint64_t i = 0; i <= 100; ++i)
    forecast.note(refining(2, 200 - i, 0), 2 * static_cast<double>(i));
  EXPECT_NEAR(*forecast.seconds_left(200), 200, 20);
}

TEST(Forecast, OfAnAuditIsItsPace) {
  Forecast forecast;
  forecast.note(RunStage::kAudit, 0, 100, 1);
  EXPECT_EQ(forecast.seconds_left(1), std::nullopt);
  forecast.note(RunStage::kAudit, 10, 100, 2);
  forecast.note(RunStage::kAudit, 30, 100, 4);
  EXPECT_NEAR(*forecast.seconds_left(4), 7, 0.5);
}

// A run told again from its record: what was guessed when, all in seconds of work.
struct Recording {
  struct Guess {
    double now, left;
  };
  std::vector<Guess> guesses;
  double end = 0, paused = 0;

  // Of the time left, as a part of the whole; in the first, second or last third of the time.
  double worst_error(int third) const {
    double worst = 0;
    for (const Guess& guess : of(third)) worst = std::max(worst, error(guess));
    return worst;
  }
  double mean_error(int third) const {
    double sum = 0;
    for (const Guess& guess : of(third)) sum += error(guess);
    return sum / static_cast<double>(of(third).size());
  }

 private:
  double error(const Guess& guess) const { return std::abs(guess.left - (end - guess.now)) / end; }
  std::vector<Guess> of(int third) const {
    std::vector<Guess> some;
    for (const Guess& guess : guesses)
      if (std::min(2, static_cast<int>(3 * guess.now / end)) == third) some.push_back(guess);
    return some;
  }
};

Recording recorded(const std::string& name) {
  const auto file = tests_directory() / "tools" / "traces" / (name + ".txt");
  std::ifstream in(file);
  EXPECT_TRUE(in) << file;
  Recording run;
  Forecast forecast;
  WorkingTime working_time;
  for (std::string line; std::getline(in, line);) {
    std::istringstream text(line);
    char kind = 0;
    double now = 0;
    text >> kind >> now;
    now -= run.paused;
    if (kind == 'E') {
      RunEstimate estimate;
      text >> estimate.num_cells >> estimate.num_listed_cells >> estimate.output.file_bytes;
      for (double& seconds : estimate.seconds) text >> seconds;
      forecast.expect(estimate, true);
    } else if (kind == 'P') {
      Progress p;
      int phase = 0;
      text >> phase >> p.epoch >> p.num_leaves >> p.num_queued >> p.num_in_epoch >>
          p.counts.num_visits >> p.counts.num_cells;
      p.phase = static_cast<Phase>(phase);
      forecast.note(p, now);
    } else if (kind == 'S') {
      int stage = 0;
      std::uint64_t done = 0, all = 0;
      text >> stage >> done >> all;
      forecast.note(static_cast<RunStage>(stage), done, all, now);
    } else if (kind == 'C') {
      double cpu_seconds = 0;
      text >> cpu_seconds;
      const double seconds = now + run.paused;
      run.paused = seconds - working_time.at(seconds, cpu_seconds);
      continue;
    } else if (kind == 'D') {
      run.end = now;
    } else {
      continue;
    }
    EXPECT_FALSE(text.fail()) << line;
    if (const auto left = forecast.seconds_left(now)) run.guesses.push_back({now, *left});
  }
  return run;
}

class Recorded : public testing::TestWithParam<const char*> {};

TEST_P(Recorded, ConvergesOnTheEnd) {
  const Recording run = recorded(GetParam());
  ASSERT_GT(run.guesses.size(), 60u);
  EXPECT_LT(run.worst_error(1), 0.35);
  EXPECT_LT(run.worst_error(2), 0.1);
  EXPECT_LT(run.mean_error(2), 0.5 * run.mean_error(0));
  EXPECT_LT(std::abs(run.guesses.back().left), 0.02 * run.end);
}

INSTANTIATE_TEST_SUITE_P(Forecast, Recorded,
                         testing::Values("bunny", "gyroid_ball", "happy_buddha", "three_holes",
                                         "stopped"));

TEST(Forecast, LeavesAPauseOut) {
  const Recording run = recorded("stopped");
  EXPECT_NEAR(run.paused, 30, 0.5);
}

TEST(WorkingTime, IsAllTimeOfAProcessThatWorks) {
  WorkingTime time;
  double cpu = 0;
  for (int i = 1; i <= 100; ++i) {
    // On two cores, alone or with others at work; with visits and files that take long.
    cpu += i % 10 == 0 ? 3 : 0.6 * i;
    EXPECT_DOUBLE_EQ(time.at(i * 1.5 + (i > 50 ? 7 : 0), cpu), i * 1.5 + (i > 50 ? 7 : 0)) << i;
  }
}

TEST(WorkingTime, CountsOfAPauseWhatWasDone) {
  WorkingTime time;
  EXPECT_EQ(time.at(10, 5), 10);
  // A second of CPU time used to take two.
  EXPECT_EQ(time.at(1000, 6), 12);
  EXPECT_EQ(time.at(1001, 6.5), 13);
  EXPECT_EQ(time.at(1001.5, 6.5), 13.5);  // too short to tell
  EXPECT_EQ(time.at(9001.5, 6.5), 13.5);
}

}  // namespace
}  // namespace locvol
