#include "engine/run/leaf_queue.h"

#include <cassert>

namespace locvol {

LeafQueue::LeafQueue(const Reader& reader) {
  reader.for_each_queued([&](const QueueEntry& entry) {
    entries_.emplace_hint(entries_.end(), Place{entry.position, entry.leaf}, entry.dirty);
    ++num_in_epoch_[entry.position.epoch];
    return true;
  });
}

std::size_t LeafQueue::num_in_epoch(std::uint32_t epoch) const {
  const auto num = num_in_epoch_.find(epoch);
  return num == num_in_epoch_.end() ? 0 : num->second;
}

QueuePosition LeafQueue::front() const {
  assert(!is_empty());
  return entries_.begin()->first.first;
}

std::vector<MortonKey> LeafQueue::front_leaves() const {
  std::vector<MortonKey> leaves;
  for (const auto& [place, dirty] : entries_) {
    if (place.first != front()) break;
    leaves.push_back(place.second);
  }
  return leaves;
}

std::vector<QueuePlace> LeafQueue::front_epoch() const {
  std::vector<QueuePlace> places;
  for (const auto& [place, dirty] : entries_) {
    if (place.first.epoch != front().epoch) break;
    places.push_back({place.first, place.second});
  }
  return places;
}

void LeafQueue::put(const QueueEntry& entry) {
  const Place place{entry.position, entry.leaf};
  if (entries_.insert_or_assign(place, entry.dirty).second) ++num_in_epoch_[entry.position.epoch];
  changed_.insert(place);
}

void LeafQueue::grow(QueuePosition position, MortonKey leaf, const Box& dirty) {
  const auto entry = entries_.find({position, leaf});
  assert(entry != entries_.end());
  const Box joined = entry->second.joined(dirty);
  if (joined == entry->second) return;
  entry->second = joined;
  changed_.insert(entry->first);
}

void LeafQueue::move(QueuePosition from, QueuePosition to, MortonKey leaf) {
  const auto entry = entries_.find({from, leaf});
  assert(entry != entries_.end());
  const Box dirty = entry->second;
  erase(from, leaf);
  put({to, leaf, dirty});
}

void LeafQueue::erase(QueuePosition position, MortonKey leaf) {
  const Place place{position, leaf};
  [[maybe_unused]] const auto num_erased = entries_.erase(place);
  assert(num_erased == 1);
  if (--num_in_epoch_[position.epoch] == 0) num_in_epoch_.erase(position.epoch);
  changed_.insert(place);
}

void LeafQueue::write_to(Batch& batch) {
  for (const Place& place : changed_) {
    const auto entry = entries_.find(place);
    if (entry == entries_.end())
      batch.erase_queue_entry(place.first, place.second);
    else
      batch.put_queue_entry({place.first, place.second, entry->second});
  }
  changed_.clear();
}

}  // namespace locvol
