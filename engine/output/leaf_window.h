// What writer, statistics and audit share to stream over the leaves of a finished store in bounded
// memory.
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <utility>

#include "engine/shared/recent_map.h"
#include "storage/store.h"

namespace locvol {

// The first place from `from` on whose value is not less, in ascending values. Fast where it is
// near.
template <class Iterator>
Iterator first_not_less(Iterator from, Iterator end, std::uint64_t value) {
  std::ptrdiff_t step = 1;
  for (; step < end - from && from[step - 1] < value; step *= 2) from += step;
  return std::lower_bound(from, from + std::min(step, end - from), value);
}

// Calls visit(i, j) for each ids[i] == table[j]. Both ascend; where one has nothing of the other's
// it is leapt over.
template <class Visit>
void for_each_common(std::span<const std::uint64_t> ids, std::span<const std::uint64_t> table,
                     Visit visit) {
  auto id = ids.begin();
  auto place = table.begin();
  while (id != ids.end()) {
    place = first_not_less(place, table.end(), *id);
    if (place == table.end()) return;
    if (*place == *id)
      visit(id++ - ids.begin(), place - table.begin());
    else
      id = first_not_less(id, ids.end(), *place);
  }
}

// Keeps the values last asked for, by the leaf's place in Morton order, up to a number of bytes;
// the others are made again when they are needed. In Morton order, a few dozen leaves are nearly
// all that come back soon. REQUIRES: Value has bytes(), its size in memory.
template <class Value>
class LeafWindow {
 public:
  using Make = std::function<Value(std::size_t leaf)>;

  LeafWindow(std::size_t max_bytes, Make make) : max_bytes_(max_bytes), make_(std::move(make)) {}

  // The value outlives its place in the window.
  std::shared_ptr<const Value> get(std::size_t leaf) {
    if (const auto* const held = values_.find(leaf)) return *held;
    const auto value = values_.add(leaf, std::make_shared<const Value>(make_(leaf)));
    for (bytes_ += bytes_of(*value); bytes_ > max_bytes_; values_.erase_oldest())
      bytes_ -= bytes_of(*values_.oldest());
    return value;
  }

 private:
  static std::size_t bytes_of(const Value& value) {
    constexpr std::size_t kEntryBytes = 128;  // list and map nodes
    return value.bytes() + kEntryBytes;
  }

  std::size_t max_bytes_, bytes_ = 0;
  Make make_;
  RecentMap<std::size_t, std::shared_ptr<const Value>> values_;
};

// Gives the store's mapped pages back to the system each time enough has been read: they count as
// memory of the process.
class PageRelease {
 public:
  explicit PageRelease(const Store& store) : store_(&store) {}
  void count(std::uint64_t bytes_read) {
    bytes_ += bytes_read;
    if (bytes_ < kBytesBetween) return;
    store_->release_pages();
    bytes_ = 0;
  }

 private:
  static constexpr std::uint64_t kBytesBetween = std::uint64_t{32} << 20;
  const Store* store_;
  std::uint64_t bytes_ = 0;
};

}  // namespace locvol
