// Does a triangle meet a box? Decided exactly.
#pragma once

#include "octree/geometry.h"

namespace locvol {

// Do the closed triangle, which may be flat, and the closed box have a point in common? So the
// cells of any subdivision of a box have among them just the triangles that meet the box.
bool touches(const Triangle& triangle, const Box& box);

}  // namespace locvol
