// Which side of a closed surface is inside: nesting of its components, and the volume they bound.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "engine/surface_topology.h"
#include "octree/geometry.h"

namespace locvol {

struct SignedVolume {
  double value = 0;
  bool is_certain = false;  // its sign is beyond rounding errors
};

// The volume that each component encloses, positive if it faces outward. REQUIRES: consistent
// orientation within each component
std::vector<SignedVolume> component_volumes(std::span<const Point> vertices,
                                            std::span<const TriangleCorners> triangles,
                                            const Components& components);

// By component: does it lie inside an odd number of others, and so bounds a cavity? Decided
// exactly. REQUIRES: the surface is closed and does not intersect itself
std::vector<bool> find_cavities(std::span<const Point> vertices,
                                std::span<const TriangleCorners> triangles,
                                const Components& components);

}  // namespace locvol
