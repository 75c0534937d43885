// The global BCC lattice of cover mode (octree/README.md, "The lattice"): its points by integer
// indices, their ids, and its cells.
#pragma once

#include <algorithm>
#include <array>
#include <compare>
#include <cstdint>
#include <tuple>
#include <vector>

#include "octree/frame.h"
#include "octree/geometry.h"

namespace locvol {

inline constexpr double kLatticeSpacing = 1.75;  // a over λ

// Lengths over λ, with room for rounding and for the displacement of lattice points.
inline constexpr double kLatticeCircumradius = 0.979;             // of every cell: (√5/4) a
inline constexpr double kLatticeStar = 2 * kLatticeCircumradius;  // no other point this close to a
                                                                  // site: its star is the lattice's

// The point origin + a/2 (i, j, k); i, j, k are all even or all odd.
struct LatticeSite {
  std::int32_t i = 0, j = 0, k = 0;
  friend auto operator<=>(const LatticeSite&, const LatticeSite&) = default;
  friend LatticeSite operator+(const LatticeSite& a, const LatticeSite& b) {
    return {a.i + b.i, a.j + b.j, a.k + b.k};
  }
};

// Tells whether a point so far from a site (`offset`) lies in the circumball of one of the
// lattice's cells at the site, and so changes them; with room for rounding and for the
// displacement.
bool changes_star(const Point& offset, double spacing);

// The 14 neighbors of a site in the Delaunay triangulation of the lattice, as steps, ascending.
inline constexpr std::array<LatticeSite, 14> kLatticeNeighbors{{{-2, 0, 0},
                                                                {-1, -1, -1},
                                                                {-1, -1, 1},
                                                                {-1, 1, -1},
                                                                {-1, 1, 1},
                                                                {0, -2, 0},
                                                                {0, 0, -2},
                                                                {0, 0, 2},
                                                                {0, 2, 0},
                                                                {1, -1, -1},
                                                                {1, -1, 1},
                                                                {1, 1, -1},
                                                                {1, 1, 1},
                                                                {2, 0, 0}}};

// The six cells whose smallest site is the origin: their other sites. A cell has two edges of
// length a in different directions, each halfway around the other. Positively oriented.
using LatticeCell = std::array<LatticeSite, 3>;
inline constexpr std::array<LatticeCell, 6> kLatticeCells{{
    {{{2, 0, 0}, {1, 1, -1}, {1, 1, 1}}},
    {{{2, 0, 0}, {1, 1, 1}, {1, -1, 1}}},
    {{{2, 0, 0}, {1, -1, 1}, {1, -1, -1}}},
    {{{2, 0, 0}, {1, -1, -1}, {1, 1, -1}}},
    {{{0, 2, 0}, {1, 1, 1}, {1, 1, -1}}},
    {{{0, 0, 2}, {1, -1, 1}, {1, 1, 1}}},
}};

// All sites of kLatticeCells but the smallest one, ascending; and each cell's as places among them.
inline constexpr std::array<LatticeSite, 7> kLargerNeighbors{
    {{0, 0, 2}, {0, 2, 0}, {1, -1, -1}, {1, -1, 1}, {1, 1, -1}, {1, 1, 1}, {2, 0, 0}}};
inline constexpr std::array<std::array<std::uint8_t, 3>, 6> kCellsOfLargerNeighbors{
    {{6, 4, 5}, {6, 5, 3}, {6, 3, 2}, {6, 2, 4}, {1, 5, 4}, {0, 3, 5}}};

// The 24 cells at a site: their other sites as places in kLatticeNeighbors, so that the cells are
// positively oriented with the site first.
inline constexpr std::array<std::array<std::uint8_t, 3>, 24> kCellsAtSite = [] {
  // Even permutations, each with another corner first.
  constexpr std::array<std::array<std::size_t, 4>, 4> kOrders{
      {{0, 1, 2, 3}, {1, 0, 3, 2}, {2, 3, 0, 1}, {3, 2, 1, 0}}};
  std::array<std::array<std::uint8_t, 3>, 24> cells{};
  std::size_t n = 0;
  for (const LatticeCell& cell : kLatticeCells) {
    const std::array<LatticeSite, 4> corners{LatticeSite{}, cell[0], cell[1], cell[2]};
    for (const auto& order : kOrders) {
      for (std::size_t k = 0; k < 3; ++k) {
        const LatticeSite &from = corners[order[0]], &to = corners[order[k + 1]];
        const LatticeSite step{to.i - from.i, to.j - from.j, to.k - from.k};
        while (kLatticeNeighbors[cells[n][k]] != step) ++cells[n][k];
      }
      ++n;
    }
  }
  return cells;
}();

// A box of sites: low <= index < high on each axis; may be empty.
struct SiteBox {
  LatticeSite low, high;
  bool contains(const LatticeSite& s) const {
    return low.i <= s.i && s.i < high.i && low.j <= s.j && s.j < high.j && low.k <= s.k &&
           s.k < high.k;
  }
  SiteBox expanded(std::int32_t n) const {
    return {{low.i - n, low.j - n, low.k - n}, {high.i + n, high.j + n, high.k + n}};
  }
  // The least box that holds both.
  SiteBox joined(const SiteBox& b) const {
    return {{std::min(low.i, b.low.i), std::min(low.j, b.low.j), std::min(low.k, b.low.k)},
            {std::max(high.i, b.high.i), std::max(high.j, b.high.j), std::max(high.k, b.high.k)}};
  }
  friend bool operator==(const SiteBox&, const SiteBox&) = default;
};

// The first index from `low` on that is even or odd as `parity` is.
inline std::int32_t first_of_parity(std::int32_t low, std::int32_t parity) {
  return low + ((low ^ parity) & 1);
}

// Calls visit(site) for each site of the box, in lexicographic order.
template <class Visit>
void for_each_site(const SiteBox& box, Visit visit) {
  for (std::int32_t i = box.low.i; i < box.high.i; ++i)
    for (std::int32_t j = first_of_parity(box.low.j, i); j < box.high.j; j += 2)
      for (std::int32_t k = first_of_parity(box.low.k, i); k < box.high.k; k += 2)
        visit(LatticeSite{i, j, k});
}

// The sites (i, j, k + 2 m), 0 <= m < count, of one body.
struct LatticeRow {
  LatticeSite first;
  std::uint32_t count = 0;
  BodyId body = kOnlyBody;
  friend bool operator==(const LatticeRow&, const LatticeRow&) = default;
};

// Calls visit(row) for pieces of the box's rows, in lexicographic order: first a row, then the rest
// of it that begins after as many sites as the call before has returned, until none is left.
template <class Visit>
void for_each_piece(const SiteBox& box, Visit visit) {
  for (std::int32_t i = box.low.i; i < box.high.i; ++i)
    for (std::int32_t j = first_of_parity(box.low.j, i); j < box.high.j; j += 2)
      for (std::int32_t k = first_of_parity(box.low.k, i); k < box.high.k;) {
        const LatticeRow rest{{i, j, k}, static_cast<std::uint32_t>(box.high.k - k + 1) / 2};
        const std::uint32_t num_done = visit(rest);
        k += 2 * static_cast<std::int32_t>(num_done);
      }
}

// Points of a leaf that are known by their places in the lattice alone (engine/run/README.md,
// "The lattice core").
struct LatticeCore {
  bool is_whole = false;         // all sites in the leaf's box; then there are no rows
  std::vector<LatticeRow> rows;  // in lexicographic order, as few as can be
  BodyId body = kOnlyBody;       // of all sites, if it is whole
  bool is_empty() const { return !is_whole && rows.empty(); }
  friend bool operator==(const LatticeCore&, const LatticeCore&) = default;
};

// REQUIRES: rows come in lexicographic order
void add_row(const LatticeRow& row, LatticeCore& core);
// What is not of the leaf's box is damage: throws std::invalid_argument. So is a row that does not
// come after the one before it. `sites`: of the leaf's box
void check_core(const LatticeCore& core, const SiteBox& sites);
std::uint64_t num_sites(const SiteBox& box);
// The part of the core in a box that lies in the leaf's.
LatticeCore clipped(const LatticeCore& core, const SiteBox& box);
// Without one site, which must be of it; `sites`: of the leaf's box
LatticeCore without(const LatticeCore& core, const SiteBox& sites, const LatticeSite& site);
std::uint64_t num_points(const LatticeCore& core, const SiteBox& sites);

// Calls visit(row, number of points in the rows before) for each row, in order. A core that is
// whole has a row for each (i, j). `sites`: of the leaf's box
template <class Visit>
void for_each_row(const LatticeCore& core, const SiteBox& sites, Visit visit) {
  std::uint64_t num_before = 0;
  const auto pass = [&](const LatticeRow& row) {
    visit(row, num_before);
    num_before += row.count;
  };
  if (!core.is_whole) {
    for (const LatticeRow& row : core.rows) pass(row);
    return;
  }
  for (std::int32_t i = sites.low.i; i < sites.high.i; ++i)
    for (std::int32_t j = first_of_parity(sites.low.j, i); j < sites.high.j; j += 2) {
      const std::int32_t k = first_of_parity(sites.low.k, i);
      if (k < sites.high.k)
        pass({{i, j, k}, static_cast<std::uint32_t>(sites.high.k - k + 1) / 2, core.body});
    }
}

// Coordinates come from the indices by one expression, so that all leaves get the same bits.
//
// Each point is moved by up to 2^-18 a along each axis, a function of (i, j, k): on the exact
// lattice, common planes and spheres send predicates to exact arithmetic, and a triangulation takes
// 2.5 times as long. It is too little to change the lattice's cells: the circumball of each has no
// other lattice point within 1.6 times its radius. Coordinates close to a plane between leaves stay
// where they are, so that a leaf's points are those of a box of indices.
class Lattice {
 public:
  static constexpr double kDisplacement = 0x1p-17;  // at most, over a/2

  Lattice() = default;  // not valid
  // `size`: λ. REQUIRES: leaves have sides of at least min_leaf_side
  Lattice(const Frame& frame, double size, double min_leaf_side);
  // The lattice of corners and centers of the octree's cubes, down to those of level 19 ("Sizes
  // that vary"). Sites are positions on the grid of level 20, from 0 on, and no point is displaced.
  static Lattice of_cubes(const Frame& frame);

  Point position(const LatticeSite& site) const;
  MeshPoint point(const LatticeSite& site) const;
  Point position_of(std::uint64_t id) const { return position(site(id)); }
  // The id that a site's point has; it is below kFirstOtherId.
  std::uint64_t id(const LatticeSite& site) const;
  LatticeSite site(std::uint64_t id) const;
  // The sites with box.min <= position < box.max on each axis. REQUIRES: an octree leaf's box; for
  // any other, sites within the displacement of its faces may be on the wrong side.
  SiteBox sites_in(const Box& box) const;
  // The sites whose points are within `radius` of q, lexicographically.
  void sites_within(const Point& q, double radius, std::vector<LatticeSite>& out) const;
  // The place that says on which side of planes between leaves the site lies.
  Point undisplaced(const LatticeSite& site) const;
  // The site closest to q, but for displacements; at most kLatticeCircumradius times the size away.
  LatticeSite nearest(const Point& q) const;
  double spacing() const { return 2 * half_; }
  // The size that the cells are made for: their circumradii are kLatticeCircumradius times it. It
  // is λ in uniform runs.
  double size() const { return spacing() / kLatticeSpacing; }
  friend bool operator==(const Lattice&, const Lattice&) = default;
  // What makes it up, for those who store or send it. `lattice`: a Lattice or a const one
  template <class Self>
  static auto members(Self& lattice) {
    return std::tie(lattice.origin_, lattice.grid_origin_, lattice.half_, lattice.grid_side_,
                    lattice.is_of_cubes_);
  }

 private:
  double coordinate(int axis, std::int32_t index, std::uint64_t noise) const;
  std::int32_t first_index_from(int axis, double bound) const;

  Point origin_, grid_origin_;
  double half_ = 0, grid_side_ = 0;
  bool is_of_cubes_ = false;
};

// Sites as ids of points: in their order, and below those of all other points.
inline constexpr std::uint64_t kFirstOtherId = std::uint64_t{1} << 61;
inline constexpr std::int32_t kMaxSiteIndex = (1 << 20) - 1;  // and at least minus it
std::uint64_t site_id(const LatticeSite& site);
LatticeSite site_of(std::uint64_t id);  // REQUIRES: id < kFirstOtherId
// Tells whether the point's id says which site it is. Lattice points of stores of old have ids like
// all others, and no core.
inline bool has_site(const MeshPoint& p) {
  return p.kind == PointKind::kLattice && p.id < kFirstOtherId;
}

}  // namespace locvol
