// Does a segment cross a triangle, and what does it come upon there? Exact, and consistent over all
// triangles of a closed surface (see leaf_domain.h). Internal to refine/domain.
#pragma once

#include "octree/domain_state.h"
#include "octree/geometry.h"

namespace locvol {

// The query points are moved by the infinitesimal (ε, ε², ε³), so there is no "touches".
bool segment_crosses(const Point& a, const Point& b, const Triangle& triangle);

inline DomainState change_across(const Triangle& triangle) { return triangle.change; }
inline SheetId sheet_of(const Triangle& triangle) { return triangle.sheet; }

}  // namespace locvol
