#include "refine/core_index.h"

namespace locvol {
namespace {

SiteBox box_around(const std::vector<LatticeRow>& rows) {
  SiteBox box;
  for (const auto& [first, count, body] : rows) {
    const LatticeSite end = first + LatticeSite{1, 1, 2 * static_cast<std::int32_t>(count)};
    box = &first == &rows.front().first ? SiteBox{first, end} : box.joined({first, end});
  }
  return box;
}

}  // namespace

CoreIndex::CoreIndex(const CoreRows& core)
    : lattice_(core.lattice), is_core_(box_around(core.rows), 0), is_empty_(core.rows.empty()) {
  for (const auto& [first, count, body] : core.rows)
    for (std::int32_t n = 0; n < static_cast<std::int32_t>(count); ++n)
      is_core_[first + LatticeSite{0, 0, 2 * n}] = 1;
}

void CoreIndex::within(const Point& q, double radius, std::vector<MeshPoint>& out) const {
  out.clear();
  if (is_empty_) return;
  std::vector<LatticeSite> sites;
  lattice_.sites_within(q, radius, sites);
  for (const LatticeSite& site : sites)
    if (contains(site)) out.push_back(lattice_.point(site));
}

// No lattice point is closer than the nearest. Displacements are far below what any distance here
// decides by.
bool CoreIndex::has_within(const Point& q, double radius) const {
  if (is_empty_) return false;
  const LatticeSite site = lattice_.nearest(q);
  return contains(site) && squared_distance(lattice_.undisplaced(site), q) < radius * radius;
}

void CoreIndex::append_met(const Point& q, std::vector<std::uint64_t>& ids) const {
  std::vector<MeshPoint> near;
  within(q, kLatticeStar * size(), near);
  for (const MeshPoint& p : near)
    if (changes_star(q - p.position, lattice_.spacing())) ids.push_back(p.id);
}

}  // namespace locvol
