#include "engine/run/core_around.h"

#include <algorithm>
#include <array>

#include "octree/site_block.h"

namespace locvol {
namespace {

MortonKey leaf_of(const RunView& state, const LatticeSite& site) {
  return state.octree().leaf_owning(state.frame(), state.lattice().undisplaced(site));
}

bool is_whole_all_around(const RunView& state, MortonKey leaf) {
  const double star = kLatticeStar * core_size(state.parameters());
  return std::ranges::all_of(
      state.octree().leaves_within(state.frame(), state.box(leaf), star),
      [&](MortonKey other) { return state.leaves().points(other).core.is_whole; });
}

// How many of a site's six cells there are; bit n: larger neighbor n is there.
constexpr auto kNumCells = [] {
  std::array<std::uint8_t, std::size_t{1} << kLargerNeighbors.size()> num{};
  for (std::size_t larger = 0; larger < num.size(); ++larger)
    for (const auto& [a, b, c] : kCellsOfLargerNeighbors)
      if (larger >> a & larger >> b & larger >> c & 1) ++num[larger];
  return num;
}();

LatticeSite negated(const LatticeSite& s) { return {-s.i, -s.j, -s.k}; }

}  // namespace

CoreRows core_around(const RunView& state, MortonKey leaf, double distance) {
  const Box box = state.box(leaf);
  const SiteBox around = state.lattice().sites_in(box.expanded(distance));
  CoreRows core{.lattice = state.lattice(), .rows = {}};
  for (const MortonKey other : state.octree().leaves_within(state.frame(), box, distance))
    for_each_core_row(state.leaves().points(other).core, state.sites(other), around,
                      [&](const LatticeRow& row, std::uint64_t) { core.rows.push_back(row); });
  return core;
}

std::uint64_t num_core_cells(const RunView& state, MortonKey leaf) {
  const std::uint64_t num_points = state.leaves().info(leaf).num_core_points;
  if (num_points == 0) return 0;
  if (is_whole_all_around(state, leaf)) return kLatticeCells.size() * num_points;
  const CoreIndex around(core_around(state, leaf, kLatticeStar * core_size(state.parameters())));
  const SiteBox sites = state.sites(leaf);
  std::uint64_t num_cells = 0;
  for_each_core_site(state.leaves().points(leaf).core, sites, sites,
                     [&](const LatticeSite& site, std::uint64_t) {
                       std::size_t larger = 0;
                       for (std::size_t n = 0; n < kLargerNeighbors.size(); ++n)
                         larger |= std::size_t{around.contains(site + kLargerNeighbors[n])} << n;
                       num_cells += kNumCells[larger];
                     });
  return num_cells;
}

bool is_core(const RunView& state, const LatticeSite& site) {
  if (!state.frame().contains(state.lattice().undisplaced(site))) return false;
  const MortonKey leaf = leaf_of(state, site);
  bool is_found = false;
  for_each_core_site(state.leaves().points(leaf).core, state.sites(leaf),
                     {site, site + LatticeSite{1, 1, 1}},
                     [&](const LatticeSite&, std::uint64_t) { is_found = true; });
  return is_found;
}

void list_core_point(RunState& state, const LatticeSite& site) {
  state.points().list_core_point(leaf_of(state, site), site);
}

void make_explicit(RunState& state, const LatticeSite& site) {
  // Its cells of the core's points are to be listed from now on. Each is one of six, seen from one
  // of its four vertices.
  for (const LatticeCell& cell : kLatticeCells) {
    const std::array<LatticeSite, 4> corners{LatticeSite{}, cell[0], cell[1], cell[2]};
    for (const LatticeSite& corner : corners) {
      const LatticeSite smallest = site + negated(corner);
      if (!std::ranges::all_of(corners,
                               [&](const LatticeSite& s) { return is_core(state, smallest + s); }))
        continue;
      const MortonKey leaf = leaf_of(state, smallest);
      state.records().put_num_core_cells(leaf, state.leaves().info(leaf).num_core_cells - 1);
    }
  }
  list_core_point(state, site);
  const Point place = state.lattice().position(site);
  for (const MortonKey other : state.octree().leaves_within(
           state.frame(), Box::around(place), kNeighborhood * core_size(state.parameters())))
    state.records().ask_for_visit(other, place);
}

}  // namespace locvol
