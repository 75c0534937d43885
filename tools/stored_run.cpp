#include "tools/stored_run.h"

#include <fmt/format.h>

#include <optional>
#include <stdexcept>
#include <utility>

#include "engine/inspect/leaf_scan.h"
#include "engine/plan/same_run.h"
#include "storage/codec.h"
#include "tools/results.h"

namespace locvol {
namespace {

// What is in the place of a node that is no leaf: the run may have split it meanwhile.
std::string place_text(const Reader& reader, const RunRecord& run, MortonKey node) {
  const auto below = reader.leaf_keys(node.range_min(), 1);
  if (!below.empty() && below[0] <= node.range_max()) {
    return fmt::format("it has been split, the first leaf in it is {}", key_text(below[0]));
  }
  if (const auto above = leaf_holding(reader, run.frame, run.frame.box(node).min)) {
    return fmt::format("it lies in the leaf {}", key_text(*above));
  }
  return "nor any in its place";
}

}  // namespace

Store open_to_read(const std::filesystem::path& directory) {
  return Store::open(directory, {.read_only = true});
}

Store open_whole(const std::filesystem::path& directory) {
  Store store = open_to_read(directory);
  require_whole_run(store);
  return store;
}

namespace {

void require_finished(bool is_finished, const std::filesystem::path& stores) {
  if (!is_finished)
    throw StoreError(stores.string() +
                     ": the stores hold no finished run: `locvol-mpi resume` goes on with one");
}

}  // namespace

HeldRun finished_by_ranks(const std::filesystem::path& stores, Exchange& exchange) {
  std::optional<HeldRun> held = held_by_ranks(stores, exchange);
  require_finished(held && held->run.phase == Phase::kDone && !held->is_within_superstep, stores);
  return *std::move(held);
}

Store open_part(const std::filesystem::path& stores, Exchange& exchange) {
  SeenPart seen = part_to_look_into(stores, exchange);
  if (!seen.store) throw StoreError(seen.fault);
  const bool is_done = run_of(*seen.store).phase == Phase::kDone;
  require_finished(!any(exchange, !is_done), stores);
  return *std::move(seen.store);
}

RunRecord run_of(const Reader& reader, const std::filesystem::path& directory) {
  auto run = reader.run();
  if (!run) {
    throw std::runtime_error(fmt::format("no run has begun in the store {}", directory.string()));
  }
  return *std::move(run);
}

RunRecord run_of(const Store& store) { return run_of(store.snapshot(), store.directory()); }

RunRecord run_of(const RunPart& part) {
  std::vector<Fault> ignored;
  std::optional<RunRecord> own;
  if (part.store) own = read_around(ignored, [&] { return run_of(*part.store); });
  for (const std::string& bytes :
       part.exchange.gather(own ? encode(*own, MortonKey()) : std::string()))
    if (!bytes.empty()) return decode<RunRecord>(bytes, MortonKey());
  return run_of(part.store.value());
}

void require_done(const Store& store) {
  const Phase phase = run_of(store).phase;
  if (phase == Phase::kDone) return;
  const std::string directory = store.directory().string();
  throw std::runtime_error(
      fmt::format("the run in {} is not done (phase: {}); `locvol resume {}` goes on with it",
                  directory, phase_name(phase), directory));
}

MortonKey find_leaf(const Reader& reader, const RunRecord& run, const LeafSpec& spec,
                    const std::filesystem::path& directory) {
  std::string what;
  if (const Point* point = std::get_if<Point>(&spec)) {
    if (const auto leaf = leaf_holding(reader, run.frame, *point)) return *leaf;
    what = fmt::format("no leaf around {}: the octree spans {}", point_text(*point),
                       box_text(run.frame.root_box()));
  } else {
    const MortonKey key = std::get<MortonKey>(spec);
    const auto first = reader.leaf_keys(key, 1);
    if (!first.empty() && first[0] == key) return key;
    what = fmt::format("no leaf {}: {}", key_text(key), place_text(reader, run, key));
  }
  throw std::runtime_error(
      fmt::format("the store {} has {}; `locvol inspect {} --leaves` lists all", directory.string(),
                  what, directory.string()));
}

std::vector<LeafSite> unresolved_sites(const Reader& reader) {
  std::vector<LeafSite> sites;
  reader.for_each_leaf([&](MortonKey key, const LeafInfo& info) {
    if (info.num_unresolved == 0 || info.holding != Holding::kOwn) return true;
    for (const UnresolvedSite& site : reader.unresolved(key).sites) sites.push_back({key, site});
    return true;
  });
  return sites;
}

}  // namespace locvol
