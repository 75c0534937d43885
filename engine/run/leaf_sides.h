// On which side of the surface the center of each leaf's box lies, found without rays through the
// model.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "octree/octree.h"

namespace locvol {

// Element i: does the center of octree.leaves()[i] lie inside? `parities[i]` is the leaf's
// center_to_corner_parities(). The sides spread from the root's corners, which lie outside, from
// leaf to leaf through the corners that they share: each segment stays inside one leaf.
// REQUIRES: one parity byte for each leaf, a closed surface inside the root box
std::vector<bool> center_sides(const LinearOctree& octree, std::span<const std::uint8_t> parities);

// The sides of the centers of a leaf's eight children, for a leaf whose center's side is known.
// `parities[c]` are the child's own.
std::vector<bool> center_sides_of_children(bool is_center_inside,
                                           std::span<const std::uint8_t, 8> parities);

}  // namespace locvol
