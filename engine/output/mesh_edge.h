// An edge of the mesh, and those of a cell.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "octree/geometry.h"

namespace locvol {

// By the numbers of its ends, the smaller one first.
struct MeshEdge {
  std::uint64_t a = 0, b = 0;
  friend auto operator<=>(const MeshEdge&, const MeshEdge&) = default;
};
inline MeshEdge edge_between(std::uint64_t a, std::uint64_t b) {
  return {std::min(a, b), std::max(a, b)};
}

// The edges of a cell, by its vertices, in the order of its nodes here and in VTK.
inline constexpr std::array<std::array<std::uint8_t, 2>, 6> kCellEdges{
    {{0, 1}, {1, 2}, {0, 2}, {0, 3}, {1, 3}, {2, 3}}};

// The same, whichever end comes first.
inline Point middle(const Point& a, const Point& b) { return 0.5 * (a + b); }

// The edges of a leaf's listed cells, each once, ascending.
class CellEdges {
 public:
  // `numbers`: of all vertices that cells name
  CellEdges(std::span<const std::array<std::uint32_t, 4>> cells,
            std::span<const std::int64_t> numbers);

  std::size_t size() const { return ends_.size(); }
  // Their vertices as cells name them, that with the smaller number first.
  std::span<const std::array<std::uint32_t, 2>> ends() const { return ends_; }
  MeshEdge edge(std::size_t place) const {
    const auto& [v, w] = ends_[place];
    return {static_cast<std::uint64_t>(numbers_[v]), static_cast<std::uint64_t>(numbers_[w])};
  }
  // REQUIRES: there is one between these vertices
  std::size_t place_of(std::uint32_t v, std::uint32_t w) const;

 private:
  std::span<const std::int64_t> numbers_;
  std::vector<std::uint32_t> rank_;    // of a vertex, by number
  std::vector<std::uint32_t> first_;   // of the edges whose smaller vertex has this rank; the end
  std::vector<std::uint32_t> others_;  // of each edge, the rank of the larger one
  std::vector<std::array<std::uint32_t, 2>> ends_;
};

}  // namespace locvol
