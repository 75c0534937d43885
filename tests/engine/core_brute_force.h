// The lattice core of a store, point by point and cell by cell. Shares no table of neighbors or
// cells with what it judges.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <set>
#include <stdexcept>
#include <utility>
#include <vector>

#include "engine/run/run_state.h"
#include "octree/lattice.h"
#include "octree/site_block.h"
#include "storage/store.h"

namespace locvol {

using SiteCell = std::array<LatticeSite, 4>;

inline int squared_length(const LatticeSite& a, const LatticeSite& b) {
  const int i = a.i - b.i, j = a.j - b.j, k = a.k - b.k;
  return i * i + j * j + k * k;
}

// A cell has two edges of length a, without a common end; its other four join a corner of a cube to
// its center. In units of a/2: lengths 2 and √3.
inline bool is_lattice_cell(const SiteCell& c) {
  const auto is_pair = [&](std::size_t a, std::size_t b) {
    return squared_length(c[a], c[b]) == 4;
  };
  const auto is_diagonal = [&](std::size_t a, std::size_t b) {
    return squared_length(c[a], c[b]) == 3;
  };
  for (const auto& [a, b, u, v] :
       {std::array<std::size_t, 4>{0, 1, 2, 3}, {0, 2, 1, 3}, {0, 3, 1, 2}})
    if (is_pair(a, b) && is_pair(u, v) && is_diagonal(a, u) && is_diagonal(a, v) &&
        is_diagonal(b, u) && is_diagonal(b, v))
      return true;
  return false;
}

inline int six_volumes(const SiteCell& c) {
  const auto difference = [&](std::size_t n) {
    return Point{double(c[n].i - c[0].i), double(c[n].j - c[0].j), double(c[n].k - c[0].k)};
  };
  return static_cast<int>(dot(cross(difference(1), difference(2)), difference(3)));
}

// The cells whose smallest site this is, all of whose sites are in the set; positively oriented.
inline std::vector<SiteCell> cells_from(const LatticeSite& site,
                                        const std::set<LatticeSite>& sites) {
  std::vector<LatticeSite> larger;
  for (int i = 0; i <= 2; ++i)
    for (int j = -2; j <= 2; ++j)
      for (int k = -2; k <= 2; ++k) {
        const LatticeSite other = site + LatticeSite{i, j, k};
        if (site < other && sites.contains(other)) larger.push_back(other);
      }
  std::vector<SiteCell> cells;
  for (std::size_t a = 0; a < larger.size(); ++a)
    for (std::size_t b = a + 1; b < larger.size(); ++b)
      for (std::size_t c = b + 1; c < larger.size(); ++c) {
        SiteCell cell{site, larger[a], larger[b], larger[c]};
        if (!is_lattice_cell(cell)) continue;
        if (six_volumes(cell) < 0) std::swap(cell[2], cell[3]);
        cells.push_back(cell);
      }
  return cells;
}

struct CoreByBruteForce {
  std::set<LatticeSite> sites;
  std::vector<SiteCell> cells;
  std::map<MortonKey, std::uint64_t> num_points, num_cells;  // of leaves that have some

  // `core_of(leaf)`: of its record
  template <class CoreOf>
  CoreByBruteForce(const RunRecord& run, const std::vector<MortonKey>& leaves,
                   const CoreOf& core_of) {
    const Lattice lattice = lattice_of(run);
    for (const MortonKey leaf : leaves) {
      const SiteBox box = lattice.sites_in(run.frame.box(leaf));
      const LatticeCore core = core_of(leaf);
      check_core(core, box);
      for_each_core_site(core, box, box, [&](const LatticeSite& site, std::uint64_t) {
        sites.insert(site);
        ++num_points[leaf];
      });
    }
    const LinearOctree octree(leaves);
    for (const LatticeSite& site : sites) {
      const std::vector<SiteCell> from_here = cells_from(site, sites);
      if (from_here.empty()) continue;
      num_cells[octree.leaf_owning(run.frame, lattice.position(site))] += from_here.size();
      cells.insert(cells.end(), from_here.begin(), from_here.end());
    }
  }
};

// All cells of a run, each as the ids of its vertices, ascending; those of the core too. Throws
// std::runtime_error if one comes twice.
inline std::set<std::array<std::uint64_t, 4>> all_cells(const Reader& reader) {
  const std::vector<MortonKey> leaves = reader.leaf_keys();
  std::set<std::array<std::uint64_t, 4>> cells;
  const auto add = [&](std::array<std::uint64_t, 4> ids) {
    std::ranges::sort(ids);
    if (!cells.insert(ids).second) throw std::runtime_error("a cell comes twice");
  };
  for (const MortonKey leaf : leaves) {
    const LeafCells stored = reader.cells(leaf);
    for (const auto& [a, b, c, d] : stored.cells)
      add({stored.vertices[a], stored.vertices[b], stored.vertices[c], stored.vertices[d]});
  }
  const CoreByBruteForce core(*reader.run(), leaves,
                              [&](MortonKey leaf) { return reader.points(leaf).core; });
  for (const auto& [a, b, c, d] : core.cells) add({site_id(a), site_id(b), site_id(c), site_id(d)});
  return cells;
}

}  // namespace locvol
