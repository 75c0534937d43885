// `locvol inspect` and `locvol replay` from outside: finished, interrupted, damaged and live runs.
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <numeric>
#include <thread>

#include "engine/engine.h"
#include "tests/cube_off.h"
#include "tests/damaged_record.h"
#include "tests/file_bytes.h"
#include "tests/temp_dir.h"
#include "tests/tools/process.h"
#include "tests/vtu_arrays.h"

namespace locvol {
namespace {

using Names = std::vector<std::string>;

// A run over the unit cube, and the command that looks into its store.
class InspectTest : public testing::Test {
 protected:
  InspectTest() { std::ofstream(dir_ / "cube.off") << kCube; }

  MeshOptions options() const {
    MeshOptions options;
    options.input = dir_ / "cube.off";
    options.store = store_;
    options.size = {0.06, false};
    options.leaf_capacity = 150;
    return options;
  }
  RunSummary finish() { return mesh(options()); }
  void stop_after(std::uint64_t num_visits) {
    std::uint64_t num_made = 0;
    RunControl control;
    control.num_threads = 1;
    control.on_progress = [&](const Progress& progress) { num_made = progress.counts.num_visits; };
    control.is_stopped = [&] { return num_made == num_visits; };
    ASSERT_EQ(mesh(options(), control).outcome, RunOutcome::kInterrupted);
  }

  // What the command prints; its exit code must be `exit_code`.
  std::string run(Names arguments, int exit_code = 0) const {
    arguments.insert(arguments.begin() + 1, store_);
    const ProcessResult result = run_locvol(arguments);
    EXPECT_EQ(result.exit_code, exit_code) << result.out << result.err;
    EXPECT_EQ(result.err.empty(), exit_code == 0) << result.err;
    return result.out;
  }
  nlohmann::json inspect(Names arguments = {}, int exit_code = 0) const {
    arguments.insert(arguments.begin(), {"inspect", "--json"});
    return nlohmann::json::parse(run(arguments, exit_code));
  }
  nlohmann::json replay(const std::string& leaf, int exit_code = 0) const {
    return nlohmann::json::parse(run({"replay", "--leaf", leaf, "--json"}, exit_code));
  }

  const TempDir dir_;
  const std::string store_ = (dir_ / "store").string();
};

std::vector<std::uint64_t> counts(const nlohmann::json& rows, const std::string& name) {
  std::vector<std::uint64_t> counts;
  for (const nlohmann::json& row : rows) counts.push_back(row.at(name));
  return counts;
}

TEST_F(InspectTest, SummaryTellsTheFactsOfTheRun) {
  const RunSummary summary = finish();
  const nlohmann::json json = inspect();
  EXPECT_EQ(json["phase"], "done");
  EXPECT_EQ(json["num_cells"], summary.run.counts.num_cells);
  EXPECT_EQ(json["num_points"], summary.run.counts.num_points);
  EXPECT_EQ(json["num_leaves"], summary.num_leaves);
  EXPECT_EQ(json["num_visits"], summary.run.counts.num_visits);
  EXPECT_EQ(json["max_visits_of_a_leaf"], summary.max_visits_of_a_leaf);
  EXPECT_EQ(json["epoch"], summary.run.epoch);
  const std::array conditions = {"C1", "C2", "C3", "C4", "C5", "C6", "C7"};
  for (std::size_t c = 0; c < kNumConditions; ++c)
    EXPECT_EQ(json["insertions"][conditions[c]], summary.run.counts.num_insertions[c]);
  EXPECT_EQ(json["num_moves"], summary.run.counts.num_moves);
  EXPECT_EQ(json["parameters"]["min_dihedral"], 15);
  EXPECT_EQ(json["writer"], nullptr);
  EXPECT_EQ(json["has_gone_on"], false);
  EXPECT_EQ(json["queue"]["num_waiting"], 0);
  EXPECT_EQ(json["queue"]["front"], nullptr);
  EXPECT_EQ(json["parameters"]["size"], 0.06);
  EXPECT_EQ(json["surface"]["num_triangles"], 12);
  EXPECT_EQ(json["leaves"]["num_leaves"], summary.num_leaves);
  EXPECT_EQ(json["leaves"]["waiting"], 0);
  EXPECT_EQ(json["leaves"]["damaged"], 0);
  std::uint64_t num_in_levels = 0;
  for (const nlohmann::json& level : json["levels"])
    num_in_levels += level["num_leaves"].get<std::uint64_t>();
  EXPECT_EQ(num_in_levels, summary.num_leaves);
  std::uint64_t bytes = 0;
  for (const nlohmann::json& database : json["databases"])
    bytes += database["bytes"].get<std::uint64_t>();
  EXPECT_EQ(json["bytes"], bytes);
  EXPECT_EQ(json["file_bytes"], std::filesystem::file_size(dir_ / "store" / "data.mdb"));
  EXPECT_DOUBLE_EQ(json["bytes_per_cell"], double(bytes) / double(summary.run.counts.num_cells));
  EXPECT_EQ(json["faults"], nlohmann::json::array());
  const auto memory = Store::open(store_, {.read_only = true}).snapshot().memory();
  ASSERT_TRUE(memory);
  EXPECT_EQ(json["memory"]["cap"], memory->cap);
  EXPECT_EQ(json["memory"]["visits"], memory->visits);
  EXPECT_EQ(json["memory"]["peak_resident"], memory->peak_resident);
  const std::string text = run({"inspect"});
  for (const std::string words :
       {"phase            done", "state            finished", "queue            no leaves wait",
        "\nmoves            ", "dihedral angles at least 15°", "size λ           0.06"})
    EXPECT_NE(text.find(words), std::string::npos) << words << " in\n" << text;
}

TEST_F(InspectTest, LeavesAreSortedFilteredAndLimited) {
  finish();
  const nlohmann::json all = inspect({"--leaves"});
  std::vector<std::string> keys;
  for (const nlohmann::json& leaf : all) keys.push_back(leaf["leaf"]);
  EXPECT_TRUE(std::ranges::is_sorted(keys));
  ASSERT_GT(all.size(), 8U);
  auto cells = counts(all, "num_cells");
  std::ranges::sort(cells, std::greater<>());
  EXPECT_EQ(counts(inspect({"--leaves", "--sort", "cells"}), "num_cells"), cells);
  EXPECT_EQ(counts(inspect({"--leaves", "--sort", "cells", "--limit", "3"}), "num_cells"),
            std::vector(cells.begin(), cells.begin() + 3));
  std::ranges::reverse(cells);
  EXPECT_EQ(counts(inspect({"--leaves", "--sort", "cells", "--reverse"}), "num_cells"), cells);

  const nlohmann::json some = inspect({"--leaves", "--where", "cells>0", "--where", "visits=1"});
  const auto matches = [](const nlohmann::json& leaf) {
    return leaf["num_cells"] > 0 && leaf["num_visits"] == 1;
  };
  EXPECT_EQ(some.size(), std::size_t(std::ranges::count_if(all, matches)));
  EXPECT_TRUE(std::ranges::all_of(some, matches));
  const auto moves = counts(all, "num_moves");
  EXPECT_EQ(std::accumulate(moves.begin(), moves.end(), std::uint64_t{0}), inspect()["num_moves"]);
  EXPECT_EQ(counts(inspect({"--leaves", "--sort", "moves", "--limit", "1"}), "num_moves"),
            std::vector{std::ranges::max(moves)});
  EXPECT_EQ(inspect({"--leaves", "--state", "waiting"}), nlohmann::json::array());
  const nlohmann::json clean = inspect({"--leaves", "--state", "clean"});
  EXPECT_EQ(clean.size(), inspect()["leaves"]["clean"]);
  EXPECT_GT(clean.size(), 0U);

  const std::string text = run({"inspect", "--leaves", "--limit", "5"});
  EXPECT_EQ(std::ranges::count(text, '\n'), 6);
  EXPECT_NE(text.find(keys[0]), std::string::npos);
}

TEST_F(InspectTest, LeafInFullByItsKeyOrAPoint) {
  finish();
  const nlohmann::json largest = inspect({"--leaves", "--sort", "cells", "--limit", "1"})[0];
  const std::string key = largest["leaf"];
  const nlohmann::json leaf = inspect({"--leaf", key});
  EXPECT_EQ(leaf["num_cells"], largest["num_cells"]);
  EXPECT_EQ(leaf["cells"].size(), leaf["num_cells"]);
  EXPECT_EQ(leaf["points"].size(), leaf["num_points"]);
  EXPECT_EQ(leaf["num_stale_cells"], 0);
  EXPECT_LT(leaf["quality"]["max_circumradius_over_size"], 1);
  EXPECT_LE(leaf["quality"]["max_radius_edge_ratio"], 2.000001);
  EXPECT_GT(leaf["neighbors"].size(), 6U);
  std::map<std::string, int> kinds;
  for (const nlohmann::json& point : leaf["points"]) {
    ++kinds[point["kind"]];
    for (std::size_t axis = 0; axis < 3; ++axis) {
      EXPECT_GE(point["position"][axis], leaf["box"]["min"][axis]);
      EXPECT_LT(point["position"][axis], leaf["box"]["max"][axis]);
    }
  }
  for (const auto& [kind, num] : kinds) EXPECT_EQ(leaf["points_by_kind"][kind], num);
  EXPECT_EQ(leaf["faults"], nlohmann::json::array());

  const nlohmann::json& p = leaf["points"][0]["position"];
  const std::string spec = p[0].dump() + "," + p[1].dump() + "," + p[2].dump();
  EXPECT_EQ(inspect({"--leaf", spec})["leaf"], key);
  EXPECT_NE(run({"inspect", "--leaf", key, "--limit", "1"}).find(key + ", level"),
            std::string::npos);
}

// Counts of what is implicit, by leaf and in all; the lists are of what is stored one by one.
TEST_F(InspectTest, CountsTheLatticeCore) {
  const RunSummary summary = finish();
  std::uint64_t num_points = 0, num_cells = 0, num_core_cells = 0;
  std::string leaf_with_core;
  for (const nlohmann::json& leaf : inspect({"--leaves"})) {
    num_points +=
        leaf["num_points"].get<std::uint64_t>() + leaf["num_core_points"].get<std::uint64_t>();
    num_cells += leaf["num_cells"].get<std::uint64_t>();
    num_core_cells += leaf["num_core_cells"].get<std::uint64_t>();
    if (leaf["num_core_cells"] > 0) leaf_with_core = leaf["leaf"];
  }
  EXPECT_GT(num_core_cells, 0U);
  EXPECT_EQ(num_points, summary.run.counts.num_points);
  EXPECT_EQ(num_cells + num_core_cells, summary.run.counts.num_cells);
  ASSERT_FALSE(leaf_with_core.empty());
  const nlohmann::json leaf = inspect({"--leaf", leaf_with_core});
  EXPECT_EQ(leaf["faults"], nlohmann::json::array());
  EXPECT_EQ(leaf["num_stale_cells"], 0);
  const std::string line =
      leaf["num_core_points"].dump() + " points, " + leaf["num_core_cells"].dump() + " cells\n";
  EXPECT_NE(run({"inspect", "--leaf", leaf_with_core}).find(line), std::string::npos) << line;
  EXPECT_EQ(inspect({"--check"})["faults"], nlohmann::json::array());
}

TEST_F(InspectTest, SaysWhereALeafIsThatIsNone) {
  finish();
  const auto error_of = [&](const std::string& leaf) {
    const ProcessResult result = run_locvol({"inspect", store_, "--leaf", leaf});
    EXPECT_EQ(result.exit_code, 1);
    return result.err;
  };
  EXPECT_NE(error_of("8000000000000000").find("it has been split"), std::string::npos);
  EXPECT_NE(error_of("0000000000000001").find("it lies in the leaf"), std::string::npos);
  EXPECT_NE(error_of("100,0,0").find("no leaf around (100, 0, 0)"), std::string::npos);
}

TEST_F(InspectTest, WritesBoxesAndCells) {
  const RunSummary summary = finish();
  const std::string boxes = (dir_ / "boxes.vtu").string(), cells = (dir_ / "cells.vtu").string();
  EXPECT_EQ(inspect({"--vtu", boxes})["num_leaves"], summary.num_leaves);
  const VtuArrays tree(boxes);
  EXPECT_EQ(tree.num_cells(), summary.num_leaves);
  std::int64_t num_cells = 0;
  for (const std::int64_t num : tree.array<std::int64_t>("Int64", "cells")) num_cells += num;
  const auto core_cells = tree.array<std::int64_t>("Int64", "core_cells");
  EXPECT_GT(std::ranges::max(core_cells), 0);
  for (const std::int64_t num : core_cells) num_cells += num;
  EXPECT_EQ(static_cast<std::uint64_t>(num_cells), summary.run.counts.num_cells);

  const nlohmann::json largest = inspect({"--leaves", "--sort", "cells", "--limit", "1"})[0];
  const nlohmann::json few =
      inspect({"--vtu", boxes, "--where", "cells>=" + largest["num_cells"].dump()});
  EXPECT_EQ(few["num_leaves"], VtuArrays(boxes).num_cells());
  EXPECT_LT(few["num_leaves"], summary.num_leaves);
  const std::uint64_t num_in_leaf =
      largest["num_cells"].get<std::uint64_t>() + largest["num_core_cells"].get<std::uint64_t>();
  EXPECT_EQ(inspect({"--vtu", cells, "--leaf", largest["leaf"]})["num_cells"], num_in_leaf);
  const VtuArrays leaf(cells);
  EXPECT_EQ(leaf.num_cells(), num_in_leaf);
  for (const double ratio : leaf.array<double>("Float64", "circumradius")) EXPECT_LT(ratio, 1);
}

TEST_F(InspectTest, ReplayRepeatsEachCleanLeaf) {
  finish();
  for (const nlohmann::json& leaf : inspect({"--leaves", "--where", "cells>0"})) {
    const nlohmann::json again = replay(leaf["leaf"]);
    EXPECT_EQ(again["is_clean"], true);
    EXPECT_EQ(again["reproduces"], true);
    EXPECT_EQ(again["num_cells"], leaf["num_cells"]);
    EXPECT_EQ(again["num_inserted"], 0);
    for (const nlohmann::json& step : again["steps"])  // a poor cell is tried again, in vain
      EXPECT_EQ(step["action"], "take in");
  }
}

TEST_F(InspectTest, InterruptedRunShowsWhatWaits) {
  stop_after(3);
  const std::string before = bytes_of(dir_ / "store" / "data.mdb");
  const nlohmann::json summary = inspect();
  EXPECT_EQ(summary["phase"], "refine");
  EXPECT_EQ(summary["writer"], nullptr);
  EXPECT_EQ(summary["num_visits"], 3);
  const nlohmann::json queue = inspect({"--queue"});
  ASSERT_GT(queue.size(), 3U);
  EXPECT_EQ(summary["queue"]["num_waiting"], queue.size());
  EXPECT_EQ(summary["queue"]["front"]["leaf"], queue[0]["leaf"]);
  const auto position = [](const nlohmann::json& entry) {
    const auto color =
        entry["color"].is_null() ? ~std::uint32_t{0} : entry["color"].get<std::uint32_t>();
    return std::tuple(entry["epoch"].get<std::uint32_t>(), color, entry["leaf"].get<std::string>());
  };
  EXPECT_TRUE(std::ranges::is_sorted(queue, {}, position));
  EXPECT_EQ(inspect({"--queue", "--limit", "2"}).size(), 2U);
  EXPECT_EQ(summary["leaves"]["waiting"].get<std::size_t>() +
                summary["leaves"]["unvisited"].get<std::size_t>(),
            queue.size());
  const nlohmann::json unvisited = inspect({"--leaves", "--state", "unvisited"});
  EXPECT_EQ(unvisited.size(), summary["leaves"]["unvisited"]);

  const nlohmann::json leaf = inspect({"--leaf", queue[0]["leaf"]});
  EXPECT_EQ(leaf["queued"]["epoch"], queue[0]["epoch"]);
  const nlohmann::json next = replay(queue[0]["leaf"]);
  EXPECT_EQ(next["is_clean"], false);
  EXPECT_EQ(next["error"], nullptr);
  std::uint64_t num_inserted = 0;
  for (const nlohmann::json& step : next["steps"]) {
    num_inserted += step["action"] == "insert";
    EXPECT_EQ(step["position"].size(), 3U);
  }
  EXPECT_EQ(next["num_inserted"], num_inserted);
  EXPECT_NE(run({"inspect"}).find("interrupted: no process works on it"), std::string::npos);
  EXPECT_TRUE(bytes_of(dir_ / "store" / "data.mdb") == before);
}

// A dumped visit needs no store, and gives the same steps and cells to the last bit.
TEST_F(InspectTest, DumpedVisitIsTheSame) {
  stop_after(2);
  const std::string dump = (dir_ / "visit.json").string(), cells = (dir_ / "cells.vtu").string();
  nlohmann::json visit;
  for (const nlohmann::json& waiting : inspect({"--queue"})) {  // until one inserts
    const std::string leaf = waiting["leaf"];
    visit = nlohmann::json::parse(
        run({"replay", "--leaf", leaf, "--json", "--dump", dump, "--vtu", cells}));
    if (visit["num_inserted"] > 0) break;
  }
  EXPECT_GT(visit["num_inserted"], 0);
  EXPECT_EQ(VtuArrays(cells).num_cells(), visit["num_cells"]);
  std::filesystem::remove_all(store_);
  const std::string again = (dir_ / "again.vtu").string();
  const ProcessResult result = run_locvol({"replay", "--from", dump, "--json", "--vtu", again});
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(nlohmann::json::parse(result.out), visit);
  EXPECT_TRUE(bytes_of(again) == bytes_of(cells));

  std::ofstream(dump) << "{\"format\":\"locvol visit\",\"version\":2}";
  const ProcessResult damaged = run_locvol({"replay", "--from", dump});
  EXPECT_EQ(damaged.exit_code, 1);
  EXPECT_NE(damaged.err.find("visit.json is no visit"), std::string::npos) << damaged.err;
}

TEST_F(InspectTest, DamageIsShownInItsPlace) {
  stop_after(3);
  MortonKey damaged_info, damaged_points;
  QueueEntry damaged_entry;
  LeafInfo info;
  LeafPoints points;
  std::size_t num_leaves = 0;
  {
    const Store store = Store::open(store_, {.read_only = true});
    const Snapshot snapshot = store.snapshot();
    num_leaves = snapshot.leaf_keys().size();
    snapshot.for_each_leaf([&](MortonKey key, const LeafInfo& i) {
      if (i.num_points == 0) return true;
      (damaged_info.is_valid() ? damaged_points : damaged_info) = key;
      return !damaged_points.is_valid();
    });
    info = *snapshot.leaf(damaged_info);
    points = snapshot.points(damaged_points);
    snapshot.for_each_queued([&](const QueueEntry& entry) {
      damaged_entry = entry;
      return entry.leaf == damaged_info || entry.leaf == damaged_points;
    });
  }
  damage_record(store_, info, damaged_info);
  damage_record(store_, points, damaged_points);
  damage_record(store_, damaged_entry, damaged_entry.leaf);
  const auto text = [](MortonKey key) {
    std::string digits(16, '0');
    for (std::size_t i = 0; i < 16; ++i)
      digits[i] = "0123456789abcdef"[key.bits() >> (60 - 4 * i) & 15];
    return digits;
  };

  const nlohmann::json leaves = inspect({"--leaves"}, 1);
  ASSERT_EQ(leaves.size(), num_leaves);
  for (const nlohmann::json& leaf : leaves)
    EXPECT_EQ(leaf["state"] == "damaged", leaf["leaf"] == text(damaged_info)) << leaf;
  const nlohmann::json checked = inspect({"--leaves", "--check", "--state", "damaged"}, 1);
  ASSERT_EQ(checked.size(), 2U);
  EXPECT_EQ(checked[1]["leaf"], text(damaged_points));
  EXPECT_GT(checked[1]["num_points"], 0);  // what can be read is shown
  EXPECT_EQ(checked[1]["faults"][0]["leaf"], text(damaged_points));

  const nlohmann::json queue = inspect({"--queue"}, 1);
  for (const nlohmann::json& entry : queue)
    EXPECT_EQ(entry.contains("faults"), entry["leaf"] == text(damaged_entry.leaf)) << entry;
  const nlohmann::json summary = inspect({}, 1);
  EXPECT_EQ(summary["leaves"]["damaged"], 1);
  EXPECT_EQ(summary["faults"].size(), 1U);
  EXPECT_EQ(summary["num_visits"], 3);
  const nlohmann::json all = inspect({"--check"}, 1);
  EXPECT_EQ(all["leaves"]["damaged"], 2);
  EXPECT_EQ(all["faults"].size(), 3U);
  const nlohmann::json leaf = inspect({"--leaf", text(damaged_points)}, 1);
  EXPECT_EQ(leaf["points"], nlohmann::json::array());
  EXPECT_GT(leaf["num_triangles"].get<int>() + leaf["neighbors"].size(), 0U);
  EXPECT_NE(run({"inspect", "--leaves"}, 1).find("damaged record in database `leaves`"),
            std::string::npos);
  const ProcessResult replayed = run_locvol({"replay", store_, "--leaf", text(damaged_points)});
  EXPECT_EQ(replayed.exit_code, 1);
  EXPECT_NE(replayed.err.find("damaged record"), std::string::npos) << replayed.err;
}

TEST_F(InspectTest, CheckMissesQueueEntries) {
  stop_after(3);
  EXPECT_EQ(inspect({"--check"})["faults"], nlohmann::json::array());
  {
    Store store = Store::open(store_);
    const QueueEntry front = store.snapshot().queue_keys({}, 1).at(0);
    Batch batch = store.begin();
    batch.erase_queue_entry(front);
    batch.commit();
  }
  const nlohmann::json faults = inspect({"--check"}, 1)["faults"];
  ASSERT_EQ(faults.size(), 1U);
  EXPECT_NE(faults[0]["message"].get<std::string>().find("the queue has"), std::string::npos);
}

TEST_F(InspectTest, DamagedRunRecordLeavesTheLists) {
  finish();
  RunRecord run_record;
  std::size_t num_leaves = 0;
  {
    const Store store = Store::open(store_, {.read_only = true});
    run_record = *store.snapshot().run();
    num_leaves = store.snapshot().leaf_keys().size();
  }
  damage_record(store_, run_record, MortonKey());
  const nlohmann::json summary = inspect({}, 1);
  EXPECT_EQ(summary["leaves"]["num_leaves"], num_leaves);
  EXPECT_EQ(summary["faults"][0]["leaf"], nullptr);
  EXPECT_EQ(inspect({"--leaves"}, 1).size(), num_leaves);
}

TEST_F(InspectTest, OptionsThatDoNotGoTogetherAreRefused) {
  for (const Names& options :
       {Names{"--sort", "cells"}, Names{"--queue", "--where", "cells>1"},
        Names{"--leaves", "--where", "cells"}, Names{"--queue", "--vtu", "a.vtu"},
        Names{"--leaves", "--sort", "frob"}, Names{"--leaf", "1,2"},
        Names{"--leaves", "--limit", "0"}, Names{"--vtu", "a.vtk"}}) {
    Names arguments = {"inspect", store_};
    arguments.insert(arguments.end(), options.begin(), options.end());
    EXPECT_EQ(run_locvol(arguments).exit_code, 2) << options[0] << ' ' << options[1];
  }
  EXPECT_EQ(run_locvol({"replay", store_}).exit_code, 2);
  EXPECT_EQ(run_locvol({"replay"}).exit_code, 2);
  EXPECT_EQ(run_locvol({"replay", store_, "--from", "visit.json"}).exit_code, 2);
}

// Looks into a run all the time while it goes on: nothing fails, each list of leaves covers the
// octree, and the run gives what it gives undisturbed.
TEST_F(InspectTest, LiveRunIsShownAndLeftAlone) {
  const auto arguments = [&](const std::string& name) {
    return Names{"mesh",
                 (dir_ / "cube.off").string(),
                 "-o",
                 (dir_ / (name + ".vtu")).string(),
                 "-s",
                 "2%",
                 "--leaf-capacity",
                 "700",
                 "--store",
                 (dir_ / name).string()};
  };
  Process process(arguments("store"));
  for (int i = 0; i < 6000 && !process.has_ended(); ++i) {
    if (process.err().find(" refine: ") != std::string::npos) break;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  std::uint64_t last_visits = 0;
  int num_live = 0, num_replayed = 0;
  while (!process.has_ended()) {
    process.send(SIGSTOP);  // or the leaf might be split before it is replayed
    const nlohmann::json queue = inspect({"--queue", "--limit", "1"});
    if (!queue.empty()) {
      ++num_replayed;
      const std::string leaf = queue[0]["leaf"];
      EXPECT_EQ(nlohmann::json::parse(run({"replay", "--leaf", leaf, "--json"}))["error"], nullptr);
    }
    process.send(SIGCONT);
    const nlohmann::json summary = inspect();
    const bool is_live = summary["writer"] == std::to_string(process.id());
    if (!is_live) break;
    ++num_live;
    const std::uint64_t visits = summary["num_visits"];
    EXPECT_GE(visits, last_visits);
    last_visits = visits;
    double covered = 0;
    for (const nlohmann::json& leaf : inspect({"--leaves"}))
      covered += std::pow(8.0, -leaf["level"].get<int>());
    EXPECT_EQ(covered, 1);
    inspect({"--vtu", (dir_ / "boxes.vtu").string()});
  }
  EXPECT_GT(num_live, 0);
  EXPECT_GT(num_replayed, 0);
  const ProcessResult ended = process.wait();
  EXPECT_EQ(ended.exit_code, 0) << ended.err;
  EXPECT_EQ(run_locvol(arguments("undisturbed")).exit_code, 0);
  EXPECT_TRUE(bytes_of(dir_ / "store.vtu") == bytes_of(dir_ / "undisturbed.vtu"));
}

}  // namespace
}  // namespace locvol
