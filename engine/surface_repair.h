// Repairs of a triangle surface that leave the set of its points as it is.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "engine/surface_topology.h"
#include "engine/triangle_soup.h"

namespace locvol {

// All but find_collinear_triangles() return how much they dropped or changed; orders are kept.

// Triangles with two equal corners.
std::uint64_t drop_collapsed_triangles(TriangleSoup& soup);
// Of triangles with the same three vertices all but the first, where each edge of that one is
// then in exactly two triangles. Elsewhere all copies stay, for they are part of what is wrong.
std::uint64_t drop_repeated_triangles(TriangleSoup& soup);
// Vertices of no triangle.
std::uint64_t drop_unused_vertices(TriangleSoup& soup);

std::vector<std::uint32_t> find_collinear_triangles(const TriangleSoup& soup);

struct FlipResult {
  std::uint64_t num_flips = 0;
  std::optional<std::uint32_t> remaining;  // a triangle that could not be repaired
};

// Gives every collinear triangle an area: where its middle corner b lies on the edge ac, the
// triangle acd beyond that edge is cut at b, and acb, acd become bad, dcb. Keeps `pairing` in step.
// Fails where b and d are joined already.
// REQUIRES: a closed manifold pairing, consistent orientation; `collinear` as found above
FlipResult flip_collinear_triangles(TriangleSoup& soup, EdgePairing& pairing,
                                    std::vector<std::uint32_t> collinear);

}  // namespace locvol
