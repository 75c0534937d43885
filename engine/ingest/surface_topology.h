// Which triangles are neighbors: the combinatorial side of a triangle surface, or of a piece of it.
//
// Half-edge 3 t + k runs from corner k of triangle t to the next one.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "engine/ingest/triangle_soup.h"

namespace locvol {

inline constexpr std::uint32_t kNoHalfEdge = 0xffffffff;

inline std::uint32_t next_half_edge(std::uint32_t h) { return h % 3 == 2 ? h - 2 : h + 1; }
inline std::uint32_t previous_half_edge(std::uint32_t h) { return h % 3 == 0 ? h + 2 : h - 1; }
inline std::uint32_t origin(std::span<const TriangleCorners> triangles, std::uint32_t h) {
  return triangles[h / 3][h % 3];
}
inline std::uint32_t target(std::span<const TriangleCorners> triangles, std::uint32_t h) {
  return origin(triangles, next_half_edge(h));
}
// The corner beyond the half-edge's edge.
inline std::uint32_t apex(std::span<const TriangleCorners> triangles, std::uint32_t h) {
  return origin(triangles, previous_half_edge(h));
}

// For each half-edge, that of the triangle beyond its edge; kNoHalfEdge unless there is exactly
// one.
using Mates = std::vector<std::uint32_t>;

// The half-edges of each edge. Memory: 24 bytes a triangle.
class EdgeTable {
 public:
  EdgeTable(std::size_t num_vertices, std::span<const TriangleCorners> triangles);

  // visit(half_edges): ascending, one call for each edge.
  template <class Visit>
  void for_each_edge(const Visit& visit);

 private:
  // One half-edge, as its edge's smaller vertex lists it.
  struct Use {
    std::uint32_t larger_vertex = 0, half_edge = 0;
    friend auto operator<=>(const Use&, const Use&) = default;
  };

  std::vector<std::uint32_t> begin_;  // of each vertex's uses
  std::vector<Use> uses_;
};

template <class Visit>
void EdgeTable::for_each_edge(const Visit& visit) {
  std::vector<std::uint32_t> half_edges;
  for (std::size_t v = 0; v + 1 < begin_.size(); ++v) {
    const std::span uses(uses_.data() + begin_[v], begin_[v + 1] - begin_[v]);
    std::ranges::sort(uses);
    for (std::size_t i = 0; i < uses.size();) {
      half_edges.clear();
      const std::uint32_t larger = uses[i].larger_vertex;
      for (; i < uses.size() && uses[i].larger_vertex == larger; ++i)
        half_edges.push_back(uses[i].half_edge);
      visit(std::span<const std::uint32_t>(half_edges));
    }
  }
}

// Edges of any number of triangles but two pair none.
Mates paired_edges(std::size_t num_vertices, std::span<const TriangleCorners> triangles);

// Parts of a surface whose triangles hang together by their edges.
struct Components {
  std::vector<std::uint32_t> of_triangle;  // numbered by their first triangles
  std::uint32_t count = 0;
  std::vector<bool> is_turned;  // by triangle: its orientation differs from its component's first
  std::uint32_t conflict = kNoHalfEdge;  // where no orientation is consistent, if anywhere
};
Components find_components(std::span<const TriangleCorners> triangles,
                           std::span<const std::uint32_t> mates);

// Reverses the orientation of the marked triangles and keeps their mates in step.
void turn_triangles(const std::vector<bool>& is_turned, std::span<TriangleCorners> triangles,
                    std::span<std::uint32_t> mates);

// Counts the triangles that form the fan around the origin of half-edge h, whatever their
// orientation; 0 if it does not close.
std::uint32_t fan_around(std::span<const TriangleCorners> triangles,
                         std::span<const std::uint32_t> mates, std::uint32_t h);

}  // namespace locvol
