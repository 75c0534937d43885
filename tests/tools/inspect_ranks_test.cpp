// `inspect` by several ranks, which are threads here, against that of one store with all they have.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <exception>
#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "engine/exchange/merged_rows.h"
#include "engine/exchange/thread_ranks.h"
#include "engine/rank_engine.h"
#include "engine/ranks/rank_store.h"
#include "tests/damaged_record.h"
#include "tests/engine/closed_shapes.h"
#include "tests/file_bytes.h"
#include "tests/temp_dir.h"
#include "tools/commands.h"

namespace locvol {

struct NumberRow {
  std::uint64_t number = 0, rank = 0;
  RowOrder order() const { return {number}; }
  std::size_t num_bytes() const { return 1000; }
  friend bool operator==(const NumberRow&, const NumberRow&) = default;
};
auto fields(Maybe<NumberRow> auto& row) {
  auto& [number, rank] = row;
  return std::tuple(Field("number", number), Field("rank", rank));
}

namespace {

using namespace testing_shapes;

struct Shown {
  std::string out, err;
  std::vector<int> codes;  // of each rank
};

Shown shown(const std::function<std::vector<int>()>& run) {
  testing::internal::CaptureStdout();
  testing::internal::CaptureStderr();
  Shown result;
  std::exception_ptr error;
  try {
    result.codes = run();
  } catch (...) {
    error = std::current_exception();
  }
  result.out = testing::internal::GetCapturedStdout();
  result.err = testing::internal::GetCapturedStderr();
  if (error) std::rethrow_exception(error);
  return result;
}

using Choose = std::function<void(InspectCommand&)>;

class InspectRanks : public testing::Test {
 protected:
  void mesh(int num_ranks, const std::function<void(MeshOptions&)>& choose = {},
            const RunControl& control = {}) {
    num_ranks_ = num_ranks;
    write_off(sphere(1, 16, 32), scratch_ / "input.off");
    MeshOptions options;
    options.input = scratch_ / "input.off";
    options.store = stores_;
    options.size = {0.1, false};
    options.leaf_capacity = 300;
    if (choose) choose(options);
    run_as_ranks(num_ranks, [&](Exchange& exchange) { mesh_as_rank(options, control, exchange); });
  }
  void join() {
    std::filesystem::remove_all(whole_);
    run_as_ranks(num_ranks_,
                 [&](Exchange& exchange) { join_ranks(stores_, whole_, {}, exchange); });
  }
  std::filesystem::path part(int rank) const { return store_of_rank(stores_, rank); }

  Shown by_ranks(const Choose& choose, int num_ranks) const {
    InspectCommand command;
    command.store = stores_;
    choose(command);
    return shown([&] {
      std::vector<int> codes(static_cast<std::size_t>(num_ranks), -1);
      run_as_ranks(num_ranks, [&](Exchange& exchange) {
        codes[static_cast<std::size_t>(exchange.rank())] = run_inspect_as_rank(command, exchange);
      });
      return codes;
    });
  }
  Shown by_ranks(const Choose& choose) const { return by_ranks(choose, num_ranks_); }
  Shown of_whole(const Choose& choose) const {
    InspectCommand command;
    command.store = whole_;
    choose(command);
    return shown([&] { return std::vector{run_inspect(command)}; });
  }
  std::string refusal_of(int num_ranks) const {
    try {
      by_ranks([](InspectCommand&) {}, num_ranks);
    } catch (const std::runtime_error& e) {
      return e.what();
    }
    return "none";
  }
  nlohmann::json summary(const Choose& choose = [](InspectCommand&) {}) const {
    return nlohmann::json::parse(by_ranks([&](InspectCommand& command) {
                                   command.is_json = true;
                                   choose(command);
                                 }).out);
  }

  // Of all views, as text and as JSON: what they print and write.
  void expect_what_the_whole_shows() {
    join();
    for (const bool is_json : {false, true})
      for (std::size_t i = 0; i < views().size(); ++i) {
        SCOPED_TRACE("view " + std::to_string(i) + (is_json ? ", JSON" : ""));
        const auto choose = [&](InspectCommand& command) {
          command.is_json = is_json;
          views()[i](command);
        };
        const std::filesystem::path file = scratch_ / "look.vtu";
        std::filesystem::remove(file);
        const Shown one = of_whole(choose);
        const std::string file_of_one = std::filesystem::exists(file) ? bytes_of(file) : "";
        std::filesystem::remove(file);
        const Shown all = by_ranks(choose);
        EXPECT_EQ(all.out, one.out);
        EXPECT_EQ(all.err, "");
        EXPECT_EQ(all.codes, std::vector(static_cast<std::size_t>(num_ranks_), 0));
        EXPECT_TRUE((std::filesystem::exists(file) ? bytes_of(file) : "") == file_of_one);
      }
    expect_summary_of_the_whole();
  }

  std::vector<Choose> views() const {
    const auto leaves = [](const Choose& choose) {
      return [choose](InspectCommand& command) {
        command.lists_leaves = true;
        choose(command);
      };
    };
    const auto sorted = [](const char* field, bool is_reversed) {
      return [field, is_reversed](InspectCommand& command) {
        command.listing.sort = parse_sort(field);
        command.listing.is_reversed = is_reversed;
      };
    };
    const auto limited = [](std::uint64_t limit, const Choose& choose) {
      return [limit, choose](InspectCommand& command) {
        command.listing.limit = limit;
        choose(command);
      };
    };
    const auto file = [this](const Choose& choose) {
      return [this, choose](InspectCommand& command) {
        command.vtu = scratch_ / "look.vtu";
        choose(command);
      };
    };
    const Choose nothing = [](InspectCommand&) {};
    const Choose checked = [](InspectCommand& command) { command.reads_all = true; };
    const Choose some = [](InspectCommand& command) {
      command.listing.conditions = {parse_condition("cells>50")};
      command.listing.state = LeafState::kClean;
    };
    const Choose queue = [](InspectCommand& command) { command.lists_queue = true; };
    const Choose unresolved = [](InspectCommand& command) { command.lists_unresolved = true; };
    const Choose creases = [](InspectCommand& command) { command.lists_creases = true; };
    std::vector<Choose> all = {leaves(nothing),
                               leaves(checked),
                               leaves(some),
                               leaves(limited(7, nothing)),
                               leaves(sorted("cells", false)),
                               leaves(limited(7, sorted("points", true))),
                               leaves(sorted("key", true)),
                               queue,
                               limited(5, queue),
                               unresolved,
                               limited(3, unresolved),
                               creases,
                               limited(4, creases),
                               file(creases),
                               file(nothing),
                               file(limited(9, sorted("visits", false)))};
    // Leaves of each rank.
    for (const LeafSpec& spec : {LeafSpec(Point{0.7, 0.7, 0.1}), LeafSpec(Point{-0.7, -0.7, -0.1}),
                                 LeafSpec(Point{0, 0, 0}), LeafSpec(first_leaf_of_last())}) {
      const Choose leaf = [spec](InspectCommand& command) { command.leaf = spec; };
      all.insert(all.end(), {leaf, limited(2, leaf), file(leaf)});
    }
    return all;
  }

  MortonKey first_leaf_of_last() const {
    const Store store = Store::open(part(num_ranks_ - 1), {.read_only = true});
    std::optional<MortonKey> first;
    store.snapshot().for_each_leaf([&](MortonKey leaf, const LeafInfo& info) {
      if (info.holding == Holding::kOwn && info.num_points > 0) first = leaf;
      return !first;
    });
    return first.value();
  }

  // But for what is of several files and processes.
  void expect_summary_of_the_whole() {
    for (const bool reads_all : {false, true}) {
      const auto choose = [&](InspectCommand& command) {
        command.is_json = true;
        command.reads_all = reads_all;
      };
      nlohmann::json one = nlohmann::json::parse(of_whole(choose).out), all = summary(choose);
      if (num_ranks_ > 1) {
        EXPECT_EQ(all["ranks"]["num_ranks"], num_ranks_);
        EXPECT_EQ(all["ranks"]["num_working"], 0);
        EXPECT_EQ(all["ranks"]["least_superstep"], all["ranks"]["largest_superstep"]);
      }
      EXPECT_EQ(all["databases"].size(), one["databases"].size());
      EXPECT_GE(all["databases"][1]["num_entries"], one["databases"][1]["num_entries"]);
      for (nlohmann::json* json : {&one, &all}) {
        for (const char* name :
             {"ranks", "memory", "databases", "bytes", "file_bytes", "bytes_per_cell"})
          json->erase(name);
        if (!json->contains("statistics")) continue;
        EXPECT_NEAR((*json)["statistics"]["volume"].get<double>(), 4.1, 0.2);
        (*json)["statistics"].erase("volume");  // added up rank by rank
      }
      EXPECT_EQ(all, one);
    }
    const Choose nothing = [](InspectCommand&) {};
    const std::string one = of_whole(nothing).out, all = by_ranks(nothing).out;
    const auto until_memory = [](const std::string& text) {
      return text.substr(0, text.find("\nmemory "));
    };
    EXPECT_EQ(until_memory(all), until_memory(one));
    EXPECT_LT(until_memory(one).size(), one.size());
  }

  const TempDir scratch_;
  const std::filesystem::path stores_ = scratch_ / "part-%r", whole_ = scratch_ / "whole";
  int num_ranks_ = 0;
};

TEST(MergedRows, ComeInTheOrderOfAll) {
  for (const int num_ranks : {1, 2, 3, 5}) {
    std::vector<NumberRow> rows, more, expected;
    for (std::uint64_t number = 0; number < 1000; ++number)
      for (std::uint64_t rank = 0; rank < static_cast<std::uint64_t>(num_ranks); ++rank)
        if (number % (rank + 2) == 0) expected.push_back({number, rank});
    run_as_ranks(num_ranks, [&](Exchange& exchange) {
      std::vector<NumberRow>* into = &rows;
      MergedRows<NumberRow> merged(exchange, [&](const NumberRow& row) {
        if (into == &more && more.size() == 10) return false;
        into->push_back(row);
        return true;
      });
      const auto rank = static_cast<std::uint64_t>(exchange.rank());
      for (std::uint64_t number = 0; number < 1000; number += rank + 2)
        EXPECT_TRUE(merged.add({number, rank}));
      merged.finish();
      into = &more;
      std::uint64_t num_added = 0;
      while (num_added < 100'000 && merged.add({num_added, rank})) ++num_added;
      EXPECT_LT(num_added, 1000U);  // no more was wanted
      merged.finish();
    });
    EXPECT_TRUE(rows == expected) << num_ranks;
    EXPECT_EQ(more.size(), 10U);
  }
}

TEST_F(InspectRanks, OfAFinishedRunShowWhatTheWholeShows) {
  for (const int num_ranks : {1, 2, 3, 5}) {
    SCOPED_TRACE(num_ranks);
    mesh(num_ranks);
    expect_what_the_whole_shows();
    for (int rank = 0; rank < num_ranks; ++rank) std::filesystem::remove_all(part(rank));
  }
}

TEST_F(InspectRanks, OfAStoppedRunShowWhatTheWholeShows) {
  for (const int num_ranks : {2, 3}) {
    SCOPED_TRACE(num_ranks);
    std::atomic<bool> is_refining = false;
    std::atomic<int> num_asked = 0;
    RunControl control;
    control.num_threads = 1;
    control.on_progress = [&](const Progress& progress) {
      if (progress.phase == Phase::kRefine) is_refining = true;
    };
    control.is_stopped = [&] { return is_refining && ++num_asked > 20; };
    const auto choose = [](MeshOptions& options) { options.size = {0.05, false}; };
    mesh(num_ranks, choose, control);
    const nlohmann::json shown = summary();
    EXPECT_EQ(shown["phase"], "refine");
    EXPECT_GT(shown["queue"]["num_waiting"], 10);
    expect_what_the_whole_shows();
    for (int rank = 0; rank < num_ranks; ++rank) std::filesystem::remove_all(part(rank));
  }
}

TEST_F(InspectRanks, ShowSizesOfTheWhole) {
  mesh(3, [](MeshOptions& options) {
    options.size = {0.15, false};
    options.growth = 0.3;
    options.deviation = Size{0.03, false};
  });
  join();
  const Choose sizes = [](InspectCommand& command) { command.lists_sizes = true; };
  EXPECT_EQ(by_ranks(sizes).out, of_whole(sizes).out);
  const std::filesystem::path file = scratch_ / "sizes.vtu";
  const Choose written = [&](InspectCommand& command) {
    command.lists_sizes = true;
    command.vtu = file;
  };
  const std::string one = of_whole(written).out, bytes = bytes_of(file);
  EXPECT_EQ(by_ranks(written).out, one);
  EXPECT_TRUE(bytes_of(file) == bytes);
  expect_summary_of_the_whole();
}

TEST_F(InspectRanks, ShowPoorCellsOfTheWhole) {
  mesh(3, [](MeshOptions& options) {
    options.size = {0.2, false};
    options.min_dihedral = 40;
  });
  join();
  std::vector<std::size_t> nums;
  for (const std::optional<std::uint64_t> limit : {std::optional<std::uint64_t>(), {7}}) {
    const Choose choose = [&](InspectCommand& command) {
      command.is_json = command.lists_unresolved = true;
      command.listing.limit = limit;
    };
    const std::string listed = by_ranks(choose).out;
    EXPECT_EQ(listed, of_whole(choose).out);
    nums.push_back(nlohmann::json::parse(listed).size());
  }
  EXPECT_GT(nums[0], 20U);
  EXPECT_EQ(nums[1], 7U);
  expect_summary_of_the_whole();
}

// What can be read is shown, and what cannot is said with rank and store.
TEST_F(InspectRanks, ShowDamageInItsPlace) {
  mesh(3);
  const std::size_t num_leaves = summary()["num_leaves"];
  const MortonKey leaf = first_leaf_of_last();
  const auto points = Store::open(part(2), {.read_only = true}).snapshot().points(leaf);
  const auto info = Store::open(part(2), {.read_only = true}).snapshot().leaf(leaf).value();
  const auto run = Store::open(part(1), {.read_only = true}).snapshot().run().value();
  const auto rank = Store::open(part(1), {.read_only = true}).snapshot().rank().value();
  const auto expect_named = [&](const Shown& shown, int damaged) {
    EXPECT_EQ(shown.codes, std::vector(3, 1));
    const std::string named = "locvol-mpi: error: rank " + std::to_string(damaged) +
                              ": the store " + part(damaged).string() + " is damaged in ";
    EXPECT_NE(shown.err.find(named), std::string::npos) << shown.err;
  };
  const Choose leaves = [](InspectCommand& command) {
    command.is_json = command.lists_leaves = true;
  };

  // Met only where cells are measured.
  damage_record(part(2), points, leaf);
  const Shown measured = by_ranks([](InspectCommand& command) { command.is_json = true; });
  expect_named(measured, 2);
  EXPECT_FALSE(nlohmann::json::parse(measured.out).contains("statistics"));
  EXPECT_EQ(nlohmann::json::parse(measured.out)["leaves"]["num_leaves"], num_leaves);
  EXPECT_EQ(nlohmann::json::parse(measured.out)["faults"].size(), 1U);

  damage_record(part(2), info, leaf);
  const Shown listed = by_ranks(leaves);
  expect_named(listed, 2);
  const nlohmann::json rows = nlohmann::json::parse(listed.out);
  ASSERT_EQ(rows.size(), num_leaves);
  EXPECT_TRUE(std::ranges::is_sorted(
      rows, {}, [](const nlohmann::json& row) -> std::string { return row["leaf"]; }));
  EXPECT_EQ(
      std::ranges::count(rows, "damaged", [](const nlohmann::json& row) { return row["state"]; }),
      1);

  damage_record(part(1), run, MortonKey());
  damage_record(part(1), rank, MortonKey());
  const Shown without_run = by_ranks(leaves);
  expect_named(without_run, 1);
  expect_named(without_run, 2);
  EXPECT_EQ(nlohmann::json::parse(without_run.out).size(), num_leaves);

  std::ofstream(part(1) / "data.mdb", std::ios::trunc) << std::string(1 << 16, 'x');
  const Shown unopened = by_ranks(leaves);
  expect_named(unopened, 1);
  const std::size_t num_others = nlohmann::json::parse(unopened.out).size();
  EXPECT_GT(num_others, 0U);
  EXPECT_LT(num_others, num_leaves);
  const Shown summed = by_ranks([](InspectCommand& command) { command.is_json = true; });
  expect_named(summed, 1);
  EXPECT_EQ(nlohmann::json::parse(summed.out)["leaves"]["num_leaves"], num_others);
}

// Ranks are not seen at one moment.
TEST_F(InspectRanks, SayThatRanksAreApart) {
  mesh(2);
  {
    Store store = Store::open(part(1));
    RankRecord rank = store.snapshot().rank().value();
    rank.superstep += 7;
    Batch batch = store.begin();
    batch.put_rank(rank);
    batch.commit();
  }
  const Shown shown = by_ranks([](InspectCommand&) {});
  EXPECT_EQ(shown.codes, std::vector(2, 0));
  EXPECT_NE(shown.out.find("note             ranks were seen at supersteps "), std::string::npos)
      << shown.out;
}

TEST_F(InspectRanks, RefuseWhatIsNotOneRun) {
  mesh(3);
  EXPECT_NE(refusal_of(2).find("the run is of 3 ranks"), std::string::npos) << refusal_of(2);
  EXPECT_NE(refusal_of(4).find("the run is of 3 ranks"), std::string::npos) << refusal_of(4);
  std::filesystem::rename(part(1), part(9));
  EXPECT_NE(refusal_of(3).find("rank 1, store " + part(1).string() + ": there is no part"),
            std::string::npos)
      << refusal_of(3);
  std::filesystem::rename(part(2), part(1));
  std::filesystem::rename(part(9), part(2));
  EXPECT_NE(refusal_of(3).find("this is the part of rank 2"), std::string::npos) << refusal_of(3);
  for (int rank = 0; rank < 3; ++rank) std::filesystem::remove_all(part(rank));
  EXPECT_NE(refusal_of(3).find("hold no run"), std::string::npos) << refusal_of(3);
}

TEST_F(InspectRanks, SayWhereALeafIsThatIsNone) {
  mesh(2);
  const auto refusal = [&](const LeafSpec& spec) -> std::string {
    try {
      by_ranks([&](InspectCommand& command) { command.leaf = spec; });
    } catch (const std::runtime_error& e) {
      return e.what();
    }
    return "none";
  };
  EXPECT_NE(refusal(MortonKey::root()).find("it has been split"), std::string::npos);
  EXPECT_NE(refusal(Point{100, 0, 0}).find("no leaf around (100, 0, 0)"), std::string::npos);
}

}  // namespace
}  // namespace locvol
