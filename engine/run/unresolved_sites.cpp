#include "engine/run/unresolved_sites.h"

#include <cstdint>

#include "engine/run/point_grid.h"

namespace locvol {

std::vector<UnresolvedSite> thinned(const std::vector<UnresolvedSite>& sites,
                                    const std::vector<UnresolvedSite>& kept, double distance) {
  PointGrid taken(distance);
  std::uint64_t id = 0;
  const auto take = [&](const UnresolvedSite& site) {
    taken.insert({id++, site.position, PointKind::kSurface});
  };
  const auto is_none_gone = [](std::uint64_t) { return false; };
  for (const UnresolvedSite& site : kept) take(site);
  std::vector<UnresolvedSite> result;
  for (const UnresolvedSite& site : sites) {
    if (taken.nearest(site.position, distance, is_none_gone)) continue;
    take(site);
    result.push_back(site);
  }
  return result;
}

}  // namespace locvol
