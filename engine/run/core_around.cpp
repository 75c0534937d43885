#include "engine/run/core_around.h"

#include <algorithm>
#include <array>

namespace locvol {
namespace {

MortonKey leaf_of(const RunState& state, const LatticeSite& site) {
  return state.octree().leaf_owning(state.run().frame, state.lattice().undisplaced(site));
}

bool is_whole_all_around(RunState& state, MortonKey leaf) {
  const double star = kLatticeStar * state.size();
  return std::ranges::all_of(
      state.octree().leaves_within(state.run().frame, state.box(leaf), star),
      [&](MortonKey other) { return state.leaves().points(other).core.is_whole; });
}

// How many of a site's six cells there are; bit n: larger neighbor n is there.
constexpr auto kNumCells = [] {
  std::array<std::uint8_t, std::size_t{1} << kLargerNeighbors.size()> num{};
  for (std::size_t larger = 0; larger < num.size(); ++larger)
    for (const auto& [a, b, c] : kCellsOfLargerNeighbors)
      num[larger] += larger >> a & larger >> b & larger >> c & 1;
  return num;
}();

LatticeSite negated(const LatticeSite& s) { return {-s.i, -s.j, -s.k}; }

}  // namespace

CoreAround::CoreAround(RunState& state, MortonKey leaf, double distance)
    : lattice_(state.lattice()) {
  const Box box = state.box(leaf);
  const SiteBox around = lattice_.sites_in(box.expanded(distance));
  for (const MortonKey other : state.octree().leaves_within(state.run().frame, box, distance)) {
    const LatticeCore& core = state.leaves().points(other).core;
    if (core.is_empty()) continue;
    if (is_empty_) is_core_ = {around, 0};
    is_empty_ = false;
    for_each_core_site(core, state.sites(other), around,
                       [&](const LatticeSite& site, std::uint64_t) { is_core_[site] = 1; });
  }
}

std::vector<MeshPoint> CoreAround::points() const {
  std::vector<MeshPoint> points;
  for_each_site(is_core_.box(), [&](const LatticeSite& site) {
    if (contains(site)) points.push_back(lattice_.point(site));
  });
  return points;
}

void CoreAround::within(const Point& q, double radius, std::vector<MeshPoint>& out) const {
  out.clear();
  std::vector<LatticeSite> sites;
  lattice_.sites_within(q, radius, sites);
  for (const LatticeSite& site : sites)
    if (contains(site)) out.push_back(lattice_.point(site));
}

// No lattice point is closer than the nearest. Displacements are far below what any distance here
// decides by.
bool CoreAround::has_within(const Point& q, double radius) const {
  const LatticeSite site = lattice_.nearest(q);
  return contains(site) && squared_distance(lattice_.undisplaced(site), q) < radius * radius;
}

std::uint64_t num_core_cells(RunState& state, MortonKey leaf) {
  const std::uint64_t num_points = state.leaves().info(leaf).num_core_points;
  if (num_points == 0) return 0;
  if (is_whole_all_around(state, leaf)) return kLatticeCells.size() * num_points;
  const CoreAround around(state, leaf, kLatticeStar * state.size());
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

bool is_core(RunState& state, const LatticeSite& site) {
  if (!state.run().frame.contains(state.lattice().undisplaced(site))) return false;
  const MortonKey leaf = leaf_of(state, site);
  bool is_found = false;
  for_each_core_site(state.leaves().points(leaf).core, state.sites(leaf),
                     {site, site + LatticeSite{1, 1, 1}},
                     [&](const LatticeSite&, std::uint64_t) { is_found = true; });
  return is_found;
}

void list_core_point(RunState& state, const LatticeSite& site) {
  state.list_core_point(leaf_of(state, site), site);
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
      state.put_num_core_cells(leaf, state.leaves().info(leaf).num_core_cells - 1);
    }
  }
  list_core_point(state, site);
  const Box around = Box::around(state.lattice().position(site));
  for (const MortonKey other :
       state.octree().leaves_within(state.run().frame, around, kNeighborhood * state.size())) {
    if (state.leaves().info(other).num_points == 0) continue;
    state.enqueue(other);
    state.require_whole_visit(other);
  }
}

}  // namespace locvol
