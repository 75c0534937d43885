// Gives triangles without area one, by flips of edges that leave the set of the surface's points as
// it is.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "engine/ingest/surface_topology.h"
#include "engine/ingest/triangle_soup.h"

namespace locvol {

// The most triangles without area whose neighborhoods are repaired in memory.
inline constexpr std::size_t kMaxCollinear = 200'000;

struct FlipResult {
  std::vector<std::uint32_t> changed;  // triangles, ascending
  // By triangle, the one whose place it has taken a part of; itself, where nothing changed.
  std::vector<std::uint32_t> taken_from;
  std::optional<std::uint32_t> remaining;  // a triangle that could not be repaired
  // Vertices with triangles beyond the piece that the repair must see: unless there are none, the
  // result is void.
  std::vector<std::uint32_t> beyond;
};

// Flips triangles without area. Where the middle corner b of such a triangle lies on its edge ac,
// the triangle acd beyond that edge is cut at b, and acb, acd become bad, dcb. It fails where b and
// d are joined already. `collinear`: the triangles to be repaired. `is_whole`: by vertex, are all
// its triangles here? REQUIRES: the soup is a piece of a closed, orientable surface with each edge
// in two triangles
FlipResult flip_collinear_triangles(TriangleSoup& soup, const std::vector<bool>& is_whole,
                                    std::vector<std::uint32_t> collinear);

}  // namespace locvol
