// CoreAround is the lattice core in and around one leaf: which sites are points of P that no record
// lists.
#pragma once

#include <cstdint>
#include <vector>

#include "engine/run/run_state.h"
#include "octree/site_block.h"
#include "refine/refine_leaf.h"

namespace locvol {

// Memory: a byte a site.
class CoreAround : public CoreIndex {
 public:
  // Of the leaves within `distance` of the leaf, all sites at most that far away.
  CoreAround(RunState& state, MortonKey leaf, double distance);

  bool is_empty() const { return is_empty_; }
  bool contains(const LatticeSite& site) const override {
    return !is_empty_ && is_core_.box().contains(site) && is_core_[site] != 0;
  }
  std::vector<MeshPoint> points() const;  // all of them, in order of id
  void within(const Point& q, double radius, std::vector<MeshPoint>& out) const override;
  bool has_within(const Point& q, double radius) const override;

 private:
  const Lattice& lattice_;
  SiteBlock<std::uint8_t> is_core_;
  bool is_empty_ = true;
};

// How many cells the leaf has whose vertices are all of the core, the smallest one its own.
std::uint64_t num_core_cells(RunState& state, MortonKey leaf);

// Makes a point of the core one that the leaf's record lists, for it has a new neighbor: leaves at
// points around it are to be visited again, as a whole. REQUIRES: it is of the core
void make_explicit(RunState& state, const LatticeSite& site);
// The same of a point whose core's cells have not been counted, nor any listed.
void list_core_point(RunState& state, const LatticeSite& site);
bool is_core(RunState& state, const LatticeSite& site);

}  // namespace locvol
