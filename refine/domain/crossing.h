// Does a segment cross a triangle? Exact, and consistent over all triangles of a closed surface
// (see leaf_domain.h). Internal to refine/.
#pragma once

#include "octree/geometry.h"

namespace locvol {

// The query points are moved by the infinitesimal (ε, ε², ε³), so there is no "touches".
bool segment_crosses(const Point& a, const Point& b, const Triangle& triangle);

}  // namespace locvol
