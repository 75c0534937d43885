#include "engine/run/leaf_states.h"

#include <cassert>
#include <utility>

namespace locvol {
namespace {

// The corner of a child in octant c that touches its parent's center.
constexpr int inner_corner(int octant) { return 7 - octant; }

class StateSpreader {
 public:
  StateSpreader(const LinearOctree& octree, std::span<const CornerStates> corners)
      : octree_(octree), corners_(corners), states_(octree.size()) {}

  // Finds the states of all leaves under `node`, whose corner k has the given one. Returns that of
  // the corner opposite to it, 7 - k.
  //
  // The child in octant k shares corner k with the node, and its opposite corner is the node's
  // center, which is a corner of each of the other seven.
  DomainState spread(MortonKey node, int k, DomainState corner) {
    const auto leaves = octree_.leaves_under(node);
    if (leaves.front() == node) return settle(leaves, k, corner);
    const DomainState center = spread(node.child(k), k, corner);
    DomainState opposite;
    for (int octant = 0; octant < 8; ++octant) {
      if (octant == k) continue;
      const DomainState outer = spread(node.child(octant), inner_corner(octant), center);
      if (octant == 7 - k) opposite = outer;
    }
    return opposite;
  }

  std::vector<DomainState> take_states() { return std::move(states_); }

 private:
  DomainState settle(std::span<const MortonKey> leaf, int k, DomainState corner) {
    const auto i = static_cast<std::size_t>(leaf.data() - octree_.leaves().data());
    states_[i] = corner.crossed(corners_[i][k]);
    return states_[i].crossed(corners_[i][7 - k]);
  }

  const LinearOctree& octree_;
  std::span<const CornerStates> corners_;
  std::vector<DomainState> states_;
};

}  // namespace

std::vector<DomainState> center_states(const LinearOctree& octree,
                                       std::span<const CornerStates> corners) {
  assert(corners.size() == octree.size());
  StateSpreader spreader(octree, corners);
  spreader.spread(MortonKey::root(), 0, {});
  return spreader.take_states();
}

std::array<DomainState, 8> center_states_of_children(DomainState center,
                                                     const std::array<CornerStates, 8>& corners) {
  std::array<DomainState, 8> states;
  for (int octant = 0; octant < 8; ++octant) {
    const auto i = static_cast<std::size_t>(octant);
    states[i] = center.crossed(corners[i][inner_corner(octant)]);
  }
  return states;
}

}  // namespace locvol
