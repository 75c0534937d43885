// LeafQueue is the store's queue in memory, in queue order: (epoch, color, Morton key).
//
// A leaf waits at one place at most. The entries of an epoch have kNoColor until the epoch opens.
// Nothing joins the open epoch, so its order is settled when it opens.
// Memory: about 70 bytes a waiting leaf.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <map>
#include <set>
#include <vector>

#include "storage/store.h"

namespace locvol {

inline constexpr std::uint32_t kNoColor = std::numeric_limits<std::uint32_t>::max();

class LeafQueue {
 public:
  explicit LeafQueue(const Reader& reader);  // what the store holds

  bool is_empty() const { return entries_.empty(); }
  std::size_t size() const { return entries_.size(); }
  std::size_t num_in_epoch(std::uint32_t epoch) const;
  template <class Predicate>
  std::size_t count_if(const Predicate& is_counted) const {
    return static_cast<std::size_t>(std::ranges::count_if(entries_, is_counted, &QueueEntry::leaf));
  }
  QueuePosition front() const;  // REQUIRES: !is_empty()
  // The leaves at the front that share its epoch and color, in Morton order: independent of each
  // other, once colored. REQUIRES: !is_empty()
  std::vector<MortonKey> front_leaves() const;
  // All that wait in the epoch at the front, in queue order. REQUIRES: !is_empty()
  std::vector<QueueEntry> front_epoch() const;

  void put(const QueueEntry& entry);
  void erase(const QueueEntry& entry);  // REQUIRES: it is there

  void write_to(Batch& batch);  // what changed since the last time

 private:
  std::set<QueueEntry> entries_, changed_;
  std::map<std::uint32_t, std::size_t> num_in_epoch_;
};

}  // namespace locvol
