#include "tools/inspect_summary.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <map>
#include <system_error>
#include <tuple>
#include <utility>

#include "engine/exchange/pack.h"
#include "engine/inspect/crease_table.h"
#include "engine/inspect/mesh_statistics.h"
#include "engine/output/stored_mesh.h"
#include "engine/ranks/counts_of_ranks.h"
#include "engine/ranks/rank_store.h"
#include "engine/shared/memory_budget.h"
#include "storage/codec.h"
#include "tools/arguments.h"
#include "tools/leaf_filter.h"
#include "tools/leaf_site_fields.h"
#include "tools/results.h"
#include "tools/stored_run.h"

namespace locvol {

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
  void add(const LevelCounts& more) {
    num_leaves += more.num_leaves;
    num_with_unresolved += more.num_with_unresolved;
    for (const auto& [state, num] : more.by_state) by_state[state] += num;
  }
};

struct RanksSummary {
  std::uint64_t num_ranks = 0, num_working = 0;  // the latter: in whose stores a process works
  std::uint64_t least_superstep = ~std::uint64_t{0}, largest_superstep = 0;
};

// Of what one rank has, or of all.
struct InspectSummary {
  std::optional<RunRecord> run;  // absent if its record is damaged
  SurfaceSheets sheets;
  std::optional<MemoryRecord> memory;  // of the process that works on it, or of the last one
  std::optional<std::string> writer;   // that process
  RanksSummary ranks;
  bool has_gone_on = false;  // while it was read
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
  std::optional<CreaseTable> creases;        // likewise, if it keeps some
  std::vector<Fault> faults;

  std::uint64_t bytes() const {
    std::uint64_t sum = 0;
    for (const DatabaseSize& database : databases) sum += database.bytes;
    return sum;
  }
  std::optional<double> bytes_per_cell() const {
    if (!run || run->counts.num_cells == 0) return std::nullopt;
    return static_cast<double>(bytes()) / static_cast<double>(run->counts.num_cells);
  }
  RunSummary totals() const {
    return {.run = *run,
            .sheets = sheets,
            .num_leaves = all.num_leaves,
            .max_visits_of_a_leaf = max_visits_of_a_leaf};
  }
};

auto fields(Maybe<LevelCounts> auto& counts) {
  auto& [by_state, num_leaves, num_with_unresolved] = counts;
  return std::tuple(Field("by_state", by_state), Field("num_leaves", num_leaves),
                    Field("num_with_unresolved", num_with_unresolved));
}
auto fields(Maybe<RanksSummary> auto& ranks) {
  auto& [num_ranks, num_working, least_superstep, largest_superstep] = ranks;
  return std::tuple(Field("num_ranks", num_ranks), Field("num_working", num_working),
                    Field("least_superstep", least_superstep),
                    Field("largest_superstep", largest_superstep));
}
auto fields(Maybe<DatabaseSize> auto& size) {
  auto& [name, bytes, num_entries] = size;
  return std::tuple(Field("name", name), Field("bytes", bytes), Field("num_entries", num_entries));
}
// But for records of the store, and for what is found by all ranks together.
auto fields(Maybe<InspectSummary> auto& s) {
  return std::tuple(Field("writer", s.writer), Field("ranks", s.ranks),
                    Field("has_gone_on", s.has_gone_on), Field("levels", s.levels),
                    Field("all", s.all), Field("max_visits_of_a_leaf", s.max_visits_of_a_leaf),
                    Field("num_waiting", s.num_waiting), Field("front", s.front),
                    Field("num_unresolved", s.num_unresolved), Field("first_sites", s.first_sites),
                    Field("databases", s.databases), Field("file_bytes", s.file_bytes),
                    Field("faults", s.faults));
}

namespace {

constexpr std::size_t kMaxFirstSites = 10;
constexpr std::array kStates = {LeafState::kClean, LeafState::kWaiting, LeafState::kUnvisited,
                                LeafState::kCore,  LeafState::kEmpty,   LeafState::kDamaged};

void count_leaf(const LeafRow& row, InspectSummary& summary) {
  summary.levels[row.key.level()].add(row);
  summary.all.add(row);
  summary.faults.insert(summary.faults.end(), row.faults.begin(), row.faults.end());
  for (const UnresolvedSite& site : row.unresolved.sites) {
    const auto condition = static_cast<std::size_t>(site.condition - 1);
    if (condition < summary.num_unresolved.size()) ++summary.num_unresolved[condition];
    if (summary.first_sites.size() < kMaxFirstSites) summary.first_sites.push_back({row.key, site});
  }
  if (!row.info) return;
  summary.max_visits_of_a_leaf =
      std::max<std::uint64_t>(summary.max_visits_of_a_leaf, row.info->num_visits);
  if (row.info->queued) ++summary.num_waiting[row.info->queued->epoch];
}

// Reads the queue's records, too, and compares it with what the leaves say.
void check_queue(const RunPart& part, InspectSummary& summary) {
  std::uint64_t num_entries = 0, num_waiting = 0;
  const auto take = [&](const QueueRow& row) {
    ++num_entries;
    summary.faults.insert(summary.faults.end(), row.faults.begin(), row.faults.end());
    return true;
  };
  scan_queue(part, take, summary.faults);
  for (const auto& [epoch, num] : summary.num_waiting) num_waiting += num;
  const bool is_comparable = !summary.writer && !part.store->writer() && summary.faults.empty();
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

// The first of the part's leaves in the queue, whatever its record is like.
std::optional<QueueEntry> front_of(const RunPart& part) {
  std::optional<QueueEntry> front;
  const auto take = [&](const QueueRow& row) {
    front = row.entry;
    return false;
  };
  std::vector<Fault> ignored;
  scan_queue(part, take, ignored);
  return front;
}

void note_superstep(const Reader& reader, InspectSummary& summary) {
  const auto rank = read_around(summary.faults, [&] { return reader.rank(); });
  if (rank && *rank)
    summary.ranks.least_superstep = summary.ranks.largest_superstep = (*rank)->superstep;
}

InspectSummary own_summary(const RunPart& part, bool reads_all) {
  InspectSummary summary;
  summary.ranks.num_ranks = 1;
  if (!part.store) return summary;
  const Store& store = *part.store;
  summary.writer = store.writer();
  summary.ranks.num_working = summary.writer ? 1 : 0;
  const auto run = read_around(summary.faults, [&] { return run_of(store); });
  const auto memory = read_around(summary.faults, [&] { return store.snapshot().memory(); });
  if (memory) summary.memory = *memory;
  const auto sheets = read_around(summary.faults, [&] { return store.snapshot().sheets(); });
  if (sheets) summary.sheets = *sheets;
  const auto count = [&](const LeafRow& row) {
    count_leaf(row, summary);
    return true;
  };
  scan_leaves(part, count, summary.faults, {.reads_unresolved = true, .reads_all = reads_all});
  if (reads_all) check_queue(part, summary);
  summary.front = front_of(part);
  summary.databases = store.sizes();
  summary.file_bytes = data_file_bytes(store);
  const Snapshot snapshot = store.snapshot();
  if (run) {
    summary.run = run_of(snapshot, store.directory());  // the newer one, should the run go on
    summary.has_gone_on = *summary.run != *run;
  }
  if (part.is_of_ranks()) note_superstep(snapshot, summary);
  return summary;
}

// What all have reached, and all that they have made.
void add(const RunRecord& more, std::optional<RunRecord>& all) {
  if (!all) {
    all = more;
    return;
  }
  all->counts = sum_of(all->counts, more.counts);
  all->phase = std::min(all->phase, more.phase);
  all->epoch = std::min(all->epoch, more.epoch);
}

// The most of any process.
void add(const MemoryRecord& more, std::optional<MemoryRecord>& all) {
  if (!all) all.emplace();
  for (const auto bytes :
       {&MemoryRecord::cap, &MemoryRecord::program, &MemoryRecord::leaves, &MemoryRecord::commits,
        &MemoryRecord::visits, &MemoryRecord::cache, &MemoryRecord::peak_resident})
    (*all).*bytes = std::max((*all).*bytes, more.*bytes);
}

void add(const RanksSummary& more, RanksSummary& all) {
  all.num_ranks += more.num_ranks;
  all.num_working += more.num_working;
  all.least_superstep = std::min(all.least_superstep, more.least_superstep);
  all.largest_superstep = std::max(all.largest_superstep, more.largest_superstep);
}

void add(const std::vector<DatabaseSize>& more, std::vector<DatabaseSize>& all) {
  if (all.empty()) all.resize(more.size());
  for (std::size_t i = 0; i < more.size(); ++i)
    all[i] = {more[i].name, all[i].bytes + more[i].bytes, all[i].num_entries + more[i].num_entries};
}

// Of the next rank.
void add(const InspectSummary& more, InspectSummary& all) {
  if (more.run) add(*more.run, all.run);
  if (more.memory) add(*more.memory, all.memory);
  if (!all.writer) all.writer = more.writer;
  if (all.sheets == SurfaceSheets()) all.sheets = more.sheets;
  add(more.ranks, all.ranks);
  all.has_gone_on = all.has_gone_on || more.has_gone_on;
  for (const auto& [level, counts] : more.levels) all.levels[level].add(counts);
  all.all.add(more.all);
  all.max_visits_of_a_leaf = std::max(all.max_visits_of_a_leaf, more.max_visits_of_a_leaf);
  for (const auto& [epoch, num] : more.num_waiting) all.num_waiting[epoch] += num;
  if (more.front && (!all.front || *more.front < *all.front)) all.front = more.front;
  for (std::size_t i = 0; i < all.num_unresolved.size(); ++i)
    all.num_unresolved[i] += more.num_unresolved[i];
  all.first_sites.insert(all.first_sites.end(), more.first_sites.begin(), more.first_sites.end());
  if (all.first_sites.size() > kMaxFirstSites) all.first_sites.resize(kMaxFirstSites);
  add(more.databases, all.databases);
  all.file_bytes += more.file_bytes;
  all.faults.insert(all.faults.end(), more.faults.begin(), more.faults.end());
}

// The same on all ranks.
InspectSummary together(const RunPart& part, InspectSummary own) {
  own.faults = named(part, std::move(own.faults));
  std::vector<InspectSummary> of_ranks = gather_values(part.exchange, own);
  const std::vector<std::string> runs = part.exchange.gather(own.run ? encode(*own.run, MortonKey())
                                                                     : std::string()),
                                 memories = part.exchange.gather(
                                     own.memory ? encode(*own.memory, MortonKey()) : std::string()),
                                 sheets = part.exchange.gather(encode(own.sheets, MortonKey()));
  InspectSummary all;
  for (std::size_t rank = 0; rank < of_ranks.size(); ++rank) {
    InspectSummary& summary = of_ranks[rank];
    if (!runs[rank].empty()) summary.run = decode<RunRecord>(runs[rank], MortonKey());
    summary.sheets = decode<SurfaceSheets>(sheets[rank], MortonKey());
    if (!memories[rank].empty()) summary.memory = decode<MemoryRecord>(memories[rank], MortonKey());
    add(summary, all);
  }
  return all;
}

// Nothing, if a record that it takes is damaged; then faults are of this rank.
std::optional<MeshStatistics> measured(const RunPart& part, int num_threads,
                                       std::optional<CreaseTable>& creases,
                                       std::vector<Fault>& faults) {
  Exchange& exchange = part.is_of_ranks() ? part.exchange : alone();
  try {
    std::optional<MeshStatistics> statistics;  // of cells
    if (!run_of(*part.store).parameters.is_surface_only)
      statistics = mesh_statistics(*part.store, num_threads, {}, nullptr, exchange);
    if (keeps_creases(run_of(*part.store))) creases = crease_table(*part.store, nullptr, exchange);
    return statistics;
  } catch (const CorruptRecord& e) {
    faults.push_back({e.leaf(), e.what()});
  } catch (const ExchangeError&) {  // so it is on another rank
  }
  return std::nullopt;
}

// Called by all ranks. Returns how many damaged records this one met.
std::uint64_t measure(const RunPart& part, InspectSummary& all) {
  const auto num_here = static_cast<std::uint64_t>(num_ranks_here(part.exchange));
  const int num_threads = num_streaming_threads(0, free_memory() / 2 / num_here);
  std::vector<Fault> faults;
  all.statistics = measured(part, num_threads, all.creases, faults);
  all.faults = gather_named(part, faults);
  if (!all.statistics || all.statistics->num_poor_cells == 0) return faults.size();
  all.first_poor_cells = first_poor_cells(*part.store, kMaxFirstSites, num_threads, part.exchange);
  return faults.size();
}

Json to_json(const LevelCounts& counts) {
  Json json = {{"num_leaves", counts.num_leaves}};
  for (const LeafState state : kLeafStates) json[std::string(state_name(state))] = counts.in(state);
  json["unresolved"] = counts.num_with_unresolved;
  return json;
}

Json queue_json(const InspectSummary& summary) {
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

Json to_json(const RanksSummary& ranks) {
  return {{"num_ranks", ranks.num_ranks},
          {"num_working", ranks.num_working},
          {"least_superstep", ranks.least_superstep},
          {"largest_superstep", ranks.largest_superstep}};
}

Json to_json(const InspectSummary& summary) {
  Json json;
  if (summary.run) json = to_json(summary.totals());
  if (summary.creases) add_kept_creases(summary.sheets, *summary.creases, json);
  if (summary.run) json["epoch"] = summary.run->epoch;
  json["writer"] = nullptr;
  if (summary.writer) json["writer"] = *summary.writer;
  if (summary.ranks.num_ranks > 1) json["ranks"] = to_json(summary.ranks);
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
  if (summary.statistics) json["statistics"] = to_json(*summary.statistics, *summary.run);
  json["faults"] = to_json(summary.faults);
  return json;
}

std::string worker_text(const InspectSummary& summary) {
  const RanksSummary& ranks = summary.ranks;
  if (summary.writer && ranks.num_ranks > 1)
    return fmt::format("{} of {} processes work on it", ranks.num_working, ranks.num_ranks);
  if (summary.writer) return fmt::format("process {} works on it", *summary.writer);
  return summary.run->phase == Phase::kDone ? "finished" : "interrupted: no process works on it";
}

std::string queue_text(const InspectSummary& summary) {
  std::string text;
  for (const auto& [epoch, num] : summary.num_waiting)
    text += fmt::format("{}{} for epoch {}", text.empty() ? "" : ", ", num, epoch);
  if (text.empty()) return "no leaves wait";
  if (summary.front)
    text += fmt::format("; next: {}, leaf {}", position_text(summary.front->position),
                        key_text(summary.front->leaf));
  return text;
}

void print_levels(const InspectSummary& summary) {
  fmt::print("\n{:>7}", "level");
  for (const LeafState state : kLeafStates) fmt::print(" {:>10}", state_name(state));
  fmt::print(" {:>10} {:>10}\n", "leaves", "unresolved");
  const auto print_row = [](const std::string& name, const LevelCounts& counts) {
    fmt::print("{:>7}", name);
    for (const LeafState state : kLeafStates) fmt::print(" {:>10}", counts.in(state));
    fmt::print(" {:>10} {:>10}\n", counts.num_leaves, counts.num_with_unresolved);
  };
  for (const auto& [level, counts] : summary.levels) print_row(fmt::to_string(level), counts);
  print_row("all", summary.all);
}

// What the cap was shared out to, and what the process took of it; in the unit of --memory.
void print_memory(const MemoryRecord& memory, std::uint64_t num_ranks) {
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
  fmt::print("; {} {}\n",
             num_ranks == 1 ? "the process has taken" : "no process has taken more than",
             in_mebibytes(memory.peak_resident));
}

void print_databases(const InspectSummary& summary) {
  fmt::print("\n{:<12} {:>12} {:>12}\n", "database", "on disk", "entries");
  for (const DatabaseSize& database : summary.databases) {
    fmt::print("{:<12} {:>12} {:>12}\n", database.name, bytes_text(database.bytes),
               database.num_entries);
  }
  fmt::print("{:<12} {:>12}", "all", bytes_text(summary.bytes()));
  if (const auto bytes = summary.bytes_per_cell()) fmt::print(", {:.1f} bytes per cell", *bytes);
  fmt::print("; the file takes {}\n", bytes_text(summary.file_bytes));
}

void print_sites(const InspectSummary& summary) {
  if (summary.first_sites.empty()) return;
  fmt::print("\nunresolved sites: {}\n", insertions_text(summary.num_unresolved));
  for (const LeafSite& site : summary.first_sites) fmt::print("  {}\n", site_text(site));
  std::uint64_t num_more = 0;
  for (const std::uint64_t num : summary.num_unresolved) num_more += num;
  num_more -= std::min<std::uint64_t>(num_more, summary.first_sites.size());
  if (num_more > 0) fmt::print("  and {} more: --unresolved lists all\n", num_more);
}

void print_poor_cells(const InspectSummary& summary) {
  if (summary.first_poor_cells.empty()) return;
  fmt::print("\npoor cells:\n");
  for (const LeafPoorCell& cell : summary.first_poor_cells)
    fmt::print("  {}\n", poor_cell_text(cell));
  const std::uint64_t num = summary.statistics->num_poor_cells;
  const std::uint64_t num_more =
      num - std::min<std::uint64_t>(num, summary.first_poor_cells.size());
  if (num_more > 0) fmt::print("  and {} more: --unresolved lists all\n", num_more);
}

void print(const InspectSummary& summary) {
  if (summary.run) {
    const RunRecord& run = *summary.run;
    fmt::print("{}{}{}", facts_text(run.surface), parameters_text(run.parameters),
               summary_text(summary.totals(), summary.creases ? &*summary.creases : nullptr));
    fmt::print("{}{}", line_text("state", worker_text(summary)),
               line_text("epoch", fmt::to_string(run.epoch)));
  }
  fmt::print("{}", line_text("queue", queue_text(summary)));
  if (summary.has_gone_on) {
    fmt::print("{}", line_text("note",
                               "the run went on while this was read: counts by leaf and "
                               "totals differ by some commits"));
  }
  const RanksSummary& ranks = summary.ranks;
  if (ranks.least_superstep < ranks.largest_superstep) {
    fmt::print("{}",
               line_text("note", fmt::format("ranks were seen at supersteps {} to {}: what "
                                             "they count is not of one moment",
                                             ranks.least_superstep, ranks.largest_superstep)));
  }
  print_levels(summary);
  if (summary.memory) print_memory(*summary.memory, ranks.num_ranks);
  print_databases(summary);
  if (summary.statistics)
    fmt::print("\n{}{}", body_statistics_text(summary.totals().sheets, *summary.statistics),
               statistics_text(*summary.statistics, *summary.run));
  print_sites(summary);
  print_poor_cells(summary);
  if (!summary.faults.empty()) fmt::print("\n");
  for (const Fault& fault : summary.faults) fmt::print("{}\n", fault_text(fault));
}

// With the number of faults that this rank met.
std::pair<InspectSummary, std::uint64_t> whole_summary(const RunPart& part, bool reads_all) {
  InspectSummary own = own_summary(part, reads_all);
  std::uint64_t num_faults = own.faults.size();
  InspectSummary summary = together(part, std::move(own));
  const bool is_done = summary.run && summary.run->phase == Phase::kDone && summary.faults.empty();
  if (is_done && !any(part.exchange, !part.store)) num_faults += measure(part, summary);
  return {std::move(summary), num_faults};
}

}  // namespace

Json inspected(const RunPart& whole, bool reads_all) {
  return to_json(whole_summary(whole, reads_all).first);
}

std::uint64_t inspect_summary(const RunPart& part, bool reads_all, bool is_json) {
  const auto [summary, num_faults] = whole_summary(part, reads_all);
  if (!part.is_first()) return num_faults;
  if (is_json)
    print_json(to_json(summary));
  else
    print(summary);
  return num_faults;
}

}  // namespace locvol
