#include "storage/mapped_pages.h"

#include <sys/mman.h>

namespace locvol {

void MappedPages::locate(const void* map, std::uint64_t map_bytes) {
  const std::lock_guard lock(mutex_);
  if (is_located()) return;
  const std::uint64_t num_blocks = map_bytes / kBlockBytes + 2;  // it may begin within a block
  num_words_ = num_blocks / 64 + 1;
  touched_ = std::make_unique<std::atomic<std::uint64_t>[]>(num_words_);
  map_bytes_ = map_bytes;
  map_ = reinterpret_cast<std::uintptr_t>(map);
}

void MappedPages::forget() {
  map_ = 0;
  num_touched_ = 0;
}

std::optional<std::uint64_t> MappedPages::offset_of(const void* place) const {
  const std::uintptr_t map = map_, address = reinterpret_cast<std::uintptr_t>(place);
  if (map == 0 || address < map || address - map >= map_bytes_) return std::nullopt;
  return address - map;
}

void MappedPages::note(const void* place, std::size_t bytes) {
  if (bytes == 0 || !offset_of(place)) return;
  const std::uintptr_t map = map_, begin = reinterpret_cast<std::uintptr_t>(place);
  const std::uint64_t last = (begin + bytes - 1) / kBlockBytes - map / kBlockBytes;
  for (std::uint64_t block = begin / kBlockBytes - map / kBlockBytes; block <= last; ++block) {
    std::atomic<std::uint64_t>& word = touched_[block / 64];
    const std::uint64_t bit = std::uint64_t{1} << block % 64;
    if ((word.load(std::memory_order_relaxed) & bit) == 0 && (word.fetch_or(bit) & bit) == 0)
      ++num_touched_;
  }
  if (this->bytes() > max_bytes_) release();
}

void MappedPages::release() {
  const std::lock_guard lock(mutex_);
  if (!is_located()) return;
  num_touched_ = 0;
  for (std::uint64_t i = 0; i < num_words_; ++i) touched_[i].store(0, std::memory_order_relaxed);
  // It cannot fail on a map; if it did, nothing but memory would be lost.
  madvise(reinterpret_cast<void*>(map_.load()), map_bytes_, MADV_DONTNEED);
}

std::uint64_t MappedPages::bytes() const { return num_touched_ * kBlockBytes; }

}  // namespace locvol
