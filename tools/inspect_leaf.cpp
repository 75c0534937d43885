#include "tools/inspect_leaf.h"

#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <string>

#include "engine/inspect/leaf_report.h"
#include "tools/results.h"
#include "tools/stored_run.h"

namespace locvol {
namespace {

struct LoadedReport {
  LeafReport leaf;
  double size;  // λ
};

LoadedReport load(const Store& store, const LeafSpec& spec) {
  const Snapshot snapshot = store.snapshot();
  const RunRecord run = run_of(snapshot, store.directory());
  const MortonKey key = find_leaf(snapshot, run, spec, store.directory());
  return {report_leaf(snapshot, run, key).value(), run.parameters.size};
}

LeafRow row_of(const LeafReport& leaf) {
  return {.key = leaf.key, .info = leaf.info, .unresolved = {}, .faults = leaf.faults};
}

Json kinds_json(const CountsByKind& counts) {
  Json json;
  for (std::size_t i = 0; i < counts.size(); ++i)
    json[std::string(kind_name(static_cast<PointKind>(i)))] = counts[i];
  return json;
}

std::string kinds_text(const CountsByKind& counts) {
  std::string text;
  std::uint64_t num = 0;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    num += counts[i];
    text += fmt::format("{} {} {}", i == 0 ? ":" : ",", counts[i],
                        kind_name(static_cast<PointKind>(i)));
  }
  return fmt::to_string(num) + text;
}

// The cell as mesh-wide vertex ids, in the order that is stored (positively oriented).
std::array<std::uint64_t, 4> vertices_of(const LeafCells& cells, std::size_t i) {
  std::array<std::uint64_t, 4> ids;
  for (std::size_t k = 0; k < ids.size(); ++k) ids[k] = cells.vertices.at(cells.cells[i][k]);
  return ids;
}

Json to_json(const LeafReport& leaf, double size) {
  Json json = {{"leaf", key_text(leaf.key)},
               {"level", leaf.key.level()},
               {"state", state_name(row_of(leaf).state())},
               {"box", to_json(leaf.box)}};
  if (leaf.info) json.update(to_json(*leaf.info));
  json["points_by_kind"] = kinds_json(counts_by_kind(leaf.points.points));
  json["ghosts_by_kind"] = kinds_json(leaf.ghosts);
  json["neighbors"] = Json::array();
  for (const MortonKey key : leaf.neighbors) json["neighbors"].push_back(key_text(key));
  json["num_stale_cells"] = leaf.num_stale_cells;
  if (!leaf.mesh.cells.empty()) json["quality"] = to_json(worst_quality(leaf.mesh), size);
  json["unresolved"] = Json::array();
  for (const auto& site : leaf.unresolved.sites)
    json["unresolved"].push_back(to_json(LeafSite{leaf.key, site}));
  json["points"] = Json::array();
  for (const MeshPoint& point : leaf.points.points) {
    json["points"].push_back(
        {{"id", point.id}, {"kind", kind_name(point.kind)}, {"position", to_json(point.position)}});
  }
  json["cells"] = Json::array();
  for (std::size_t i = 0; i < leaf.cells.cells.size(); ++i)
    json["cells"].push_back(vertices_of(leaf.cells, i));
  json["faults"] = to_json(leaf.faults);
  return json;
}

std::string waiting_text(const LeafReport& leaf) {
  const std::string_view state = state_name(row_of(leaf).state());
  if (!leaf.info || !leaf.info->queued) return std::string(state);
  return fmt::format("{}, for {}", state, position_text(*leaf.info->queued));
}

std::string cells_text(const LeafReport& leaf, double size) {
  std::string text = fmt::to_string(leaf.cells.cells.size());
  if (leaf.num_stale_cells > 0)
    text += fmt::format(" ({} have a vertex deleted since)", leaf.num_stale_cells);
  if (!leaf.mesh.cells.empty())
    text += "; at worst: " + quality_text(worst_quality(leaf.mesh), size);
  return text;
}

void print_head(const LeafReport& leaf, double size) {
  fmt::print("{}{}{}",
             line_text("leaf", fmt::format("{}, level {}", key_text(leaf.key), leaf.key.level())),
             line_text("box", box_text(leaf.box)), line_text("state", waiting_text(leaf)));
  if (leaf.info) {
    fmt::print("{}{}{}{}", line_text("visits", fmt::to_string(leaf.info->num_visits)),
               line_text("insertions", insertions_text(leaf.info->num_insertions)),
               line_text("deletions", fmt::to_string(leaf.info->num_deletions)),
               line_text("moves", fmt::to_string(leaf.info->num_moves)));
  }
  fmt::print("{}{}", line_text("points", kinds_text(counts_by_kind(leaf.points.points))),
             line_text("ghost points", kinds_text(leaf.ghosts)));
  fmt::print("{}{}",
             line_text("triangles", fmt::format("{}{}", leaf.num_triangles,
                                                !leaf.info ? ""
                                                : leaf.info->is_center_inside
                                                    ? "; the box's center is inside"
                                                    : "; the box's center is outside")),
             line_text("cells", cells_text(leaf, size)));
  if (leaf.info && leaf.info->num_core_points > 0)
    fmt::print("{}", line_text("lattice core",
                               fmt::format("{} points, {} cells", leaf.info->num_core_points,
                                           leaf.info->num_core_cells)));
  std::string neighbors = fmt::format("{}:", leaf.neighbors.size());
  for (const MortonKey key : leaf.neighbors) neighbors += fmt::format(" {}", key_text(key));
  fmt::print("{}", line_text("neighbors", neighbors));
  for (const Fault& fault : leaf.faults) fmt::print("{}\n", fault_text(fault));
}

// `print(i)` for the first ones, and how many more there are.
void print_first(std::string_view name, std::size_t num, std::optional<std::uint64_t> limit,
                 const std::function<void(std::size_t)>& print) {
  if (num == 0) return;
  fmt::print("{}\n", name);
  const std::size_t end = limit ? std::min<std::uint64_t>(num, *limit) : num;
  for (std::size_t i = 0; i < end; ++i) print(i);
  if (end < num) fmt::print("  and {} more\n", num - end);
}

void print(const LeafReport& leaf, double size, std::optional<std::uint64_t> limit) {
  print_head(leaf, size);
  print_first("unresolved sites", leaf.unresolved.sites.size(), limit, [&](std::size_t i) {
    fmt::print("  {}\n", site_text({leaf.key, leaf.unresolved.sites[i]}));
  });
  print_first("points", leaf.points.points.size(), limit, [&](std::size_t i) {
    const MeshPoint& point = leaf.points.points[i];
    fmt::print("  {} {} {}\n", point.id, kind_name(point.kind), point_text(point.position));
  });
  print_first("cells", leaf.cells.cells.size(), limit, [&](std::size_t i) {
    fmt::print("  {}\n", fmt::join(vertices_of(leaf.cells, i), " "));
  });
}

}  // namespace

std::uint64_t inspect_leaf(const Store& store, const LeafSpec& spec,
                           std::optional<std::uint64_t> limit, bool is_json) {
  const auto [leaf, size] = load(store, spec);
  if (is_json)
    print_json(to_json(leaf, size));
  else
    print(leaf, size, limit);
  return leaf.faults.size();
}

WrittenLeaf write_leaf(const Store& store, const LeafSpec& spec,
                       const std::filesystem::path& file) {
  const auto [leaf, size] = load(store, spec);
  const std::uint64_t bytes = write_vtu(leaf.mesh, size, file);
  return {leaf.mesh.cells.size(), bytes, leaf.faults};
}

}  // namespace locvol
