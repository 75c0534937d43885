// A visit in a file is the visit: all that it depends on is there, to the last bit.
#include "tools/visit_file.h"

#include <gtest/gtest.h>

#include <optional>
#include <string>
#include <vector>

#include "engine/engine.h"
#include "tests/temp_dir.h"
#include "tools/generate.h"

namespace locvol {
namespace {

class VisitFile : public testing::Test {
 protected:
  VisitFile() { generate("three-holes", 2000, dir_ / "surface.stl"); }

  // Stops once the run is in refinement and has made so many visits; all of what waits then.
  std::vector<StoredVisit> waiting_after(std::uint64_t num_visits) {
    MeshOptions options;
    options.input = dir_ / "surface.stl";
    options.store = dir_ / "store";
    options.size = {10, true};
    options.leaf_capacity = 150;
    bool is_enough = false;
    const RunControl control{.on_progress =
                                 [&](const Progress& p) {
                                   is_enough |= p.phase == Phase::kRefine &&
                                                p.counts.num_visits >= num_visits;
                                 },
                             .is_stopped = [&] { return is_enough; },
                             .num_threads = 1};
    EXPECT_EQ(mesh(options, control).outcome, RunOutcome::kInterrupted);
    std::vector<StoredVisit> visits;
    const Store store = Store::open(options.store, {.read_only = true});
    for (const MortonKey leaf : store.snapshot().leaf_keys())
      if (store.snapshot().leaf(leaf)->queued) visits.push_back(stored_visit(store, leaf));
    return visits;
  }
  StoredVisit through_a_file(const StoredVisit& visit) const {
    write_visit(visit, dir_ / "visit.json");
    return read_visit(dir_ / "visit.json");
  }

  const TempDir dir_;
};

bool operator==(const RefineStep& a, const RefineStep& b) {
  return a.action == b.action && a.condition == b.condition && a.radius == b.radius &&
         a.point == b.point && a.position == b.position && a.kind == b.kind;
}

void expect_same(const StoredVisit& visit, const StoredVisit& read) {
  EXPECT_EQ(read.input.criteria.cover_radius, visit.input.criteria.cover_radius);
  ASSERT_EQ(read.input.last_visit.has_value(), visit.input.last_visit.has_value());
  if (visit.input.last_visit) {
    EXPECT_EQ(read.input.last_visit->first_new_id, visit.input.last_visit->first_new_id);
    EXPECT_EQ(read.input.last_visit->deleted, visit.input.last_visit->deleted);
    EXPECT_EQ(read.input.last_visit->cells, visit.input.last_visit->cells);
  }
  const Replay expected = replay(visit), found = replay(read);
  EXPECT_EQ(found.error, expected.error);
  EXPECT_TRUE(std::ranges::equal(found.steps, expected.steps,
                                 [](const auto& a, const auto& b) { return a == b; }));
  EXPECT_EQ(found.mesh.cells, expected.mesh.cells);
  EXPECT_EQ(found.delta.stats.cells_made, expected.delta.stats.cells_made);
}

TEST_F(VisitFile, RepeatsWhatARunWouldDoNext) {
  const std::vector<StoredVisit> visits = waiting_after(45);
  ASSERT_GT(visits.size(), 10U);
  int num_in_part = 0;
  for (const StoredVisit& visit : visits) {
    num_in_part += visit.input.last_visit.has_value();
    expect_same(visit, through_a_file(visit));
  }
  EXPECT_GT(num_in_part, 0) << "visits of leaves that had been clean";
}

TEST_F(VisitFile, RepeatsAFailure) {
  int num_failed = 0;
  for (StoredVisit& visit : waiting_after(20)) {
    visit.input.max_insertions = 1;
    const StoredVisit read = through_a_file(visit);
    num_failed += replay(read).error.starts_with("more than 1 insertions");
    expect_same(visit, read);
  }
  EXPECT_GT(num_failed, 0);
}

}  // namespace
}  // namespace locvol
