#include "engine/run/run_view.h"

#include <algorithm>
#include <string>

namespace locvol {

void RunData::put_count(MortonKey leaf, std::uint64_t LeafInfo::*count, std::uint64_t now,
                        std::uint64_t RunCounts::*total) {
  LeafInfo& info = leaves.edit_info(leaf);
  if (info.holding == Holding::kOwn) run.counts.*total += now - info.*count;
  info.*count = now;
}

MortonKey RunView::owner_of(const Point& p) const {
  if (!frame().contains(p))
    throw RefineError("the point (" + std::to_string(p.x) + ", " + std::to_string(p.y) + ", " +
                      std::to_string(p.z) + ") lies outside the octree");
  return octree().leaf_owning(frame(), p);
}

std::vector<int> RunView::others_holding(MortonKey leaf) const {
  std::vector<int> ranks;
  for (const std::uint32_t rank : leaves().info(leaf).ranks)
    if (rank != data_.rank->rank) ranks.push_back(static_cast<int>(rank));
  return ranks;
}

double RunView::size_at(const Point& p) const {
  if (is_uniform()) return size();
  return locvol::size_at(parameters().sizes(), frame(), leaves().sizes(owner_of(p)).cubes, p);
}

double RunView::reach_of(MortonKey leaf, double k) const {
  return is_uniform() ? k * size()
                      : reach_factor(parameters().growth, k) * leaves().info(leaf).largest_size;
}

double RunView::least_size(MortonKey leaf) const {
  return is_uniform() ? size() : leaves().info(leaf).least_size;
}

// Balls at points of the leaf have centers where h may be a little larger.
double RunView::surface_size(MortonKey leaf) const {
  const RunParameters& p = parameters();
  if (!p.sizes().has_shapes()) return size();
  return std::min(size(), leaves().info(leaf).surface_size / (1 - 0.5 * kReach * p.growth));
}

}  // namespace locvol
