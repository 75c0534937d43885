#include "engine/run/coloring.h"

#include <algorithm>
#include <cassert>

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

}  // namespace locvol
