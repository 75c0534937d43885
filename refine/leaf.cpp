#include "refine/leaf.h"

#include <algorithm>

namespace locvol {

bool CoreIndex::has_within(const Point& q, double radius) const {
  std::vector<MeshPoint> near;
  within(q, radius, near);
  return std::ranges::any_of(
      near, [&](const MeshPoint& p) { return squared_distance(p.position, q) < radius * radius; });
}

void CoreIndex::append_met(const Point& q, double size, std::vector<std::uint64_t>& ids) const {
  std::vector<MeshPoint> near;
  within(q, kLatticeStar * size, near);
  for (const MeshPoint& p : near)
    if (changes_star(q - p.position, kLatticeSpacing * size)) ids.push_back(p.id);
}

}  // namespace locvol
