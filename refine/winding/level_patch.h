// The surface over holes: where the winding number passes 1/2. Internal to refine/winding.
#pragma once

#include <cstdint>

#include "octree/stop.h"
#include "refine/winding/chain.h"
#include "refine/winding/winding_number.h"

namespace locvol {

struct PatchCounts {
  std::uint64_t num_holes = 0;     // connected parts of open edges
  std::uint64_t largest_hole = 0;  // edges of it
  double area = 0;                 // of what closes them
};

// Closes the open edges of `kept`, whose triangles bound what is inside `number` at 1/2: holes that
// are wide by the level set on a grid of that spacing (by marching tetrahedra), the others, and
// what is left between grid and edges, by triangles without new vertices. Open edges are halved to
// the spacing. Afterwards the chain is closed. Throws Stopped.
PatchCounts close_by_level(Chain& kept, const WindingNumber& number, double spacing,
                           const StopToken* stop);

// Closes open edges by triangles without new vertices alone.
PatchCounts close_by_loops(Chain& chain);

}  // namespace locvol
