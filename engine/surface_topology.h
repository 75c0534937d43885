// Which triangles are neighbors: the combinatorial side of a triangle surface.
//
// Half-edge 3 t + k runs from corner k of triangle t to the next one.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "engine/triangle_soup.h"

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

struct EdgePairing {
  std::vector<std::uint32_t>
      mates;  // by half-edge; kNoHalfEdge unless its edge is in two triangles
  std::uint64_t num_border_edges = 0;    // in one triangle
  std::uint64_t num_overused_edges = 0;  // in three or more
  std::uint32_t first_border = kNoHalfEdge, first_overused = kNoHalfEdge;

  bool is_closed_manifold() const { return num_border_edges == 0 && num_overused_edges == 0; }
};

// Memory: 24 bytes a triangle, beside the result.
EdgePairing pair_edges(std::size_t num_vertices, std::span<const TriangleCorners> triangles);

struct Components {
  std::vector<std::uint32_t> of_triangle;  // numbered by their first triangles
  std::uint32_t count = 0;
  std::vector<bool> is_turned;  // by triangle: its orientation differs from its component's first
  std::uint32_t conflict = kNoHalfEdge;  // where no orientation is consistent, if anywhere
};

// REQUIRES: pairing.is_closed_manifold()
Components find_components(std::span<const TriangleCorners> triangles, const EdgePairing& pairing);

// Reverses the orientation of the marked triangles and keeps the pairing in step.
void turn_triangles(const std::vector<bool>& is_turned, std::span<TriangleCorners> triangles,
                    EdgePairing& pairing);

struct PinchedVertices {
  std::uint64_t count = 0;
  std::uint32_t first = 0;
};

// The vertices whose triangles form more than one fan.
// REQUIRES: a closed manifold pairing and consistent orientation
PinchedVertices find_pinched_vertices(std::size_t num_vertices,
                                      std::span<const TriangleCorners> triangles,
                                      const EdgePairing& pairing);

}  // namespace locvol
