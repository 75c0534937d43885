#include "tools/forecast.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

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
  for (int i = 0; i <= 20; ++i) {
    const double now = 1 + 0.1 * i;
    forecast.note({.phase = Phase::kInitialize, .num_queued = 20u - i, .num_in_epoch = 20u - i},
                  now);
    EXPECT_NEAR(*forecast.seconds_left(now), 18 - now, 0.3) << i;
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
  forecast.note({.phase = Phase::kInitialize, .num_queued = 10, .num_in_epoch = 10}, 0.5);
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

// Recorded runs, told again: the error of the time left, as a part of the whole.
class Recorded : public testing::TestWithParam<const char*> {};

TEST_P(Recorded, ConvergesOnTheEnd) {
  const std::string file = std::string(LOCVOL_TESTS_DIR) + "/tools/traces/" + GetParam() + ".txt";
  std::ifstream in(file);
  ASSERT_TRUE(in) << file;
  struct Guess {
    double now, left;
  };
  std::vector<Guess> guesses;
  Forecast forecast;
  double end = 0;
  for (std::string line; std::getline(in, line);) {
    std::istringstream text(line);
    char kind = 0;
    double now = 0;
    text >> kind >> now;
    if (kind == 'E') {
      RunEstimate estimate;
      text >> estimate.num_cells >> estimate.num_listed_cells >> estimate.file_bytes;
      for (double& seconds : estimate.seconds) text >> seconds;
      forecast.expect(estimate, true);
    } else if (kind == 'P') {
      Progress p;
      int phase = 0;
      text >> phase >> p.epoch >> p.num_leaves >> p.num_queued >> p.num_in_epoch >> p.num_visits >>
          p.num_cells;
      p.phase = static_cast<Phase>(phase);
      forecast.note(p, now);
    } else if (kind == 'S') {
      int stage = 0;
      std::uint64_t done = 0, all = 0;
      text >> stage >> done >> all;
      forecast.note(static_cast<RunStage>(stage), done, all, now);
    } else if (kind == 'D') {
      end = now;
    } else {
      continue;
    }
    ASSERT_FALSE(text.fail()) << line;
    if (const auto left = forecast.seconds_left(now)) guesses.push_back({now, *left});
  }
  ASSERT_GT(guesses.size(), 60u);
  // Of the first, the second and the last third of the time.
  std::array<double, 3> sum{}, num{}, worst{};
  for (const auto& [now, left] : guesses) {
    const auto third = std::min<std::size_t>(2, static_cast<std::size_t>(3 * now / end));
    const double error = std::abs(left - (end - now)) / end;
    sum[third] += error;
    ++num[third];
    worst[third] = std::max(worst[third], error);
  }
  EXPECT_LT(worst[1], 0.35);
  EXPECT_LT(worst[2], 0.1);
  EXPECT_LT(sum[2] / num[2], 0.5 * sum[0] / num[0]);
  EXPECT_LT(std::abs(guesses.back().left), 0.02 * end);
}

INSTANTIATE_TEST_SUITE_P(Forecast, Recorded,
                         testing::Values("bunny", "gyroid_ball", "happy_buddha", "three_holes"));

}  // namespace
}  // namespace locvol
