#include "tools/inspect_leaf.h"

#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "engine/exchange/pack.h"
#include "engine/inspect/leaf_report.h"
#include "engine/inspect/leaf_row_fields.h"
#include "tools/results.h"
#include "tools/stored_run.h"

namespace locvol {

// A leaf's cells, and what goes with them into a file.
struct CellsOfLeaf {
  CellMesh mesh;
  double size = 0;  // λ
  std::vector<Fault> faults;
};
auto fields(Maybe<CellMesh::Vertex> auto& vertex) {
  auto& [id, position, kind, is_own] = vertex;
  return std::tuple(Field("id", id), Field("position", position), Field("kind", kind),
                    Field("is_own", is_own));
}
auto fields(Maybe<CellMesh> auto& mesh) {
  auto& [vertices, cells] = mesh;
  return std::tuple(Field("vertices", vertices), Field("cells", cells));
}
auto fields(Maybe<CellsOfLeaf> auto& of_leaf) {
  auto& [mesh, size, faults] = of_leaf;
  return std::tuple(Field("mesh", mesh), Field("size", size), Field("faults", faults));
}

namespace {

struct LoadedReport {
  LeafReport leaf;
  double size;  // λ
};

LoadedReport load(const RunPart& part, const LeafSpec& spec) {
  if (!part.store)
    throw StoreError(part.name() + "the store " + part.directory.string() +
                     ", which has the leaf, cannot be opened");
  const Snapshot snapshot = part.store->snapshot();
  const RunRecord run = run_of(snapshot, part.directory);
  const MortonKey key = find_leaf(snapshot, run, spec, part.directory);
  LeafReport leaf = report_leaf(snapshot, run, key).value();
  leaf.faults = named(part, std::move(leaf.faults));
  return {std::move(leaf), run.parameters.size};
}

// The rank that has the leaf; where there is none, one that can say so.
int owner_of(const RunPart& part, const LeafSpec& spec) {
  if (!part.shares) return part.exchange.rank();
  const Frame frame = run_of(part).frame;
  const Point* point = std::get_if<Point>(&spec);
  if (!point) return part.shares->owner_of(std::get<MortonKey>(spec));
  return frame.contains(*point) ? part.shares->owner_of(frame.key_of(*point, MortonKey::kMaxLevel))
                                : 0;
}

// What the rank that has the leaf tells of it; empty on all ranks but the first.
std::string told_to_first(const RunPart& part, const LeafSpec& spec,
                          const std::function<std::string(const LoadedReport&)>& tell) {
  const int owner = owner_of(part, spec);
  std::vector<std::string> messages(static_cast<std::size_t>(part.exchange.num_ranks()));
  if (part.exchange.rank() == owner) messages.front() = tell(load(part, spec));
  return part.exchange.swap(std::move(messages))[static_cast<std::size_t>(owner)];
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

std::string head_text(const LeafReport& leaf, double size) {
  std::string text =
      line_text("leaf", fmt::format("{}, level {}", key_text(leaf.key), leaf.key.level())) +
      line_text("box", box_text(leaf.box)) + line_text("state", waiting_text(leaf));
  if (leaf.info)
    text += line_text("visits", fmt::to_string(leaf.info->num_visits)) +
            line_text("insertions", insertions_text(leaf.info->num_insertions)) +
            line_text("deletions", fmt::to_string(leaf.info->num_deletions)) +
            line_text("moves", fmt::to_string(leaf.info->num_moves));
  text += line_text("points", kinds_text(counts_by_kind(leaf.points.points))) +
          line_text("ghost points", kinds_text(leaf.ghosts));
  text += line_text("triangles", fmt::format("{}{}", leaf.num_triangles,
                                             !leaf.info ? ""
                                             : leaf.info->center.body() != kNoBody
                                                 ? "; the box's center is inside"
                                                 : "; the box's center is outside")) +
          line_text("cells", cells_text(leaf, size));
  if (leaf.info && leaf.info->num_core_points > 0)
    text += line_text("lattice core", fmt::format("{} points, {} cells", leaf.info->num_core_points,
                                                  leaf.info->num_core_cells));
  std::string neighbors = fmt::format("{}:", leaf.neighbors.size());
  for (const MortonKey key : leaf.neighbors) neighbors += fmt::format(" {}", key_text(key));
  text += line_text("neighbors", neighbors);
  for (const Fault& fault : leaf.faults) text += fmt::format("{}\n", fault_text(fault));
  return text;
}

// `line(i)` for the first ones, and how many more there are.
std::string first_lines(std::string_view name, std::size_t num, std::optional<std::uint64_t> limit,
                        const std::function<std::string(std::size_t)>& line) {
  if (num == 0) return {};
  std::string text = fmt::format("{}\n", name);
  const std::size_t end = limit ? std::min<std::uint64_t>(num, *limit) : num;
  for (std::size_t i = 0; i < end; ++i) text += fmt::format("  {}\n", line(i));
  if (end < num) text += fmt::format("  and {} more\n", num - end);
  return text;
}

std::string text_of(const LeafReport& leaf, double size, std::optional<std::uint64_t> limit) {
  const auto site = [&](std::size_t i) { return site_text({leaf.key, leaf.unresolved.sites[i]}); };
  const auto point = [&](std::size_t i) {
    const MeshPoint& p = leaf.points.points[i];
    return fmt::format("{} {} {}", p.id, kind_name(p.kind), point_text(p.position));
  };
  const auto cell = [&](std::size_t i) {
    return fmt::to_string(fmt::join(vertices_of(leaf.cells, i), " "));
  };
  return head_text(leaf, size) +
         first_lines("unresolved sites", leaf.unresolved.sites.size(), limit, site) +
         first_lines("points", leaf.points.points.size(), limit, point) +
         first_lines("cells", leaf.cells.cells.size(), limit, cell);
}

}  // namespace

std::uint64_t inspect_leaf(const RunPart& part, const LeafSpec& spec,
                           std::optional<std::uint64_t> limit, bool is_json) {
  std::uint64_t num_faults = 0;
  const auto tell = [&](const LoadedReport& loaded) {
    const auto& [leaf, size] = loaded;
    num_faults = leaf.faults.size();
    return is_json ? json_text(to_json(leaf, size)) : text_of(leaf, size, limit);
  };
  fmt::print("{}", told_to_first(part, spec, tell));
  return num_faults;
}

WrittenLeaf write_leaf(const RunPart& part, const LeafSpec& spec,
                       const std::filesystem::path& file) {
  WrittenLeaf written;
  const auto tell = [&](const LoadedReport& loaded) {
    const auto& [leaf, size] = loaded;
    written.num_own_faults = leaf.faults.size();
    return pack(CellsOfLeaf{leaf.mesh, size, leaf.faults});
  };
  const std::string told = told_to_first(part, spec, tell);
  if (!part.is_first()) return written;
  CellsOfLeaf of_leaf = unpack<CellsOfLeaf>(told);
  written.num_cells = of_leaf.mesh.cells.size();
  written.bytes = write_vtu(of_leaf.mesh, of_leaf.size, file);
  written.faults = std::move(of_leaf.faults);
  return written;
}

}  // namespace locvol
