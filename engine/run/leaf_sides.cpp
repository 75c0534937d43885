#include "engine/run/leaf_sides.h"

#include <cassert>
#include <utility>

namespace locvol {
namespace {

// The corner of a child in octant c that touches its parent's center.
constexpr int inner_corner(int octant) { return 7 - octant; }

bool bit(std::uint8_t bits, int k) { return (bits >> k & 1) != 0; }

class SideSpreader {
 public:
  SideSpreader(const LinearOctree& octree, std::span<const std::uint8_t> parities)
      : octree_(octree), parities_(parities), sides_(octree.size()) {}

  // Finds the sides of all leaves under `node`, whose corner k has the given side. Returns the side
  // of the corner opposite to it, 7 - k.
  //
  // The child in octant k shares corner k with the node, and its opposite corner is the node's
  // center, which is a corner of each of the other seven.
  bool spread(MortonKey node, int k, bool is_corner_inside) {
    const auto leaves = octree_.leaves_under(node);
    if (leaves.front() == node) return settle(leaves, k, is_corner_inside);
    const bool is_center_inside = spread(node.child(k), k, is_corner_inside);
    bool is_opposite_inside = false;
    for (int octant = 0; octant < 8; ++octant) {
      if (octant == k) continue;
      const bool is_outer_inside =
          spread(node.child(octant), inner_corner(octant), is_center_inside);
      if (octant == 7 - k) is_opposite_inside = is_outer_inside;
    }
    return is_opposite_inside;
  }

  std::vector<bool> take_sides() { return std::move(sides_); }

 private:
  bool settle(std::span<const MortonKey> leaf, int k, bool is_corner_inside) {
    const auto i = static_cast<std::size_t>(leaf.data() - octree_.leaves().data());
    const bool is_center_inside = is_corner_inside != bit(parities_[i], k);
    sides_[i] = is_center_inside;
    return is_center_inside != bit(parities_[i], 7 - k);
  }

  const LinearOctree& octree_;
  std::span<const std::uint8_t> parities_;
  std::vector<bool> sides_;
};

}  // namespace

std::vector<bool> center_sides(const LinearOctree& octree, std::span<const std::uint8_t> parities) {
  assert(parities.size() == octree.size());
  SideSpreader spreader(octree, parities);
  spreader.spread(MortonKey::root(), 0, false);
  return spreader.take_sides();
}

std::vector<bool> center_sides_of_children(bool is_center_inside,
                                           std::span<const std::uint8_t, 8> parities) {
  std::vector<bool> sides(8);
  for (int octant = 0; octant < 8; ++octant) {
    const auto i = static_cast<std::size_t>(octant);
    sides[i] = is_center_inside != bit(parities[i], inner_corner(octant));
  }
  return sides;
}

}  // namespace locvol
