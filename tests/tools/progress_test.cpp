#include "tools/progress.h"

#include <gtest/gtest.h>

namespace locvol {
namespace {

TEST(DurationText, CountsHoursOnlyWhenThereAreAny) {
  EXPECT_EQ(duration_text(0), "0:00");
  EXPECT_EQ(duration_text(59.6), "1:00");
  EXPECT_EQ(duration_text(3599), "59:59");
  EXPECT_EQ(duration_text(3723), "1:02:03");
  EXPECT_EQ(duration_text(360000), "100:00:00");
}

TEST(ProgressText, ShowsVisitsOnceThereAreAny) {
  Progress progress{.phase = Phase::kInitialize, .num_leaves = 8, .num_queued = 3};
  EXPECT_EQ(progress_text(progress, 61, std::nullopt),
            "1:01 initialize: 8 leaves, 3 queued, 0 points, 0 cells");
  progress = {.phase = Phase::kRefine,
              .num_leaves = 8,
              .num_queued = 3,
              .num_visits = 5,
              .num_points = 70,
              .num_cells = 400,
              .epoch = 2};
  EXPECT_EQ(progress_text(progress, 61, 9),
            "1:01 refine: 8 leaves, 3 queued, epoch 2, 5 visits, 70 points, 400 cells, "
            "about 0:09 left");
}

TEST(Pace, IsTheQueueOverTheRateSinceThisProcessBegan) {
  Pace pace;
  // A resumed run: 1,000 visits were made before.
  EXPECT_EQ(pace.seconds_left({.phase = Phase::kRefine, .num_queued = 50, .num_visits = 1000}, 10),
            std::nullopt);
  EXPECT_EQ(pace.seconds_left({.phase = Phase::kRefine, .num_queued = 30, .num_visits = 1020}, 20),
            15);
  EXPECT_EQ(pace.seconds_left({.phase = Phase::kRefine, .num_queued = 0, .num_visits = 1050}, 40),
            0);
}

TEST(Pace, KnowsNothingBeforeRefinement) {
  Pace pace;
  EXPECT_EQ(pace.seconds_left({.phase = Phase::kIngest, .num_queued = 9, .num_visits = 0}, 1),
            std::nullopt);
  EXPECT_EQ(pace.seconds_left({.phase = Phase::kRefine, .num_queued = 9, .num_visits = 0}, 101),
            std::nullopt);
  // The time before refinement does not count.
  EXPECT_EQ(pace.seconds_left({.phase = Phase::kRefine, .num_queued = 8, .num_visits = 1}, 103),
            16);
}

using Seconds = std::array<double, PhaseClock::kNumPhases>;

TEST(PhaseClock, CountsWhatPassesBeforeAPhaseIsSeenToTheOneBefore) {
  PhaseClock clock;
  EXPECT_EQ(clock.seconds_by_phase(2), (Seconds{2, 0, 0}));
  clock.note(Phase::kIngest, 3);
  clock.note(Phase::kInitialize, 5);
  clock.note(Phase::kInitialize, 6);
  EXPECT_EQ(clock.seconds_by_phase(8), (Seconds{5, 3, 0}));
  clock.note(Phase::kRefine, 9);
  clock.note(Phase::kRefine, 10);
  clock.note(Phase::kDone, 20);
  EXPECT_EQ(clock.seconds_by_phase(21), (Seconds{5, 4, 12}));
}

TEST(PhaseClock, OfAResumedRunBeginsWithOpeningTheStore) {
  PhaseClock clock;
  clock.note(Phase::kRefine, 1);
  EXPECT_EQ(clock.seconds_by_phase(4), (Seconds{1, 0, 3}));
}

}  // namespace
}  // namespace locvol
