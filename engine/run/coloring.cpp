#include "engine/run/coloring.h"

#include <algorithm>
#include <cassert>
#include <functional>
#include <limits>
#include <numeric>

namespace locvol {
namespace {

// The smallest number that is not in `used`.
std::uint32_t smallest_free(std::vector<std::uint32_t>& used) {
  std::ranges::sort(used);
  std::uint32_t color = 0;
  for (const std::uint32_t c : used) {
    if (c > color) break;
    if (c == color) ++color;
  }
  return color;
}

}  // namespace

std::vector<std::uint32_t> color_leaves(const LinearOctree& octree, const Frame& frame,
                                        std::span<const MortonKey> leaves, double distance,
                                        const StopToken* stop) {
  assert(std::ranges::is_sorted(leaves));
  std::vector<std::uint32_t> colors;
  colors.reserve(leaves.size());
  std::vector<std::uint32_t> used;
  for (const MortonKey leaf : leaves) {
    throw_if_stopped(stop);
    assert(octree.is_leaf(leaf));
    const auto earlier = leaves.first(colors.size());
    used.clear();
    for (const MortonKey other : octree.leaves_within(frame, frame.box(leaf), distance)) {
      if (other >= leaf) break;
      const auto place = std::ranges::lower_bound(earlier, other);
      if (place != earlier.end() && *place == other)
        used.push_back(colors[static_cast<std::size_t>(place - earlier.begin())]);
    }
    colors.push_back(smallest_free(used));
  }
  return colors;
}

std::vector<std::uint32_t> color_leaves(const LinearOctree& octree, const Frame& frame,
                                        std::span<const LeafToColor> leaves,
                                        const StopToken* stop) {
  assert(std::ranges::is_sorted(leaves, {}, &LeafToColor::leaf));
  std::vector<std::vector<std::uint32_t>> near(leaves.size());  // of the others of each, by place
  for (std::uint32_t i = 0; i < leaves.size(); ++i) {
    throw_if_stopped(stop);
    const MortonKey leaf = leaves[i].leaf;
    for (const MortonKey other : octree.leaves_within(frame, frame.box(leaf), leaves[i].distance)) {
      const auto place = std::ranges::lower_bound(leaves, other, {}, &LeafToColor::leaf);
      if (place == leaves.end() || place->leaf != other || other == leaf) continue;
      const auto k = static_cast<std::uint32_t>(place - leaves.begin());
      near[i].push_back(k);
      near[k].push_back(i);
    }
  }
  std::vector<std::uint32_t> order(leaves.size());
  std::iota(order.begin(), order.end(), 0U);
  std::ranges::stable_sort(order, std::greater(),
                           [&](std::uint32_t i) { return leaves[i].weight; });
  constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
  std::vector<std::uint32_t> colors(leaves.size(), kNone), used;
  for (const std::uint32_t i : order) {
    used.clear();
    for (const std::uint32_t k : near[i])
      if (colors[k] != kNone) used.push_back(colors[k]);
    colors[i] = smallest_free(used);
  }
  return colors;
}

}  // namespace locvol
