// Whole runs of several ranks against one process.
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <optional>
#include <stdexcept>
#include <string>

#include "engine/engine.h"
#include "engine/exchange/thread_ranks.h"
#include "engine/formats/writer.h"
#include "engine/inspect/mesh_statistics.h"
#include "engine/plan/run_setup.h"
#include "engine/ranks/deal_out.h"
#include "engine/shared/input_error.h"
#include "tests/engine/closed_shapes.h"
#include "tests/engine/store_contents.h"
#include "tests/file_bytes.h"
#include "tests/skip_reasons.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

using namespace testing_shapes;

class RunOfRanks : public testing::Test {
 protected:
  MeshOptions options(const std::string& store, double size, std::uint64_t leaf_capacity) const {
    MeshOptions options;
    options.input = scratch_ / "input.off";
    options.store = scratch_ / store;
    options.size = {size, false};
    options.leaf_capacity = leaf_capacity;
    return options;
  }

  // All that the ranks have of their own, in one store.
  Contents mesh_by(int num_ranks, const MeshOptions& options, int num_threads,
                   const ThreadRanksOptions& ranks = {}) {
    const std::string name = options.store.string() + "-" + std::to_string(num_ranks);
    run_as_ranks(
        num_ranks,
        [&](Exchange& exchange) {
          MeshOptions own = options;
          own.store = name + "-" + std::to_string(exchange.rank());
          RunControl control;
          control.num_threads = num_threads;
          mesh_as_rank(own, control, exchange);
          std::optional<Store> whole;
          if (exchange.rank() == 0) {
            std::filesystem::remove_all(name);
            whole = Store::open(name, {.create = true});
          }
          join(Store::open(own.store, {.read_only = true}), whole ? &*whole : nullptr, exchange);
        },
        ranks);
    return contents_of(name);
  }

  // What two ranks say to it.
  std::string refusal_of(const MeshOptions& options) {
    try {
      mesh_by(2, options, 1);
    } catch (const StoreError& e) {
      return e.what();
    } catch (const StoreMismatch& e) {
      return e.what();
    }
    return "none";
  }

  TempDir scratch_;
};

TEST_F(RunOfRanks, HasTheRecordsOfOneProcess) {
  write_off(sphere(1, 24, 48), scratch_ / "input.off");
  const MeshOptions options = this->options("store", 0.04, 500);
  mesh(options);
  const Contents expected = contents_of(options.store);
  EXPECT_GT(expected.leaves.size(), 100U);
  for (const int num_ranks : {1, 2, 3, 7})
    EXPECT_TRUE(are_equal(expected, mesh_by(num_ranks, options, num_ranks % 2 + 1))) << num_ranks;
}

TEST_F(RunOfRanks, WritesTheBytesOfOneProcess) {
  write_off(together(sphere(1, 24, 48), translated(torus(0.5, 0.2, 30, 16), {1.9, 0, 0.4})),
            scratch_ / "input.off");
  const MeshOptions options = this->options("store", 0.06, 500);
  mesh(options);
  const Store store = Store::open(options.store, {.read_only = true});
  const MeshStatistics expected = mesh_statistics(store);
  for (const int num_ranks : {1, 3, 6})
    for (const bool has_quality : {false, true}) {
      SCOPED_TRACE(num_ranks);
      const OutputOptions output{MeshFormat::kVtu, has_quality};
      write_mesh(store, scratch_ / "one.vtu", output);
      run_as_ranks(num_ranks, [&](Exchange& exchange) {
        MeshOptions own = options;
        own.store += "-" + std::to_string(num_ranks) + "-" + std::to_string(exchange.rank());
        const RunSummary summary = mesh_as_rank(own, {}, exchange);
        const Store part = Store::open(own.store, {.read_only = true});
        const WriteSummary written =
            write_mesh_as_rank(part, scratch_ / "many.vtu", output, exchange);
        EXPECT_EQ(written.num_cells, summary.run.counts.num_cells);
        EXPECT_EQ(written.bytes, std::filesystem::file_size(scratch_ / "many.vtu"));
        const MeshStatistics all = mesh_statistics_of_ranks(part, exchange);
        EXPECT_EQ(all.num_cells, expected.num_cells);
        EXPECT_EQ(all.num_core_cells, expected.num_core_cells);
        EXPECT_EQ(all.dihedral_angles.counts, expected.dihedral_angles.counts);
        EXPECT_EQ(all.min_dihedral_angles.counts, expected.min_dihedral_angles.counts);
        EXPECT_EQ(all.radius_edge_ratios.counts, expected.radius_edge_ratios.counts);
        EXPECT_EQ(all.radii_over_size.counts, expected.radii_over_size.counts);
        EXPECT_EQ(all.num_cells_by_octave, expected.num_cells_by_octave);
        EXPECT_EQ(all.max_dihedral_degrees, expected.max_dihedral_degrees);
        EXPECT_EQ(all.min_dihedral_degrees, expected.min_dihedral_degrees);
        EXPECT_EQ(all.max_circumradius, expected.max_circumradius);
        EXPECT_NEAR(all.volume, expected.volume, 1e-12 * expected.volume);
      });
      EXPECT_TRUE(bytes_of(scratch_ / "many.vtu") == bytes_of(scratch_ / "one.vtu"));
      EXPECT_FALSE(std::filesystem::exists(scratch_ / "many.vtu.partial"));
    }
}

// Leaves that are split, whose parts are a copy's, or beyond.
TEST_F(RunOfRanks, SplitsLeavesAsOneProcess) {
  write_off(torus(1, 0.4, 32, 16), scratch_ / "input.off");
  const MeshOptions options = this->options("store", 0.15, 12);
  mesh(options);
  const Contents expected = contents_of(options.store);
  for (const int num_ranks : {2, 9})
    EXPECT_TRUE(are_equal(expected, mesh_by(num_ranks, options, 1))) << num_ranks;
}

// Sites that stay unresolved, what is left out for them, and those that become one.
TEST_F(RunOfRanks, MendsAsOneProcess) {
  write_off(knives(), scratch_ / "input.off");
  const MeshOptions options = this->options("store", 1, 500);
  EXPECT_EQ(mesh(options).outcome, RunOutcome::kUnresolved);
  const Contents expected = contents_of(options.store);
  for (const int num_ranks : {3})
    EXPECT_TRUE(are_equal(expected, mesh_by(num_ranks, options, 1))) << num_ranks;
}

TEST_F(RunOfRanks, OfARealModelHasTheRecordsOfOneProcess) {
  const std::filesystem::path models = LOCVOL_MODELS_DIR;
  if (models.empty()) GTEST_SKIP() << kNoModels;
  MeshOptions options = this->options("store", 0, 3000);
  options.input = models / "rocker_arm.obj";
  options.size = {3, true};
  mesh(options);
  const Contents expected = contents_of(options.store);
  EXPECT_GT(expected.leaves.size(), 100U);
  for (const int num_ranks : {3, 8})
    EXPECT_TRUE(are_equal(expected, mesh_by(num_ranks, options, 2))) << num_ranks;
}

// As if the machine of one had failed, sooner or later in the run: all ranks end, each with what it
// has committed.
TEST_F(RunOfRanks, GoesOnAfterAnyRankEnds) {
  write_off(torus(1, 0.4, 48, 24), scratch_ / "input.off");
  const MeshOptions options = this->options("store", 0.12, 300);
  mesh(options);
  const Contents expected = contents_of(options.store);
  for (std::uint64_t round = 0; round < 4; ++round) {
    MeshOptions again = options;
    again.store += "-" + std::to_string(round);
    int num_ended = 0;
    for (bool is_done = false; !is_done;) {
      const std::uint64_t last = 10 + 7 * round + static_cast<std::uint64_t>(num_ended) % 5;
      const int ending = (num_ended + static_cast<int>(round)) % 3;
      const ThreadRanksOptions ranks{.fault = [&](int from, int to, std::uint64_t number) {
        if (from == ending && to == (from + 1) % 3 && number == last)
          throw std::runtime_error("killed");
        return MessageFault::kNone;
      }};
      try {
        EXPECT_TRUE(are_equal(expected, mesh_by(3, again, 1, ranks)));
        is_done = true;
      } catch (const std::runtime_error& e) {
        EXPECT_EQ(std::string(e.what()), "killed");
        ASSERT_LT(++num_ended, 500);
      }
    }
    EXPECT_GT(num_ended, 1);
  }
}

TEST_F(RunOfRanks, EndsWhereAMessageIsLost) {
  write_off(sphere(1, 12, 24), scratch_ / "input.off");
  const MeshOptions options = this->options("store", 0.3, 300);
  mesh(options);
  const Contents expected = contents_of(options.store);
  for (std::uint64_t lost = 0; lost < 100; lost += 23) {
    MeshOptions again = options;
    again.store += "-" + std::to_string(lost);
    const ThreadRanksOptions ranks{.fault =
                                       [&](int from, int, std::uint64_t number) {
                                         return from == 1 && number == lost ? MessageFault::kLost
                                                                            : MessageFault::kNone;
                                       },
                                   .patience = std::chrono::milliseconds(400)};
    EXPECT_THROW(mesh_by(2, again, 1, ranks), ExchangeError) << lost;
    EXPECT_TRUE(are_equal(expected, mesh_by(2, again, 1))) << lost;
  }
}

TEST_F(RunOfRanks, RefusesStoresThatDoNotBelongTogether) {
  write_off(sphere(1, 12, 24), scratch_ / "input.off");
  const MeshOptions options = this->options("store", 0.3, 300);
  mesh_by(2, options, 1);
  const std::filesystem::path first = scratch_ / "store-2-0", second = scratch_ / "store-2-1",
                              aside = scratch_ / "aside";
  std::filesystem::rename(second, aside);
  EXPECT_NE(refusal_of(options).find("rank 1, store " + second.string() + ": there is no part"),
            std::string::npos);
  std::filesystem::copy(first, second, std::filesystem::copy_options::recursive);
  EXPECT_NE(
      refusal_of(options).find("rank 1, store " + second.string() + ": this is the part of rank 0"),
      std::string::npos);
  std::filesystem::remove_all(second);
  std::filesystem::rename(aside, second);
  EXPECT_EQ(refusal_of(options), "none");

  const MeshOptions alone = this->options("alone-2-0", 0.3, 300);
  mesh(alone);
  EXPECT_NE(refusal_of(this->options("alone", 0.3, 300)).find("a run that one process makes"),
            std::string::npos);
}

TEST_F(RunOfRanks, OfOtherParametersIsRefusedUnlessForced) {
  write_off(sphere(1, 12, 24), scratch_ / "input.off");
  mesh_by(2, options("store", 0.3, 300), 1);
  MeshOptions other = options("store", 0.25, 300);
  EXPECT_NE(refusal_of(other).find("size"), std::string::npos) << refusal_of(other);
  other.is_forced = true;
  const Contents forced = mesh_by(2, other, 1);
  MeshOptions alone = options("alone", 0.25, 300);
  mesh(alone);
  EXPECT_TRUE(are_equal(contents_of(alone.store), forced));

  MeshOptions graded = options("graded", 0.3, 300);
  graded.growth = 0.2;
  EXPECT_THROW(mesh_by(2, graded, 1), InputError);
}

}  // namespace
}  // namespace locvol
