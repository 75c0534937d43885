// RunView is the run in memory for those who read it: what the store holds, with what the next
// commit will change.
//
// Threads: one at a time, for what is read fills the cache. A handle: copy it freely.
#pragma once

#include <optional>
#include <vector>

#include "engine/run/leaf_cache.h"
#include "engine/shared/lattice_of_run.h"
#include "octree/lattice.h"
#include "octree/octree.h"
#include "octree/shares.h"
#include "refine/leaf.h"
#include "storage/store.h"

namespace locvol {

// What the parts of a RunState have in common, and each changes a share of.
struct RunData {
  Store& store;
  std::optional<RankRecord> rank;  // absent: one process has all of the run
  Shares shares;
  RunRecord run;
  Lattice lattice;
  LinearOctree octree;
  EditedLeaves leaves;

  // A count of the leaf, in the run's total if the leaf is own.
  void put_count(MortonKey leaf, std::uint64_t LeafInfo::*count, std::uint64_t now,
                 std::uint64_t RunCounts::*total);
};

class RunView {
 public:
  explicit RunView(RunData& data) : data_(data) {}

  const Store& store() const { return data_.store; }
  const RunRecord& run() const { return data_.run; }
  const RunParameters& parameters() const { return run().parameters; }
  const Frame& frame() const { return run().frame; }
  const Lattice& lattice() const { return data_.lattice; }  // in paper mode without points
  const LinearOctree& octree() const { return data_.octree; }
  LeafCache& leaves() const { return data_.leaves; }  // to be read, and trimmed

  double size() const { return parameters().size; }  // λ: no more at the surface
  bool is_cover() const { return parameters().init == Initialization::kCover; }
  Box box(MortonKey leaf) const { return frame().box(leaf); }
  SiteBox sites(MortonKey leaf) const { return lattice().sites_in(box(leaf)); }
  MortonKey owner_of(const Point& p) const;  // throws RefineError: it lies outside the octree

  // Where several work on a run, a rank's store has, besides its own leaves, copies of those within
  // either's touch_distance() of them: what a visit changes there is told to it, so that its own
  // visits find what they read; their cells are not kept, but for mending. All else is empty
  // leaves, as large as the octree allows. Changes of those are dropped, and counts are of own
  // leaves.

  // kBeyond, too, of what is no leaf of the rank's octree.
  Holding holding(MortonKey leaf) const {
    return data_.rank && !octree().is_leaf(leaf) ? Holding::kBeyond : leaves().info(leaf).holding;
  }
  bool is_own(MortonKey leaf) const { return holding(leaf) == Holding::kOwn; }
  bool is_beyond(MortonKey leaf) const { return holding(leaf) == Holding::kBeyond; }
  // Other ranks that have it, or a copy, ascending.
  std::vector<int> others_holding(MortonKey leaf) const;

  bool is_uniform() const { return parameters().sizes().is_uniform(); }
  double size_at(const Point& p) const;  // h(p)
  // How far from any point of the leaf a ball through it reaches if its radius is at most k / 2
  // times h at its center.
  double reach_of(MortonKey leaf, double k) const;
  // Of h in the leaf, the least; and the largest on the surface there.
  double least_size(MortonKey leaf) const;
  double surface_size(MortonKey leaf) const;

 protected:
  RunData& data_;
};

}  // namespace locvol
