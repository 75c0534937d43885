// Triangles for a hole.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "octree/geometry.h"

namespace locvol {

// Triangles, by places in the loop, that have its edges on the loop's way, without new vertices.
// `beyond`: of each edge, the corner of its triangle that is not on it, or nothing. Empty: there
// are none that CGAL finds. REQUIRES: three points or more, all different
std::vector<std::array<std::uint32_t, 3>> triangles_in_loop(std::span<const Point> loop,
                                                            std::span<const Point> beyond);

// The middle of the loop's edges.
Point center_of_loop(std::span<const Point> loop);

}  // namespace locvol
