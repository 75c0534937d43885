// `locvol inspect`: what is in a store, as a whole or leaf by leaf.
#include <fmt/format.h>

#include <map>
#include <stdexcept>

#include "tools/arguments.h"
#include "tools/commands.h"
#include "tools/progress.h"
#include "tools/report.h"
#include "tools/stored_run.h"

namespace locvol {
namespace {

struct LeafCounts {
  std::uint64_t num_clean = 0, num_queued = 0;
};

using CountsByLevel = std::map<int, LeafCounts>;

CountsByLevel counts_by_level(const Reader& reader) {
  CountsByLevel levels;
  reader.for_each_leaf([&](MortonKey key, const LeafInfo& info) {
    LeafCounts& counts = levels[key.level()];
    ++(info.queued ? counts.num_queued : counts.num_clean);
    return true;
  });
  return levels;
}

struct Summary {
  RunSummary run;
  CountsByLevel levels;
  std::vector<LeafSite> unresolved;
  std::vector<DatabaseSize> databases;

  std::uint64_t bytes() const {
    std::uint64_t sum = 0;
    for (const DatabaseSize& database : databases) sum += database.bytes;
    return sum;
  }
  std::optional<double> bytes_per_cell() const {
    if (run.num_cells == 0) return std::nullopt;
    return static_cast<double>(bytes()) / static_cast<double>(run.num_cells);
  }
};

Summary summary_of(const Store& store) {
  const Snapshot snapshot = store.snapshot();
  return {summarize(snapshot), counts_by_level(snapshot), unresolved_sites(snapshot),
          store.sizes()};
}

Json to_json(const Summary& summary) {
  Json json = to_json(summary.run);
  json["epoch"] = summary.run.run.epoch;
  for (const auto& [level, counts] : summary.levels) {
    json["leaves"].push_back(
        {{"level", level}, {"num_clean", counts.num_clean}, {"num_queued", counts.num_queued}});
  }
  json["bytes"] = summary.bytes();
  if (const auto bytes = summary.bytes_per_cell()) json["bytes_per_cell"] = *bytes;
  json["databases"] = Json::array();
  for (const auto& database : summary.databases) json["databases"].push_back(to_json(database));
  json["unresolved"] = Json::array();
  for (const auto& site : summary.unresolved) json["unresolved"].push_back(to_json(site));
  return json;
}

void print_levels(const CountsByLevel& levels) {
  fmt::print("\n{:>7} {:>12} {:>12}\n", "level", "clean", "queued");
  for (const auto& [level, counts] : levels) {
    fmt::print("{:>7} {:>12} {:>12}\n", level, counts.num_clean, counts.num_queued);
  }
}

void print_databases(const Summary& summary) {
  fmt::print("\n{:<12} {:>12} {:>12}\n", "database", "on disk", "entries");
  for (const DatabaseSize& database : summary.databases) {
    fmt::print("{:<12} {:>12} {:>12}\n", database.name, bytes_text(database.bytes),
               database.num_entries);
  }
  fmt::print("{:<12} {:>12}", "all", bytes_text(summary.bytes()));
  if (const auto bytes = summary.bytes_per_cell()) fmt::print(", {:.1f} bytes per cell", *bytes);
  fmt::print("\n");
}

void print(const Summary& summary) {
  const RunRecord& run = summary.run.run;
  fmt::print("{}{}{}", facts_text(run.surface), parameters_text(run.parameters),
             summary_text(summary.run));
  fmt::print("{:<16} {}\n", "epoch", run.epoch);
  print_levels(summary.levels);
  print_databases(summary);
  if (!summary.unresolved.empty()) fmt::print("\nunresolved sites\n");
  for (const LeafSite& site : summary.unresolved) fmt::print("  {}\n", site_text(site));
}

Json leaves_json(const Reader& reader) {
  Json leaves = Json::array();
  reader.for_each_leaf([&](MortonKey key, const LeafInfo& info) {
    Json leaf = {{"leaf", key_text(key)}, {"level", key.level()}};
    leaf.update(to_json(info));
    leaves.push_back(std::move(leaf));
    return true;
  });
  return leaves;
}

void print_leaves(const Reader& reader) {
  fmt::print("{:<16} {:>5} {:<6} {:>6} {:>9} {:>9} {:>9} {:>10}\n", "leaf", "level", "state",
             "visits", "points", "cells", "triangles", "unresolved");
  reader.for_each_leaf([](MortonKey key, const LeafInfo& info) {
    fmt::print("{:<16} {:>5} {:<6} {:>6} {:>9} {:>9} {:>9} {:>10}\n", key_text(key), key.level(),
               info.queued ? "queued" : "clean", info.num_visits, info.num_points, info.num_cells,
               info.num_triangles, info.num_unresolved);
    return true;
  });
}

Json queue_json(const Reader& reader) {
  Json queue = Json::array();
  reader.for_each_queued([&](const QueueEntry& entry) {
    queue.push_back(to_json(entry));
    return true;
  });
  return queue;
}

void print_queue(const Reader& reader) {
  fmt::print("{:>6} {:>6} {:<16} dirty\n", "epoch", "color", "leaf");
  reader.for_each_queued([](const QueueEntry& entry) {
    fmt::print("{:>6} {:>6} {:<16} {}\n", entry.position.epoch, entry.position.color,
               key_text(entry.leaf), box_text(entry.dirty));
    return true;
  });
}

struct LeafContents {
  MortonKey key;
  Box box;
  LeafInfo info;
  LeafPoints points;
  LeafCells cells;
  LeafUnresolved unresolved;
  std::optional<QueueEntry> queued;
};

LeafContents contents_of(const Store& store, MortonKey key) {
  const RunRecord run = run_of(store);
  const Snapshot snapshot = store.snapshot();
  const auto info = snapshot.leaf(key);
  if (!info) {
    throw std::runtime_error(
        fmt::format("the store {} has no leaf {}; `locvol inspect {} --leaves` "
                    "lists all",
                    store.directory().string(), key_text(key), store.directory().string()));
  }
  std::optional<QueueEntry> queued;
  if (info->queued) queued = snapshot.queue_entry(*info->queued, key);
  return {key,
          run.frame.box(key),
          *info,
          snapshot.points(key),
          snapshot.cells(key),
          snapshot.unresolved(key),
          queued};
}

// The cell as mesh-wide vertex ids, in the order that is stored (positively oriented).
std::array<std::uint64_t, 4> vertices_of(const LeafCells& cells, std::size_t i) {
  std::array<std::uint64_t, 4> ids;
  for (std::size_t k = 0; k < ids.size(); ++k) ids[k] = cells.vertices.at(cells.cells[i][k]);
  return ids;
}

Json to_json(const LeafContents& leaf) {
  Json json = {
      {"leaf", key_text(leaf.key)}, {"level", leaf.key.level()}, {"box", to_json(leaf.box)}};
  json.update(to_json(leaf.info));
  json["points"] = Json::array();
  for (const MeshPoint& point : leaf.points.points) {
    json["points"].push_back(
        {{"id", point.id}, {"kind", kind_name(point.kind)}, {"position", to_json(point.position)}});
  }
  json["cells"] = Json::array();
  for (std::size_t i = 0; i < leaf.cells.cells.size(); ++i) {
    json["cells"].push_back(vertices_of(leaf.cells, i));
  }
  json["unresolved"] = Json::array();
  for (const auto& site : leaf.unresolved.sites) {
    json["unresolved"].push_back(to_json(LeafSite{leaf.key, site}));
  }
  if (leaf.queued) json["queue_entry"] = to_json(*leaf.queued);
  return json;
}

void print(const LeafContents& leaf) {
  const LeafInfo& info = leaf.info;
  fmt::print("leaf {}, level {}\nbox {}\n", key_text(leaf.key), leaf.key.level(),
             box_text(leaf.box));
  fmt::print("{} visits; {} points, {} cells, {} triangles; center {}\n", info.num_visits,
             info.num_points, info.num_cells, info.num_triangles,
             info.is_center_inside ? "inside" : "outside");
  fmt::print("insertions {}; {} deletions\n", insertions_text(info.num_insertions),
             info.num_deletions);
  if (leaf.queued) {
    fmt::print("queued for epoch {}, color {}, dirty {}\n", leaf.queued->position.epoch,
               leaf.queued->position.color, box_text(leaf.queued->dirty));
  }
  fmt::print("points\n");
  for (const MeshPoint& point : leaf.points.points) {
    fmt::print("  {} {} {}\n", point.id, kind_name(point.kind), point_text(point.position));
  }
  fmt::print("cells\n");
  for (std::size_t i = 0; i < leaf.cells.cells.size(); ++i) {
    fmt::print("  {}\n", fmt::join(vertices_of(leaf.cells, i), " "));
  }
  fmt::print("unresolved sites\n");
  for (const auto& site : leaf.unresolved.sites) {
    fmt::print("  {}\n", site_text({leaf.key, site}));
  }
}

}  // namespace

int run_inspect(const InspectCommand& command) {
  const Store store = open_to_read(command.store);
  run_of(store);  // refuses a store without a run
  if (command.leaf) {
    const LeafContents leaf = contents_of(store, *command.leaf);
    command.is_json ? print_json(to_json(leaf)) : print(leaf);
  } else if (command.lists_leaves) {
    const Snapshot snapshot = store.snapshot();
    command.is_json ? print_json(leaves_json(snapshot)) : print_leaves(snapshot);
  } else if (command.lists_queue) {
    const Snapshot snapshot = store.snapshot();
    command.is_json ? print_json(queue_json(snapshot)) : print_queue(snapshot);
  } else {
    const Summary summary = summary_of(store);
    command.is_json ? print_json(to_json(summary)) : print(summary);
  }
  return kExitDone;
}

}  // namespace locvol
