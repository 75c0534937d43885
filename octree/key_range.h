// KeyRange is a part of space that is one piece in Morton order.
#pragma once

#include <algorithm>
#include <optional>
#include <span>

#include "octree/morton_key.h"

namespace locvol {

// The cells of the finest level from `first` on, up to `end`, which is not among them; if that is
// absent, all that follow.
struct KeyRange {
  MortonKey first = MortonKey::root().range_min();
  std::optional<MortonKey> end = {};

  bool is_all() const { return first == MortonKey::root().range_min() && !end; }
  bool has_begin_of(MortonKey node) const {
    return first <= node.range_min() && (!end || node.range_min() < *end);
  }
  bool contains(MortonKey node) const {
    return first <= node.range_min() && (!end || node.range_max() < *end);
  }
  bool overlaps(MortonKey node) const {
    return has_begin_of(node) || (node.is_ancestor_or_self_of(first) && (!end || first < *end));
  }
  // The nodes that begin in the range. REQUIRES: they are in Morton order, none inside another
  std::span<const MortonKey> begun_of(std::span<const MortonKey> nodes) const {
    const auto from = std::ranges::lower_bound(nodes, first, {}, &MortonKey::range_min);
    const auto to =
        end ? std::ranges::lower_bound(nodes, *end, {}, &MortonKey::range_min) : nodes.end();
    return {from, to};
  }
  friend bool operator==(const KeyRange&, const KeyRange&) = default;
};

}  // namespace locvol
