// The first points of P in paper mode (refine/ALGORITHM.md, "Two initializations").
#pragma once

#include <cstdint>
#include <vector>

#include "octree/geometry.h"
#include "refine/domain/leaf_domain.h"

namespace locvol {

// A few dozen points on each connected component of the surface, uniform by area: 30 shared out
// among the components and 12 more for each. A function of the surface and the seed alone. It is
// connected where triangles have corners of equal coordinates. REQUIRES: the domain is whole
std::vector<Point> scatter_on_surface(const LeafDomain& domain, std::uint64_t seed);

}  // namespace locvol
