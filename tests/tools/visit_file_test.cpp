// A visit in a file is the visit: all that it depends on is there, to the last bit.
#include "tools/visit_file.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "engine/engine.h"
#include "tests/temp_dir.h"
#include "tests/tools/process.h"
#include "tools/generate.h"

namespace locvol {
namespace {

class VisitFile : public testing::Test {
 protected:
  VisitFile() { generate("three-holes", 2000, dir_ / "surface.stl"); }

  // Stops once the run is in refinement and has made so many visits; all of what waits then.
  std::vector<StoredVisit> waiting_after(std::uint64_t num_visits,
                                         Initialization init = Initialization::kCover) {
    MeshOptions options;
    options.input = dir_ / "surface.stl";
    options.store = dir_ / (init == Initialization::kCover ? "store" : "paper");
    options.size = {10, true};
    options.init = init;
    options.leaf_capacity = 150;
    bool is_enough = false;
    RunControl control;
    control.num_threads = 1;
    control.on_progress = [&](const Progress& p) {
      is_enough |= p.phase == Phase::kRefine && p.counts.num_visits >= num_visits;
    };
    control.is_stopped = [&] { return is_enough; };
    EXPECT_EQ(mesh(options, control).outcome, RunOutcome::kInterrupted);
    std::vector<StoredVisit> visits;
    const Store store = Store::open(options.store, {.read_only = true});
    for (const MortonKey leaf : store.snapshot().leaf_keys())
      if (store.snapshot().leaf(leaf)->queued) visits.push_back(stored_visit(store, leaf));
    return visits;
  }
  std::filesystem::path file() const { return dir_ / "visit.json"; }

  const TempDir dir_;
};

// From the file alone, by another process: of all that the visit gives.
std::string digest_elsewhere(const std::filesystem::path& file) {
  const ProcessResult result = run_locvol({"replay", "--from", file.string(), "--json"});
  EXPECT_EQ(result.exit_code, 0) << result.err;
  return nlohmann::json::parse(result.out).at("digest");
}

// As many as a hundred of a run's, before it makes them; those of leaves that had been clean, too.
TEST_F(VisitFile, OfARunGivesTheSameInAnotherProcess) {
  int num_visits = 0, num_in_part = 0, num_with_core = 0, num_insertions = 0;
  const auto check = [&](const std::vector<StoredVisit>& visits) {
    for (const StoredVisit& visit : visits) {
      write_visit(visit, file());
      EXPECT_TRUE(read_visit(file()) == visit);
      const Replay here = replay(visit);
      ASSERT_EQ(digest_elsewhere(file()), fmt::format("{:016x}", here.digest));
      ++num_visits;
      num_in_part += visit.input.last_visit.has_value();
      num_with_core += !visit.input.core.rows.empty();
      num_insertions += !here.delta.inserted.empty();
    }
  };
  for (const std::uint64_t num_made : {20, 45, 55}) check(waiting_after(num_made));
  EXPECT_GT(num_with_core, 0);
  check(waiting_after(5, Initialization::kPaper));
  EXPECT_GE(num_visits, 100);
  EXPECT_GE(num_in_part, 10);
  EXPECT_GE(num_insertions, 10);
}

TEST_F(VisitFile, RepeatsAFailure) {
  int num_failed = 0;
  for (StoredVisit& visit : waiting_after(20)) {
    visit.input.max_insertions = 1;
    write_visit(visit, file());
    const Replay expected = replay(visit), found = replay(read_visit(file()));
    num_failed += found.error.starts_with("more than 1 insertions");
    EXPECT_EQ(found.error, expected.error);
    EXPECT_EQ(found.digest, expected.digest);
  }
  EXPECT_GT(num_failed, 0);
}

}  // namespace
}  // namespace locvol
