// Which rank's each leaf is: leaves in Morton order are cut into one interval a rank.
#pragma once

#include <span>
#include <vector>

#include "octree/frame.h"
#include "octree/geometry.h"
#include "octree/key_range.h"
#include "octree/morton_key.h"

namespace locvol {

// A value, the same on all ranks: 8 bytes a rank. Leaves that are split leave their parts with the
// rank.
class Shares {
 public:
  // The shares of a run by one rank, which has all.
  Shares() : first_{MortonKey::root().range_min()} {}
  // `first`: of each rank's leaves the first; ranks without leaves have that of the next, those at
  // the end may have MortonKey::root().range_max(). REQUIRES: ascending, the first of all leaves is
  // the first rank's
  explicit Shares(std::vector<MortonKey> first);
  // Leaves of about equal cost for each; `costs`: of the leaves, which are all, in Morton order.
  static Shares of_equal_cost(std::span<const MortonKey> leaves, std::span<const double> costs,
                              int num_ranks);

  int num_ranks() const { return static_cast<int>(first_.size()); }
  const std::vector<MortonKey>& first() const { return first_; }  // as the constructor takes it
  int owner_of(MortonKey leaf) const;
  KeyRange range_of(int rank) const;
  // The largest nodes that are all of the rank's, in Morton order.
  std::vector<MortonKey> nodes_of(int rank) const;
  // Ranks that a leaf within the distance of the box belongs to, or may if it is split, ascending.
  std::vector<int> ranks_within(const Frame& frame, const Box& box, double distance) const;

  friend bool operator==(const Shares&, const Shares&) = default;

 private:
  std::vector<MortonKey> first_;  // keys of the finest level
};

}  // namespace locvol
