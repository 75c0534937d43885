// The lattice core around a leaf (engine/run/README.md): points of P that a visit need not load,
// unless it inserts near them. All cells at them are the lattice's: no other point lies in their
// circumballs, which reach kLatticeStar times its size, and their neighbors are of P.
#pragma once

#include <cstdint>
#include <vector>

#include "octree/geometry.h"
#include "octree/lattice.h"
#include "octree/site_block.h"

namespace locvol {

// CoreRows has the sites of the core: a value, which can be stored and sent.
struct CoreRows {
  Lattice lattice;
  std::vector<LatticeRow> rows;  // each site once
  friend bool operator==(const CoreRows&, const CoreRows&) = default;
};

// Looks up core points. Memory: a byte a site of the box around the rows.
class CoreIndex {
 public:
  explicit CoreIndex(const CoreRows& core);

  bool is_empty() const { return is_empty_; }
  bool contains(const LatticeSite& site) const {
    return is_core_.box().contains(site) && is_core_[site] != 0;
  }
  // The points of the core at most `radius` from q, in order of id.
  void within(const Point& q, double radius, std::vector<MeshPoint>& out) const;
  // Tells whether a point of the core is closer to q than `radius`. REQUIRES: radius <= 2 size(),
  // and no other point of P is
  bool has_within(const Point& q, double radius) const;
  // Appends the ids of those at which a point inserted at q changes cells.
  void append_met(const Point& q, std::vector<std::uint64_t>& ids) const;
  double size() const { return lattice_.size(); }  // of the lattice: λ in uniform runs

 private:
  Lattice lattice_;
  SiteBlock<std::uint8_t> is_core_;
  bool is_empty_;
};

}  // namespace locvol
