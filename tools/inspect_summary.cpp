#include "tools/inspect_summary.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <map>
#include <system_error>
#include <utility>

#include "engine/inspect/leaf_scan.h"
#include "engine/inspect/mesh_statistics.h"
#include "engine/shared/memory_budget.h"
#include "tools/arguments.h"
#include "tools/results.h"
#include "tools/stored_run.h"

namespace locvol {
namespace {

constexpr std::size_t kMaxListedSites = 10;
constexpr std::array kStates = {LeafState::kClean, LeafState::kWaiting, LeafState::kUnvisited,
                                LeafState::kCore,  LeafState::kEmpty,   LeafState::kDamaged};

struct LevelCounts {
  std::map<LeafState, std::uint64_t> by_state;
  std::uint64_t num_leaves = 0, num_with_unresolved = 0;

  std::uint64_t in(LeafState state) const {
    const auto count = by_state.find(state);
    return count == by_state.end() ? 0 : count->second;
  }
  void add(const LeafRow& row) {
    ++num_leaves;
    ++by_state[row.state()];
    if (row.info && row.info->num_unresolved > 0) ++num_with_unresolved;
  }
};

struct Summary {
  std::optional<RunSummary> run;       // absent if its record is damaged
  std::optional<std::string> writer;   // the process that works on the run
  std::optional<MemoryRecord> memory;  // of that process, or of the last one
  bool has_gone_on = false;            // while it was read
  std::map<int, LevelCounts> levels;
  LevelCounts all;
  std::uint64_t max_visits_of_a_leaf = 0;
  std::map<std::uint32_t, std::uint64_t> num_waiting;  // by epoch
  std::optional<QueueEntry> front;
  std::array<std::uint64_t, kNumSiteConditions> num_unresolved{};  // by condition
  std::vector<LeafSite> first_sites;
  std::vector<LeafPoorCell> first_poor_cells;  // of a finished run
  std::vector<DatabaseSize> databases;
  std::uint64_t file_bytes = 0;
  std::optional<MeshStatistics> statistics;  // of a finished run
  std::vector<Fault> faults;

  std::uint64_t bytes() const {
    std::uint64_t sum = 0;
    for (const DatabaseSize& database : databases) sum += database.bytes;
    return sum;
  }
  std::optional<double> bytes_per_cell() const {
    if (!run || run->run.counts.num_cells == 0) return std::nullopt;
    return static_cast<double>(bytes()) / static_cast<double>(run->run.counts.num_cells);
  }
};

void count_leaf(const LeafRow& row, Summary& summary) {
  summary.levels[row.key.level()].add(row);
  summary.all.add(row);
  summary.faults.insert(summary.faults.end(), row.faults.begin(), row.faults.end());
  for (const UnresolvedSite& site : row.unresolved.sites) {
    const auto condition = static_cast<std::size_t>(site.condition - 1);
    if (condition < summary.num_unresolved.size()) ++summary.num_unresolved[condition];
    if (summary.first_sites.size() < kMaxListedSites)
      summary.first_sites.push_back({row.key, site});
  }
  if (!row.info) return;
  summary.max_visits_of_a_leaf =
      std::max<std::uint64_t>(summary.max_visits_of_a_leaf, row.info->num_visits);
  if (row.info->queued) ++summary.num_waiting[row.info->queued->epoch];
}

RunSummary totals_of(const RunRecord& run, const Summary& summary) {
  return {.run = run,
          .num_leaves = summary.all.num_leaves,
          .max_visits_of_a_leaf = summary.max_visits_of_a_leaf};
}

// Reads the queue's records, too, and compares it with what the leaves say.
void check_queue(const Store& store, Summary& summary) {
  std::uint64_t num_entries = 0, num_waiting = 0;
  const auto take = [&](const QueueRow& row) {
    ++num_entries;
    summary.faults.insert(summary.faults.end(), row.faults.begin(), row.faults.end());
    return true;
  };
  scan_queue(store, take, summary.faults);
  for (const auto& [epoch, num] : summary.num_waiting) num_waiting += num;
  const bool is_comparable = !summary.writer && !store.writer() && summary.faults.empty();
  if (is_comparable && num_entries != num_waiting) {
    summary.faults.push_back({MortonKey(), fmt::format("{} leaves wait, but the queue has {} "
                                                       "entries",
                                                       num_waiting, num_entries)});
  }
}

std::uint64_t data_file_bytes(const Store& store) {
  std::error_code unknown;
  const std::uintmax_t bytes = std::filesystem::file_size(store.directory() / "data.mdb", unknown);
  return unknown ? 0 : bytes;
}

void measure(const Store& store, Summary& summary) {
  const int num_threads = num_streaming_threads(0, free_memory() / 2);
  summary.statistics =
      read_around(summary.faults, [&] { return mesh_statistics(store, num_threads); });
  if (!summary.statistics || summary.statistics->num_poor_cells == 0) return;
  summary.first_poor_cells = first_poor_cells(store, kMaxListedSites, num_threads);
}

Summary summary_of(const Store& store, bool reads_all) {
  Summary summary;
  summary.writer = store.writer();
  const auto run = read_around(summary.faults, [&] { return run_of(store); });
  const auto memory = read_around(summary.faults, [&] { return store.snapshot().memory(); });
  if (memory) summary.memory = *memory;
  const auto count = [&](const LeafRow& row) {
    count_leaf(row, summary);
    return true;
  };
  scan_leaves(store, count, summary.faults, {.reads_unresolved = true, .reads_all = reads_all});
  const auto front =
      read_around(summary.faults, [&] { return store.snapshot().queue_keys({}, 1); });
  if (front && !front->empty()) summary.front = front->front();
  summary.databases = store.sizes();
  summary.file_bytes = data_file_bytes(store);
  if (run) {
    const RunRecord now = run_of(store);  // the newer one, should the run go on
    summary.run = totals_of(now, summary);
    summary.has_gone_on = now != *run;
  }
  if (reads_all) check_queue(store, summary);
  if (summary.run && summary.run->run.phase == Phase::kDone && summary.faults.empty())
    measure(store, summary);
  return summary;
}

Json to_json(const LevelCounts& counts) {
  Json json = {{"num_leaves", counts.num_leaves}};
  for (const LeafState state : kStates) json[std::string(state_name(state))] = counts.in(state);
  json["unresolved"] = counts.num_with_unresolved;
  return json;
}

Json queue_json(const Summary& summary) {
  Json json = {{"num_waiting", 0}, {"front", nullptr}, {"epochs", Json::array()}};
  std::uint64_t num_waiting = 0;
  for (const auto& [epoch, num] : summary.num_waiting) {
    num_waiting += num;
    json["epochs"].push_back({{"epoch", epoch}, {"num_waiting", num}});
  }
  json["num_waiting"] = num_waiting;
  if (!summary.front) return json;
  json["front"] = to_json(summary.front->position);
  json["front"]["leaf"] = key_text(summary.front->leaf);
  return json;
}

Json to_json(const MemoryRecord& memory) {
  return {{"cap", memory.cap},
          {"program", memory.program},
          {"leaves", memory.leaves},
          {"commits", memory.commits},
          {"visits", memory.visits},
          {"cache", memory.cache},
          {"peak_resident", memory.peak_resident}};
}

Json to_json(const Summary& summary) {
  Json json;
  if (summary.run) json = to_json(*summary.run);
  if (summary.run) json["epoch"] = summary.run->run.epoch;
  json["writer"] = nullptr;
  if (summary.writer) json["writer"] = *summary.writer;
  json["memory"] = nullptr;
  if (summary.memory) json["memory"] = to_json(*summary.memory);
  json["has_gone_on"] = summary.has_gone_on;
  json["queue"] = queue_json(summary);
  json["leaves"] = to_json(summary.all);
  json["levels"] = Json::array();
  for (const auto& [level, counts] : summary.levels) {
    Json entry = {{"level", level}};
    entry.update(to_json(counts));
    json["levels"].push_back(std::move(entry));
  }
  json["unresolved"] = insertions_json(summary.num_unresolved);
  json["bytes"] = summary.bytes();
  json["file_bytes"] = summary.file_bytes;
  if (const auto bytes = summary.bytes_per_cell()) json["bytes_per_cell"] = *bytes;
  json["databases"] = Json::array();
  for (const auto& database : summary.databases) json["databases"].push_back(to_json(database));
  if (summary.statistics) json["statistics"] = to_json(*summary.statistics, summary.run->run);
  json["faults"] = to_json(summary.faults);
  return json;
}

std::string worker_text(const Summary& summary) {
  if (summary.writer) return fmt::format("process {} works on it", *summary.writer);
  return summary.run->run.phase == Phase::kDone ? "finished"
                                                : "interrupted: no process works on it";
}

std::string queue_text(const Summary& summary) {
  std::string text;
  for (const auto& [epoch, num] : summary.num_waiting)
    text += fmt::format("{}{} for epoch {}", text.empty() ? "" : ", ", num, epoch);
  if (text.empty()) return "no leaves wait";
  if (summary.front)
    text += fmt::format("; next: {}, leaf {}", position_text(summary.front->position),
                        key_text(summary.front->leaf));
  return text;
}

void print_levels(const Summary& summary) {
  fmt::print("\n{:>7}", "level");
  for (const LeafState state : kStates) fmt::print(" {:>10}", state_name(state));
  fmt::print(" {:>10} {:>10}\n", "leaves", "unresolved");
  const auto print_row = [](const std::string& name, const LevelCounts& counts) {
    fmt::print("{:>7}", name);
    for (const LeafState state : kStates) fmt::print(" {:>10}", counts.in(state));
    fmt::print(" {:>10} {:>10}\n", counts.num_leaves, counts.num_with_unresolved);
  };
  for (const auto& [level, counts] : summary.levels) print_row(fmt::to_string(level), counts);
  print_row("all", summary.all);
}

// What the cap was shared out to, and what the process took of it; in the unit of --memory.
void print_memory(const MemoryRecord& memory) {
  fmt::print("\n{:<12} {:>12}\n", "memory", "planned");
  const auto print_row = [&](std::string_view name, std::uint64_t bytes) {
    fmt::print("{:<12} {:>12}", name, in_mebibytes(bytes));
  };
  for (const auto& [name, bytes] : {std::pair("program", memory.program),
                                    {"leaves", memory.leaves},
                                    {"commits", memory.commits},
                                    {"a visit", memory.visits},
                                    {"cache", memory.cache}}) {
    print_row(name, bytes);
    fmt::print("\n");
  }
  print_row("cap", memory.cap);
  fmt::print("; the process has taken {}\n", in_mebibytes(memory.peak_resident));
}

void print_databases(const Summary& summary) {
  fmt::print("\n{:<12} {:>12} {:>12}\n", "database", "on disk", "entries");
  for (const DatabaseSize& database : summary.databases) {
    fmt::print("{:<12} {:>12} {:>12}\n", database.name, bytes_text(database.bytes),
               database.num_entries);
  }
  fmt::print("{:<12} {:>12}", "all", bytes_text(summary.bytes()));
  if (const auto bytes = summary.bytes_per_cell()) fmt::print(", {:.1f} bytes per cell", *bytes);
  fmt::print("; the file takes {}\n", bytes_text(summary.file_bytes));
}

void print_sites(const Summary& summary) {
  if (summary.first_sites.empty()) return;
  fmt::print("\nunresolved sites: {}\n", insertions_text(summary.num_unresolved));
  for (const LeafSite& site : summary.first_sites) fmt::print("  {}\n", site_text(site));
  std::uint64_t num_more = 0;
  for (const std::uint64_t num : summary.num_unresolved) num_more += num;
  num_more -= std::min<std::uint64_t>(num_more, summary.first_sites.size());
  if (num_more > 0) fmt::print("  and {} more: --unresolved lists all\n", num_more);
}

void print_poor_cells(const Summary& summary) {
  if (summary.first_poor_cells.empty()) return;
  fmt::print("\npoor cells:\n");
  for (const LeafPoorCell& cell : summary.first_poor_cells)
    fmt::print("  {}\n", poor_cell_text(cell));
  const std::uint64_t num = summary.statistics->num_poor_cells;
  const std::uint64_t num_more =
      num - std::min<std::uint64_t>(num, summary.first_poor_cells.size());
  if (num_more > 0) fmt::print("  and {} more: --unresolved lists all\n", num_more);
}

void print(const Summary& summary) {
  if (summary.run) {
    const RunRecord& run = summary.run->run;
    fmt::print("{}{}{}", facts_text(run.surface), parameters_text(run.parameters),
               summary_text(*summary.run));
    fmt::print("{}{}", line_text("state", worker_text(summary)),
               line_text("epoch", fmt::to_string(run.epoch)));
  }
  fmt::print("{}", line_text("queue", queue_text(summary)));
  if (summary.has_gone_on) {
    fmt::print("{}", line_text("note",
                               "the run went on while this was read: counts by leaf and "
                               "totals differ by some commits"));
  }
  print_levels(summary);
  if (summary.memory) print_memory(*summary.memory);
  print_databases(summary);
  if (summary.statistics)
    fmt::print("\n{}", statistics_text(*summary.statistics, summary.run->run));
  print_sites(summary);
  print_poor_cells(summary);
  if (!summary.faults.empty()) fmt::print("\n");
  for (const Fault& fault : summary.faults) fmt::print("{}\n", fault_text(fault));
}

}  // namespace

std::uint64_t inspect_summary(const Store& store, bool reads_all, bool is_json) {
  const Summary summary = summary_of(store, reads_all);
  if (is_json)
    print_json(to_json(summary));
  else
    print(summary);
  return summary.faults.size();
}

}  // namespace locvol
