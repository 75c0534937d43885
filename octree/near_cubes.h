// Which cubes of an octree of sizes are near a box, without a look at each.
#pragma once

#include <algorithm>
#include <cstddef>
#include <span>

#include "octree/frame.h"
#include "octree/geometry.h"
#include "octree/morton_key.h"
#include "octree/size_field.h"

namespace locvol {

// Calls visit(cube) in order for all that are no farther than `distance` from the box, and for some
// others. `cubes`: in Morton order, none in another; those in the node or the one around it
template <class Visit>
void for_each_cube_near(const Frame& frame, MortonKey node, std::span<const SizeCube> cubes,
                        const Box& box, double distance, const Visit& visit) {
  constexpr std::size_t kFew = 4;  // are looked at, each
  if (cubes.size() <= kFew) {
    for (const SizeCube& cube : cubes) visit(cube);
    return;
  }
  if (box.squared_distance(frame.box(node)) > distance * distance) return;
  for (int octant = 0; octant < 8; ++octant) {
    const MortonKey child = node.child(octant);
    const auto end = std::ranges::upper_bound(
        cubes, child.range_max(), {}, [](const SizeCube& cube) { return cube.key.range_max(); });
    const auto num = static_cast<std::size_t>(end - cubes.begin());
    for_each_cube_near(frame, child, cubes.first(num), box, distance, visit);
    cubes = cubes.subspan(num);
  }
}

}  // namespace locvol
