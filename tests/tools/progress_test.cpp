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

Standing refining() {
  Standing standing;
  standing.stage = RunStage::kRefine;
  standing.seconds = 61;
  standing.fraction = 0.629;
  standing.progress = {.phase = Phase::kRefine,
                       .counts = {.num_visits = 500, .num_points = 70'000, .num_cells = 8'237'025},
                       .num_leaves = 800,
                       .num_queued = 300,
                       .num_in_epoch = 290,
                       .epoch = 1};
  return standing;
}

TEST(ProgressText, SaysWhatIsKnown) {
  Standing standing = refining();
  EXPECT_EQ(progress_text(standing),
            "1:01 refine: 62%, 8.24 million cells, 300 of 800 leaves wait, epoch 1");
  standing.cells_per_second = 135'000;
  standing.resident = 63 << 20;
  standing.memory_cap = 256 << 20;
  standing.seconds_left = 9;
  EXPECT_EQ(progress_text(standing),
            "1:01 refine: 62%, about 0:09 left, 8.24 million cells (135 thousand/s), 300 of 800 "
            "leaves wait, epoch 1, 63/256 MiB");
  standing.stage = RunStage::kWrite;
  standing.all = 9'943'962;
  EXPECT_EQ(progress_text(standing),
            "1:01 write: 62%, about 0:09 left, of 9.94 million cells, 63/256 MiB");
  standing = {};
  standing.progress.num_triangles = 512;
  EXPECT_EQ(progress_text(standing), "0:00 ingest: 512 triangles read, checked and cut");
}

TEST(ProgressJson, HasTheDocumentedFields) {
  Standing standing = refining();
  Json json = progress_json(standing);
  EXPECT_EQ(json["event"], "progress");
  EXPECT_EQ(json["phase"], "refine");
  EXPECT_EQ(json["num_waiting"], 300);
  EXPECT_EQ(json["num_cells"], 8'237'025);
  EXPECT_TRUE(json["seconds_left"].is_null());
  standing.seconds_left = 2.5;
  json = progress_json(standing);
  EXPECT_EQ(json["seconds_left"], 2.5);
  EXPECT_EQ(json_line(json).find('\n'), std::string::npos);
  EXPECT_EQ(Json::parse(json_line(json)), json);
}

using Seconds = std::array<double, StageClock::kNumStages>;

TEST(StageClock, CountsWhatPassesBeforeAStageIsSeenToTheOneBefore) {
  StageClock clock;
  EXPECT_EQ(clock.seconds_by_stage(2), (Seconds{2, 0, 0}));
  clock.note(RunStage::kIngest, 3);
  clock.note(RunStage::kInitialize, 5);
  clock.note(RunStage::kInitialize, 6);
  EXPECT_EQ(clock.seconds_by_stage(8), (Seconds{5, 3, 0}));
  clock.note(RunStage::kRefine, 9);
  clock.note(RunStage::kRefine, 10);
  EXPECT_EQ(clock.seconds_by_stage(21), (Seconds{5, 4, 12}));
}

TEST(StageClock, OfAResumedRunBeginsWithOpeningTheStore) {
  StageClock clock;
  clock.note(RunStage::kRefine, 1);
  EXPECT_EQ(clock.seconds_by_stage(4), (Seconds{1, 0, 3}));
}

}  // namespace
}  // namespace locvol
