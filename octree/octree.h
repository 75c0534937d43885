// LinearOctree is the set of leaves of an octree, sorted in Morton order: any mix of levels, and
// together they cover the root exactly once.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "octree/frame.h"
#include "octree/geometry.h"
#include "octree/morton_key.h"

namespace locvol {

class LinearOctree {
 public:
  LinearOctree() : leaves_{MortonKey::root()} {}
  // Throws std::invalid_argument unless the keys are sorted and cover the root exactly once.
  explicit LinearOctree(std::vector<MortonKey> leaves);
  // The coarsest that has all of these among its leaves. REQUIRES: they are in Morton order, none
  // inside another
  static LinearOctree coarsest_with(std::span<const MortonKey> leaves);
  static LinearOctree uniform(int level);  // 8^level leaves; REQUIRES: 0 <= level <= kMaxLevel

  std::span<const MortonKey> leaves() const { return leaves_; }
  std::size_t size() const { return leaves_.size(); }
  bool is_leaf(MortonKey key) const;
  // The leaf that is `key` or an ancestor of it; of a node that is split further, the first leaf
  // below it. REQUIRES: key is valid
  MortonKey leaf_at(MortonKey key) const;
  MortonKey leaf_owning(const Frame& frame, const Point& p) const {
    return leaf_at(frame.key_of(p));
  }
  // Leaves under `node` (itself, if it is a leaf), in Morton order; none if it lies in a larger
  // leaf.
  std::span<const MortonKey> leaves_under(MortonKey node) const;
  // Leaves whose closed box is at most `distance` from `box` (Euclidean), in Morton order.
  std::vector<MortonKey> leaves_within(const Frame& frame, const Box& box, double distance) const;

  void split(
      MortonKey leaf);  // into its eight children; REQUIRES: is_leaf(leaf), level < kMaxLevel

 private:
  std::vector<MortonKey> leaves_;
};

}  // namespace locvol
