// What visits reserve against what they take: every allocation of this program is counted.
#include <gtest/gtest.h>
#include <malloc.h>

#include <algorithm>
#include <cstdlib>
#include <limits>
#include <new>

#include "engine/engine.h"
#include "engine/formats/writer.h"
#include "engine/run/apply_visit.h"
#include "engine/run/leaf_loader.h"
#include "engine/run/run_state.h"
#include "refine/cover_leaf.h"
#include "refine/fill_leaf.h"
#include "refine/refine_leaf.h"
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

// What a visit takes from where it has reserved its memory.
class VisitMemory : public testing::TestWithParam<Case> {
 protected:
  // The engine's loop, with the loader's reservation at hand.
  void run(Store& store) {
    MemoryBudget budget(std::numeric_limits<std::uint64_t>::max() / 4);
    RunState state(store);
    LeafLoader loader(state, budget);
    while (state.run().phase != Phase::kDone) {
      if (state.open_epoch()) state.commit();
      if (!state.queue().is_empty()) visit_front(state, loader);
      const bool is_covered =
          state.run().phase == Phase::kCover && state.queue().num_in_epoch(state.run().epoch) == 0;
      if (is_covered || state.queue().is_empty()) end_phase(state);
    }
  }

  void visit_front(RunState& state, LeafLoader& loader) {
    for (const MortonKey leaf : state.queue().front_leaves()) {
      switch (state.run().phase) {
        case Phase::kCover:
          cover(state, loader, leaf);
          break;
        case Phase::kFill:
          fill(state, loader, leaf);
          break;
        default:
          refine(state, loader, leaf);
      }
      state.note_visit();
      if (state.is_commit_due()) state.commit();
    }
  }

  void end_phase(RunState& state) {
    switch (state.run().phase) {
      case Phase::kCover:
        state.begin_phase(Phase::kFill);
        break;
      case Phase::kRefine:
        state.begin_phase(Phase::kDone);
        break;
      default:
        enqueue_for_refinement(state);
        state.begin_phase(Phase::kRefine);
    }
    state.commit();
  }

  // `reach`: over λ; what lies within it is brought into the cache before, so that the visit need
  // not.
  template <class Load, class Compute>
  auto measured(RunState& state, MortonKey leaf, double reach, Load load, Compute compute) {
    for (const MortonKey near :
         state.octree().leaves_within(state.run().frame, state.box(leaf), reach * state.size()))
      state.leaves().surface(near), state.leaves().points(near);
    const std::size_t before = begin_measuring();
    auto loaded = load();
    auto result = compute(loaded.complete());
    compare(loaded.bytes, before);
    return result;
  }

  void cover(RunState& state, LeafLoader& loader, MortonKey leaf) {
    const auto points = measured(
        state, leaf, 0, [&] { return loader.load_cover(leaf); }, cover_leaf);
    apply_cover(state, leaf, points);
  }

  void fill(RunState& state, LeafLoader& loader, MortonKey leaf) {
    const auto points = measured(
        state, leaf, kFillReach, [&] { return loader.load_fill(leaf); }, fill_leaf);
    apply_fill(state, leaf, points);
  }

  void refine(RunState& state, LeafLoader& loader, MortonKey leaf) {
    const auto delta = measured(
        state, leaf, kReach, [&] { return loader.load(leaf); }, refine_leaf);
    apply_visit(state, loader, leaf, delta);
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
    is_ingested = p.phase > Phase::kIngest;
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
