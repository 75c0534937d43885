// The first points of P in paper mode (refine/ALGORITHM.md, "Two initializations").
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "octree/geometry.h"

namespace locvol {

// A few dozen points on each connected component of the surface, uniform by area: 30 shared out
// among the components and 12 more for each. A function of the triangles and the seed alone.
// `triangles`: a closed surface; triangles are connected where corners have equal coordinates.
std::vector<Point> scatter_on_surface(std::span<const Triangle> triangles, std::uint64_t seed);

}  // namespace locvol
