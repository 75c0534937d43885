// EdgeWindow looks up the numbers of edges.
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "engine/output/edge_numbering.h"
#include "engine/output/leaf_window.h"
#include "engine/output/mesh_edge.h"
#include "engine/output/vertex_numbering.h"
#include "engine/shared/idle_pool.h"
#include "octree/site_block.h"

namespace locvol {

// The edges of a point of the core to larger ones.
struct CoreEdges {
  std::int64_t first = -1;  // number; -1: no point of the core is there
  std::uint8_t steps = 0;
  // REQUIRES: it has that step
  std::int64_t number(std::size_t step) const {
    return first + std::popcount(steps & ((1U << step) - 1));
  }
};

// Memory: 12 MB, divided by `num_shares`, and 16 bytes a site of a leaf's box. Errors:
// CorruptRecord, if cells have an edge that has no number.
class EdgeWindow {
 public:
  // Both must outlive it.
  EdgeWindow(const VertexNumbering& numbering, const EdgeNumbering& edges, int num_shares);

  // Of the leaf's listed cells, the number of each of their edges. `number_of_vertex`: by the
  // places in cells.vertices
  std::vector<std::int64_t> numbers(std::size_t leaf, const LeafCells& cells,
                                    std::span<const std::int64_t> number_of_vertex,
                                    const CellEdges& edges, NumberWindow& cores);
  // REQUIRES: not both ends are of the core; that it is of an own leaf, or one beside
  std::uint64_t number(const MeshEdge& edge);
  // Of the core's points in the leaf and up to two sites around it. Null if there are none. Valid
  // until the next call of it or of numbers().
  const SiteBlock<CoreEdges>* core(std::size_t leaf, NumberWindow& cores);

 private:
  struct CoreTable {
    std::vector<std::uint8_t> steps;  // empty: all have all
    std::vector<std::uint32_t> before;
    std::size_t bytes() const { return sizeof *this + steps.capacity() + 4 * before.capacity(); }
  };
  std::int64_t core_number(std::size_t leaf, std::uint64_t id, std::uint64_t other,
                           NumberWindow& cores);
  [[noreturn]] void throw_unknown(const MeshEdge& edge) const;

  const VertexNumbering* numbering_;
  const EdgeNumbering* edges_;
  LeafWindow<LeafList<MeshEdge>> listed_;
  LeafWindow<CoreTable> cores_;
  SiteBlock<CoreEdges> core_;
  std::size_t leaf_of_core_ = ~std::size_t{0};
  bool has_core_ = false;
};

using EdgeWindows = LendingPool<EdgeWindow>;

// The step between two sites that are neighbors, the smaller first: its place in kLargerNeighbors.
constexpr std::optional<std::size_t> step_between(const LatticeSite& from, const LatticeSite& to) {
  const LatticeSite way{to.i - from.i, to.j - from.j, to.k - from.k};
  for (std::size_t step = 0; step < kLargerNeighbors.size(); ++step)
    if (kLargerNeighbors[step] == way) return step;
  return std::nullopt;
}

// Of the cells whose smallest site is the origin (kCellsOfLargerNeighbors), the edges in the order
// of kCellEdges: from which site, as a place in kLargerNeighbors or the origin, and by which step.
struct CoreCellEdge {
  std::size_t from = 0, step = 0;
  static constexpr std::size_t kOrigin = kLargerNeighbors.size();
};
inline constexpr std::array<std::array<CoreCellEdge, 6>, 6> kCoreCellEdges = [] {
  std::array<std::array<CoreCellEdge, 6>, 6> edges{};
  for (std::size_t c = 0; c < edges.size(); ++c) {
    const auto& [p, q, r] = kCellsOfLargerNeighbors[c];
    const std::array<std::size_t, 4> places{CoreCellEdge::kOrigin, p, q, r};
    const auto site = [](std::size_t place) {
      return place == CoreCellEdge::kOrigin ? LatticeSite{} : kLargerNeighbors[place];
    };
    for (std::size_t e = 0; e < 6; ++e) {
      std::size_t from = places[kCellEdges[e][0]], to = places[kCellEdges[e][1]];
      if (site(to) < site(from)) std::swap(from, to);
      edges[c][e] = {from, step_between(site(from), site(to)).value()};
    }
  }
  return edges;
}();

}  // namespace locvol
