#include "octree/octree.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cstdint>
#include <functional>
#include <stdexcept>
#include <string>
#include <utility>

namespace locvol {
namespace {

using Leaves = std::span<const MortonKey>;

// Is `next` the node right after `node` in the root, with no gap? The finest keys are the odd
// numbers; the comparison keeps the first of all from following the last.
bool follows(MortonKey node, MortonKey next) {
  return node < next && next.range_min().bits() - node.range_max().bits() == 2;
}

// Appends the leaves of `node` within the distance. `leaves` are all those under `node`.
void collect_within(const Frame& frame, MortonKey node, Leaves leaves, const Box& box,
                    double squared_distance, std::vector<MortonKey>& found) {
  if (frame.box(node).squared_distance(box) > squared_distance) return;
  if (leaves.front() == node) {
    found.push_back(node);
    return;
  }
  for (int octant = 0; octant < 8; ++octant) {
    const MortonKey child = node.child(octant);
    const auto end = std::ranges::upper_bound(leaves, child.range_max());
    collect_within(frame, child, Leaves(leaves.begin(), end), box, squared_distance, found);
    leaves = Leaves(end, leaves.end());
  }
}

void complete(MortonKey node, Leaves leaves, std::vector<MortonKey>& octree) {
  if (leaves.empty() || leaves.front() == node) return octree.push_back(node);
  for (int octant = 0; octant < 8; ++octant) {
    const MortonKey child = node.child(octant);
    const auto end = std::ranges::upper_bound(leaves, child.range_max());
    complete(child, {leaves.begin(), end}, octree);
    leaves = {end, leaves.end()};
  }
}

}  // namespace

LinearOctree::LinearOctree(std::vector<MortonKey> leaves) : leaves_(std::move(leaves)) {
  const auto invalid = std::ranges::find_if_not(leaves_, &MortonKey::is_valid);
  if (invalid != leaves_.end())
    throw std::invalid_argument("octree: " + std::to_string(invalid->bits()) + " is not a key");
  const auto gap = std::ranges::adjacent_find(leaves_, std::not_fn(follows));
  if (gap != leaves_.end())
    throw std::invalid_argument("octree: leaf " + std::to_string((gap + 1)->bits()) +
                                " does not begin where leaf " + std::to_string(gap->bits()) +
                                " ends");
  if (leaves_.empty() || leaves_.front().range_min() != MortonKey::root().range_min() ||
      leaves_.back().range_max() != MortonKey::root().range_max())
    throw std::invalid_argument("octree: the leaves do not cover the root");
}

LinearOctree LinearOctree::coarsest_with(std::span<const MortonKey> leaves) {
  std::vector<MortonKey> octree;
  complete(MortonKey::root(), leaves, octree);
  return LinearOctree(std::move(octree));
}

LinearOctree LinearOctree::uniform(int level) {
  assert(0 <= level && level <= MortonKey::kMaxLevel);
  LinearOctree octree;
  octree.leaves_.resize(std::size_t{1} << (3 * level));
  const int marker_bit = 3 * (MortonKey::kMaxLevel - level);
  for (std::uint64_t i = 0; i < octree.leaves_.size(); ++i)
    octree.leaves_[i] = MortonKey::from_bits((i << 1 | 1) << marker_bit);
  return octree;
}

bool LinearOctree::is_leaf(MortonKey key) const { return std::ranges::binary_search(leaves_, key); }

MortonKey LinearOctree::leaf_at(MortonKey key) const {
  assert(key.is_valid());
  return *std::ranges::lower_bound(leaves_, key.range_min(), {}, &MortonKey::range_max);
}

std::span<const MortonKey> LinearOctree::leaves_under(MortonKey node) const {
  const auto first = std::ranges::lower_bound(leaves_, node.range_min());
  return {first, std::ranges::upper_bound(first, leaves_.end(), node.range_max())};
}

std::vector<MortonKey> LinearOctree::leaves_within(const Frame& frame, const Box& box,
                                                   double distance) const {
  std::vector<MortonKey> found;
  if (distance >= 0)
    collect_within(frame, MortonKey::root(), leaves_, box, distance * distance, found);
  return found;
}

void LinearOctree::split(MortonKey leaf) {
  assert(is_leaf(leaf) && leaf.level() < MortonKey::kMaxLevel);
  const auto place = std::ranges::lower_bound(leaves_, leaf);
  *place = leaf.child(0);
  std::array<MortonKey, 7> others;
  for (int octant = 1; octant < 8; ++octant)
    others[static_cast<std::size_t>(octant - 1)] = leaf.child(octant);
  leaves_.insert(place + 1, others.begin(), others.end());
}

}  // namespace locvol
