// What visits reserve against what they take: every allocation of this program is counted.
#include <gtest/gtest.h>
#include <malloc.h>

#include <algorithm>
#include <cstdlib>
#include <limits>
#include <new>

#include "engine/engine.h"
#include "engine/exchange/one_rank.h"
#include "engine/formats/writer.h"
#include "engine/run/run_state.h"
#include "engine/run/whole_model.h"
#include "engine/stages/stages.h"
#include "tests/engine/closed_shapes.h"
#include "tests/temp_dir.h"
#include "tools/generate.h"

namespace {

// One thread allocates.
std::size_t bytes_in_use = 0, most_bytes_in_use = 0;

}  // namespace

void* operator new(std::size_t size) {
  void* const block = std::malloc(size);
  if (block == nullptr) throw std::bad_alloc();
  bytes_in_use += malloc_usable_size(block) + 8;
  most_bytes_in_use = std::max(most_bytes_in_use, bytes_in_use);
  return block;
}
void operator delete(void* block, std::size_t) noexcept {
  if (block != nullptr) bytes_in_use -= malloc_usable_size(block) + 8;
  std::free(block);
}
void operator delete(void* block) noexcept { operator delete (block, std::size_t{0}); }

namespace locvol {
namespace {

struct Case {
  const char* shape;
  std::uint64_t num_triangles;
  double percent;
  std::uint64_t leaf_capacity;
};

// For the failure messages of a parameterized test.
void PrintTo(const Case& c, std::ostream* out) { *out << c.shape << ' ' << c.percent << '%'; }

class NeverStopped : public StopToken {
 public:
  bool is_stopped() const override { return false; }
};
const NeverStopped kNeverStopped;

// What a visit takes from where it has reserved its memory.
class VisitMemory : public testing::TestWithParam<Case> {
 protected:
  // The engine's loop, with the reservation of each visit at hand.
  void run(Store& store) {
    MemoryBudget budget(std::numeric_limits<std::uint64_t>::max() / 4);
    RunState state(store);
    HeldModel model(state, budget);
    while (state.run().phase != Phase::kDone) {
      const auto stage =
          stage_in(state.run().phase, {state, model, budget, kNeverStopped, alone(), alone()});
      visit_all(state, *stage->visits());
      state.begin_phase(stage->end());
      state.commits().commit();
    }
  }

  void visit_all(RunState& state, LeafVisits& visits) {
    const LeafQueue& queue = state.queue().entries();
    while (!queue.is_empty()) {
      if (state.queue().open_epoch([&](MortonKey leaf) { return visits.conflict_distance(leaf); }))
        state.commits().commit();
      while (!queue.is_empty() && state.queue().is_epoch_open())
        for (const MortonKey leaf : queue.front_leaves()) {
          measure(state, visits, leaf);
          state.commits().note_visit();
          if (state.commits().is_due()) state.commits().commit();
        }
      if (visits.is_once()) return;
    }
  }

  // What lies around is brought into the cache before, so that the visit need not.
  void measure(const RunState& state, LeafVisits& visits, MortonKey leaf) {
    for (const MortonKey near :
         state.octree().leaves_within(state.frame(), state.box(leaf), kReach * state.size()))
      state.leaves().surface(near), state.leaves().points(near);
    const std::size_t before = begin_measuring();
    const auto visit = visits.load(leaf);
    visit->compute();
    compare(visit->bytes(), before);
    visit->apply();
  }

  static std::size_t begin_measuring() { return most_bytes_in_use = bytes_in_use; }

  void compare(std::uint64_t reserved, std::size_t before) {
    const std::uint64_t taken = most_bytes_in_use - before;
    EXPECT_LE(taken, reserved);
    reserved_ += reserved;
    taken_ += taken;
    worst_ = std::max(worst_, static_cast<double>(taken) / static_cast<double>(reserved));
  }

  std::uint64_t reserved_ = 0, taken_ = 0;
  double worst_ = 0;
};

TEST_P(VisitMemory, StaysWithinItsReservation) {
  const TempDir dir;
  const Case& c = GetParam();
  generate(c.shape, c.num_triangles, dir / "surface.stl");
  MeshOptions options;
  options.input = dir / "surface.stl";
  options.store = dir / "store";
  options.size = {c.percent, true};
  options.leaf_capacity = c.leaf_capacity;
  RunControl stop_after_ingest;
  bool is_ingested = false;
  stop_after_ingest.on_progress = [&](const Progress& p) {
    is_ingested = p.phase != Phase::kIngest;
  };
  stop_after_ingest.is_stopped = [&] { return is_ingested; };
  mesh(options, stop_after_ingest);
  Store store = Store::open(dir / "store");
  run(store);
  EXPECT_LT(worst_, 0.97) << "leave some margin";
  EXPECT_GT(worst_, 0.3) << "a reservation that large is waste";
  RecordProperty("worst", std::to_string(worst_));
  RecordProperty("mean",
                 std::to_string(static_cast<double>(taken_) / static_cast<double>(reserved_)));
}

// A leaf outside may be a thousand λ wide, and touch one with a core.
TEST(WriterMemory, DoesNotGrowWithTheLeavesOutside) {
  const TempDir dir;
  using namespace testing_shapes;
  const auto ball = sphere(12, 15, 32);
  // The ball in the middle touches the root's center plane, and beyond is nothing for long.
  write_off(together(together(ball, translated(ball, {2000, 0, 0})), translated(ball, {980, 0, 0})),
            dir / "surface.off");
  MeshOptions options;
  options.input = dir / "surface.off";
  options.store = dir / "store";
  options.size = {1, false};
  RunControl control;
  control.num_threads = 1;
  EXPECT_EQ(mesh(options, control).outcome, RunOutcome::kDone);
  const Store store = Store::open(dir / "store");
  const std::size_t before = most_bytes_in_use = bytes_in_use;
  write_vtu(store, dir / "mesh.vtu", 1);
  EXPECT_LT(most_bytes_in_use - before, std::size_t{48} << 20);
}

INSTANTIATE_TEST_SUITE_P(Runs, VisitMemory,
                         testing::Values(Case{"three-holes", 20000, 5, 1000},
                                         Case{"three-holes", 20000, 4, 20000},
                                         Case{"three-holes", 400000, 5, 5000},
                                         Case{"sphere", 5000, 3, 20000},
                                         Case{"gyroid-ball", 100000, 2, 5000}));

}  // namespace
}  // namespace locvol
