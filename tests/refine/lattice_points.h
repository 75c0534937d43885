// All lattice points of a cover, those of the core too.
#pragma once

#include <algorithm>
#include <set>
#include <vector>

#include "octree/site_block.h"
#include "refine/core_index.h"
#include "refine/cover_leaf.h"

namespace locvol {

inline std::vector<LatticeSite> core_sites(const LatticeCore& core, const SiteBox& sites) {
  std::vector<LatticeSite> found;
  for_each_core_site(core, sites, sites,
                     [&](const LatticeSite& site, std::uint64_t) { found.push_back(site); });
  return found;
}

// In lexicographic order.
inline std::vector<LatticeSite> lattice_sites(const CoverPoints& cover, const SiteBox& sites) {
  std::vector<LatticeSite> found = core_sites(cover.core, sites);
  found.insert(found.end(), cover.lattice.begin(), cover.lattice.end());
  std::sort(found.begin(), found.end());
  return found;
}

inline std::vector<Point> positions(const Lattice& lattice, const std::vector<LatticeSite>& sites) {
  std::vector<Point> points;
  for (const LatticeSite& site : sites) points.push_back(lattice.position(site));
  return points;
}

// Ascending sites as a visit is given them.
inline CoreRows core_rows(const Lattice& lattice, const std::set<LatticeSite>& sites) {
  LatticeCore core;
  for (const LatticeSite& site : sites) add_row({site, 1}, core);
  return {lattice, core.rows};
}

// Of a surface in one leaf of some octree, which holds it all.
inline Lattice lattice_around(const Box& box, double size) {
  return {Frame::around(box, 0, 4 * size), size, 2 * size};
}

}  // namespace locvol
