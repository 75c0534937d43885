#include "engine/inspect/crease_file.h"

#include <algorithm>
#include <tuple>
#include <vector>

#include "engine/exchange/merged_rows.h"
#include "engine/formats/mesh_arrays.h"
#include "engine/inspect/vtu_file.h"
#include "octree/crease.h"

namespace locvol {

// What a leaf has of creases, each edge and corner in one leaf.
struct SeenCreases {
  MortonKey leaf;
  std::vector<CreaseEdge> edges;
  std::vector<CornerPoint> corners;

  RowOrder order() const { return {leaf.bits()}; }
  std::size_t num_bytes() const {
    return edges.size() * sizeof(CreaseEdge) + corners.size() * sizeof(CornerPoint);
  }
};
auto fields(Maybe<SeenCreases> auto& seen) {
  auto& [leaf, edges, corners] = seen;
  return std::tuple(Field("leaf", leaf), Field("edges", edges), Field("corners", corners));
}

namespace {

// On the first rank those of all, in Morton order; on others none.
SeenCreases gathered_creases(const RunPart& part, const RunRecord& run) {
  SeenCreases all;
  MergedRows<SeenCreases> rows(part.exchange, [&](const SeenCreases& seen) {
    all.edges.insert(all.edges.end(), seen.edges.begin(), seen.edges.end());
    all.corners.insert(all.corners.end(), seen.corners.begin(), seen.corners.end());
    return true;
  });
  if (part.store) {
    const Snapshot snapshot = part.store->snapshot();
    for (const MortonKey leaf : snapshot.leaf_keys()) {
      if (!part.has(leaf)) continue;
      const LeafSurface surface = snapshot.surface(leaf);
      const Box box = run.frame.box(leaf);
      SeenCreases seen{leaf, {}, {}};
      std::ranges::copy_if(surface.creases, std::back_inserter(seen.edges),
                           [&](const CreaseEdge& edge) { return is_in_leaf(box, edge.ends[0]); });
      std::ranges::copy_if(surface.corners, std::back_inserter(seen.corners),
                           [&](const CornerPoint& c) { return is_in_leaf(box, c.position); });
      if (seen.num_bytes() > 0) rows.add(seen);
    }
  }
  rows.finish();
  return all;
}

}  // namespace

WrittenCreases write_creases_vtu(const RunPart& part, const RunRecord& run,
                                 const std::filesystem::path& file) {
  const SeenCreases all = gathered_creases(part, run);
  if (!part.is_first()) return {};
  const std::size_t num_edges = all.edges.size(), num_corners = all.corners.size();
  VtuGrid grid;
  grid.num_points = 2 * num_edges + num_corners;
  grid.point = [&](std::size_t i) {
    return i < 2 * num_edges ? all.edges[i / 2].ends[i % 2]
                             : all.corners[i - 2 * num_edges].position;
  };
  grid.cells = {{.type = kVtkLine, .num_vertices = 2, .num = num_edges},
                {.type = kVtkVertex, .num_vertices = 1, .num = num_corners}};
  grid.vertex = [&](std::size_t cell, std::size_t i) {
    return static_cast<std::int64_t>(cell < num_edges ? 2 * cell + i : num_edges + cell);
  };
  const auto add = [&](const char* name, auto of_edge, auto of_corner) {
    grid.cell_data.push_back(
        vtu_array(name, grid.num_cells(), [&all, of_edge, of_corner, num_edges](std::size_t i) {
          return static_cast<std::int64_t>(i < num_edges ? of_edge(all.edges[i])
                                                         : of_corner(all.corners[i - num_edges]));
        }));
  };
  const auto none = [](const auto&) { return std::uint32_t{0}; };
  add(
      "crease", [](const CreaseEdge& edge) { return edge.crease; }, none);
  add(
      "sheet", [](const CreaseEdge& edge) { return edge.sheets[0]; }, none);
  add(
      "other_sheet", [](const CreaseEdge& edge) { return edge.sheets[1]; }, none);
  add("corner", none, [](const CornerPoint& corner) { return corner.corner; });
  return {num_edges, num_corners, write_vtu_grid(grid, file)};
}

}  // namespace locvol
