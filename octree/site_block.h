// SiteBlock is a dense table of values at the lattice sites of a box.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "octree/lattice.h"

namespace locvol {

// Memory: one value a site, and those of a layer more.
template <class Value>
class SiteBlock {
 public:
  SiteBlock() = default;
  SiteBlock(const SiteBox& box, const Value& value)
      : box_(box),
        low_j_(box.low.j & ~1),
        low_k_(box.low.k & ~1),
        num_j_(length(low_j_, box.high.j)),
        num_k_(length(low_k_, box.high.k)),
        values_(static_cast<std::size_t>(std::max(0, box.high.i - box.low.i)) * num_j_ * num_k_,
                value) {}

  const SiteBox& box() const { return box_; }
  // REQUIRES: the site is in the box
  Value& operator[](const LatticeSite& site) { return values_[index(site)]; }
  const Value& operator[](const LatticeSite& site) const { return values_[index(site)]; }

 private:
  static std::size_t length(std::int32_t low, std::int32_t high) {
    return high > low ? static_cast<std::size_t>(high - low + 1) / 2 : 0;
  }
  // j and k are halved: i tells whether they are odd.
  std::size_t index(const LatticeSite& s) const {
    return (static_cast<std::size_t>(s.i - box_.low.i) * num_j_ +
            static_cast<std::size_t>(s.j - low_j_) / 2) *
               num_k_ +
           static_cast<std::size_t>(s.k - low_k_) / 2;
  }

  SiteBox box_;
  std::int32_t low_j_ = 0, low_k_ = 0;
  std::size_t num_j_ = 0, num_k_ = 0;
  std::vector<Value> values_;
};

// Calls visit(row, number of points of the core before it) for what of each row of a leaf's core
// lies in `part`, in order. `sites`: of the leaf's box
template <class Visit>
void for_each_core_row(const LatticeCore& core, const SiteBox& sites, const SiteBox& part,
                       Visit visit) {
  for_each_row(core, sites, [&](const LatticeRow& row, std::uint64_t num_before) {
    const auto& [i, j, k] = row.first;
    if (i < part.low.i || i >= part.high.i || j < part.low.j || j >= part.high.j) return;
    const std::int32_t low = std::max(k, first_of_parity(part.low.k, k));
    const std::int32_t high = std::min(k + 2 * static_cast<std::int32_t>(row.count), part.high.k);
    if (low < high)
      visit(LatticeRow{{i, j, low}, static_cast<std::uint32_t>(high - low + 1) / 2, row.body},
            num_before + static_cast<std::uint64_t>(low - k) / 2);
  });
}

// Calls visit(site, number of points of the core before it) for each point, in the order of
// for_each_core_row().
template <class Visit>
void for_each_core_site(const LatticeCore& core, const SiteBox& sites, const SiteBox& part,
                        Visit visit) {
  for_each_core_row(core, sites, part, [&](const LatticeRow& row, std::uint64_t num_before) {
    const auto& [i, j, k] = row.first;
    for (std::uint32_t n = 0; n < row.count; ++n)
      visit(LatticeSite{i, j, k + 2 * static_cast<std::int32_t>(n)}, num_before + n);
  });
}

// The body of each point of a leaf's core. `sites`: of the leaf's box
inline SiteBlock<BodyId> bodies_of_core(const LatticeCore& core, const SiteBox& sites) {
  SiteBlock<BodyId> bodies(sites, kNoBody);
  for_each_row(core, sites, [&](const LatticeRow& row, std::uint64_t) {
    for (std::int32_t n = 0; n < static_cast<std::int32_t>(row.count); ++n)
      bodies[row.first + LatticeSite{0, 0, 2 * n}] = row.body;
  });
  return bodies;
}

// Calls visit(site, cell) for each lattice cell whose smallest site is one of `part`, and whose
// sites are all of the core. `is_core(site)` is asked of sites up to two beyond the part.
template <class IsCore, class Visit>
void for_each_core_cell(const SiteBox& part, IsCore is_core, Visit visit) {
  for_each_site(part, [&](const LatticeSite& site) {
    if (!is_core(site)) return;
    for (const LatticeCell& cell : kLatticeCells)
      if (is_core(site + cell[0]) && is_core(site + cell[1]) && is_core(site + cell[2]))
        visit(site, cell);
  });
}

}  // namespace locvol
