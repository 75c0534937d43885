#include "engine/inspect/leaf_report.h"

#include <algorithm>
#include <map>
#include <numeric>
#include <set>
#include <stdexcept>
#include <string>
#include <unordered_map>
#include <utility>

#include "engine/inspect/vtu_file.h"
#include "engine/shared/lattice_of_run.h"
#include "engine/shared/leaf_name.h"
#include "octree/site_block.h"
#include "refine/refine_leaf.h"

namespace locvol {
namespace {

class Reporter {
 public:
  Reporter(const Reader& reader, const RunRecord& run, MortonKey leaf)
      : reader_(reader),
        reach_(kReach * run.parameters.size),
        frame_(run.frame),
        lattice_(lattice_of(run)) {
    if (!run.parameters.sizes().is_uniform())
      reach_ = reach_factor(run.parameters.growth, kReach) *
               reader.leaf(leaf).value_or(LeafInfo()).largest_size;
    report_.key = leaf;
    report_.box = frame_.box(leaf);
    sites_ = lattice_.sites_in(report_.box);
  }

  LeafReport report(std::optional<LeafInfo> info) && {
    report_.info = std::move(info);
    read_own();
    read_surroundings();
    build_mesh();
    return std::move(report_);
  }

  std::vector<Fault>& faults() { return report_.faults; }

 private:
  template <class Read>
  auto value_of(const Read& read) -> decltype(read()) {
    auto value = read_around(report_.faults, read);
    return value ? *std::move(value) : decltype(read())();
  }

  void read_own() {
    const MortonKey key = report_.key;
    report_.points = value_of([&] { return reader_.points(key); });
    report_.cells = value_of([&] { return reader_.cells(key); });
    report_.num_triangles = value_of([&] { return reader_.surface(key); }).size();
    report_.unresolved = value_of([&] { return reader_.unresolved(key); });
    if (report_.info && report_.info->queued)
      value_of([&] { return reader_.has_queue_entry({*report_.info->queued, key}); });
  }

  void read_surroundings() {
    for (const MeshPoint& p : report_.points.points) note(p, true);
    note_core(report_.points.core, report_.key);
    for (const MortonKey other : stored_leaves_within(reader_, frame_, report_.box, reach_)) {
      if (other == report_.key) continue;
      if (frame_.box(other).overlaps(report_.box)) report_.neighbors.push_back(other);
      const LeafPoints held = value_of([&] { return reader_.points(other); });
      note_core(held.core, other);
      std::vector<MeshPoint> ghosts = held.points;
      std::erase_if(ghosts, [&](const MeshPoint& p) {
        return report_.box.squared_distance(p.position) > reach_ * reach_;
      });
      const CountsByKind counts = counts_by_kind(ghosts);
      for (std::size_t kind = 0; kind < kNumPointKinds; ++kind)
        report_.ghosts[kind] += counts[kind];
      for (const MeshPoint& p : ghosts) note(p, false);
    }
  }

  void note(const MeshPoint& p, bool is_own) {
    vertices_[p.id] = {static_cast<std::int64_t>(p.id), p.position, p.kind, is_own};
  }

  // The core as far as the leaf's cells go.
  void note_core(const LatticeCore& core, MortonKey leaf) {
    const SiteBox box = lattice_.sites_in(frame_.box(leaf));
    try {
      check_core(core, box);
    } catch (const std::invalid_argument& e) {
      report_.faults.push_back({leaf, leaf_name(leaf) + ": " + e.what()});
      return;
    }
    for_each_core_site(core, box, sites_.expanded(2), [&](const LatticeSite& site, std::uint64_t) {
      note(lattice_.point(site), leaf == report_.key);
      core_.insert(site);
    });
  }

  void build_mesh() {
    constexpr std::uint32_t kGone = ~std::uint32_t{0};
    std::vector<std::uint32_t> index;  // of each of cells.vertices, in mesh.vertices
    for (const std::uint64_t id : report_.cells.vertices) {
      const auto vertex = vertices_.find(id);
      const bool is_known = vertex != vertices_.end();
      index.push_back(is_known ? static_cast<std::uint32_t>(report_.mesh.vertices.size()) : kGone);
      if (is_known) report_.mesh.vertices.push_back(vertex->second);
    }
    for (const auto& [a, b, c, d] : report_.cells.cells) {
      const std::array cell = {index[a], index[b], index[c], index[d]};
      if (std::ranges::find(cell, kGone) == cell.end())
        report_.mesh.cells.push_back(cell);
      else
        ++report_.num_stale_cells;
    }
    add_core_cells();
    const bool is_waiting = !report_.info || report_.info->queued;
    if (report_.num_stale_cells == 0 || is_waiting || !report_.faults.empty()) return;
    report_.faults.push_back({report_.key, leaf_name(report_.key) + ": " +
                                               std::to_string(report_.num_stale_cells) +
                                               " cells have a vertex that is in no leaf near it"});
  }

  void add_core_cells() {
    if (core_.empty()) return;
    std::map<LatticeSite, std::uint32_t> index;  // in mesh.vertices
    const auto vertex = [&](const LatticeSite& site) {
      const auto next = static_cast<std::uint32_t>(report_.mesh.vertices.size());
      const auto [place, is_new] = index.try_emplace(site, next);
      if (is_new) report_.mesh.vertices.push_back(vertices_.at(site_id(site)));
      return place->second;
    };
    for_each_core_cell(
        sites_, [&](const LatticeSite& site) { return core_.contains(site); },
        [&](const LatticeSite& site, const LatticeCell& cell) {
          report_.mesh.cells.push_back({vertex(site), vertex(site + cell[0]),
                                        vertex(site + cell[1]), vertex(site + cell[2])});
        });
  }

  const Reader& reader_;
  double reach_;
  Frame frame_;
  Lattice lattice_;
  SiteBox sites_;  // of the leaf
  LeafReport report_;
  std::set<LatticeSite> core_;
  std::unordered_map<std::uint64_t, CellMesh::Vertex> vertices_;  // asked, never listed
};

}  // namespace

CountsByKind counts_by_kind(std::span<const MeshPoint> points) {
  CountsByKind counts{};
  for (const MeshPoint& p : points) ++counts[static_cast<std::size_t>(p.kind)];
  return counts;
}

std::optional<LeafReport> report_leaf(const Reader& reader, const RunRecord& run, MortonKey leaf) {
  Reporter reporter(reader, run, leaf);
  auto info = read_around(reporter.faults(), [&] { return reader.leaf(leaf); });
  if (info && !*info) return std::nullopt;
  return std::move(reporter).report(info.value_or(std::nullopt));
}

std::uint64_t write_leaves_vtu(std::span<const LeafRow> leaves, const Frame& frame,
                               const std::filesystem::path& file) {
  VtuGrid grid =
      grid_of_boxes(leaves.size(), [&](std::size_t i) { return frame.box(leaves[i].key); });
  const auto add = [&](const char* name, auto value) {
    grid.cell_data.push_back(vtu_array(
        name, leaves.size(), [&leaves, value](std::size_t i) { return value(leaves[i]); }));
  };
  const auto add_count = [&](const char* name, auto count) {
    add(name, [count](const LeafRow& row) {
      return row.info ? static_cast<std::int64_t>(count(*row.info)) : std::int64_t{-1};
    });
  };
  add("key", [](const LeafRow& row) { return row.key.bits(); });
  add("level", [](const LeafRow& row) { return std::int64_t{row.key.level()}; });
  add("state", [](const LeafRow& row) { return static_cast<std::int64_t>(row.state()); });
  add_count("visits", [](const LeafInfo& info) { return info.num_visits; });
  add_count("points", [](const LeafInfo& info) { return info.num_points; });
  add_count("cells", [](const LeafInfo& info) { return info.num_cells; });
  add_count("core_points", [](const LeafInfo& info) { return info.num_core_points; });
  add_count("core_cells", [](const LeafInfo& info) { return info.num_core_cells; });
  add_count("triangles", [](const LeafInfo& info) { return info.num_triangles; });
  add_count("insertions", [](const LeafInfo& info) {
    return std::reduce(info.num_insertions.begin(), info.num_insertions.end());
  });
  add_count("deletions", [](const LeafInfo& info) { return info.num_deletions; });
  add_count("moves", [](const LeafInfo& info) { return info.num_moves; });
  add_count("unresolved", [](const LeafInfo& info) { return info.num_unresolved; });
  add_count("queued", [](const LeafInfo& info) { return info.queued ? 1 : 0; });
  add_count("epoch", [](const LeafInfo& info) {
    return info.queued ? std::int64_t{info.queued->epoch} : -1;
  });
  add_count("color", [](const LeafInfo& info) {
    return info.queued ? std::int64_t{info.queued->color} : -1;
  });
  return write_vtu_grid(grid, file);
}

}  // namespace locvol
