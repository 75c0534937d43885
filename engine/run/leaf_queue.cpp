#include "engine/run/leaf_queue.h"

#include <cassert>

namespace locvol {

LeafQueue::LeafQueue(const Reader& reader) {
  reader.for_each_queued([&](const QueueEntry& entry) {
    entries_.insert(entries_.end(), entry);
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
  return entries_.begin()->position;
}

std::vector<MortonKey> LeafQueue::front_leaves() const {
  std::vector<MortonKey> leaves;
  for (const QueueEntry& entry : entries_) {
    if (entry.position != front()) break;
    leaves.push_back(entry.leaf);
  }
  return leaves;
}

std::vector<QueueEntry> LeafQueue::front_epoch() const {
  std::vector<QueueEntry> entries;
  for (const QueueEntry& entry : entries_) {
    if (entry.position.epoch != front().epoch) break;
    entries.push_back(entry);
  }
  return entries;
}

void LeafQueue::put(const QueueEntry& entry) {
  if (entries_.insert(entry).second) ++num_in_epoch_[entry.position.epoch];
  changed_.insert(entry);
}

void LeafQueue::erase(const QueueEntry& entry) {
  [[maybe_unused]] const auto num_erased = entries_.erase(entry);
  assert(num_erased == 1);
  if (--num_in_epoch_[entry.position.epoch] == 0) num_in_epoch_.erase(entry.position.epoch);
  changed_.insert(entry);
}

void LeafQueue::write_to(Batch& batch) {
  for (const QueueEntry& entry : changed_) {
    if (entries_.contains(entry))
      batch.put_queue_entry(entry);
    else
      batch.erase_queue_entry(entry);
  }
  changed_.clear();
}

}  // namespace locvol
