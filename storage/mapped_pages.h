// MappedPages keeps the pages of a memory map that are in memory below a bound.
//
// What a process reads through a map of a file counts as its memory until it gives it back
// (madvise). The system tells nobody cheaply how much of a map that is. But it maps no more around
// a touched page than the 64 KB block it lies in (fault-around), so the blocks that were touched
// since the last time bound it from above. Giving back is harmless at any time, even under a
// reader: what is touched again is mapped again, from the page cache.
//
// Threads: all members from many at once, except forget().
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>

namespace locvol {

class MappedPages {
 public:
  static constexpr std::uint64_t kBlockBytes = std::uint64_t{64} << 10;

  explicit MappedPages(std::uint64_t max_bytes) : max_bytes_(max_bytes) {}

  bool is_located() const { return map_ != 0; }
  // From now on the map is here. A second call for the same map does nothing.
  void locate(const void* map, std::uint64_t map_bytes);
  void forget();  // the map is gone. REQUIRES: no other member is running

  // The place's distance from the map's beginning; absent: it is outside of the map.
  std::optional<std::uint64_t> offset_of(const void* place) const;
  // The bytes are being read. Places outside the map are left out of account.
  void note(const void* place, std::size_t bytes);
  void release();               // gives all back
  std::uint64_t bytes() const;  // in memory, at most

 private:
  const std::uint64_t max_bytes_;
  std::atomic<std::uintptr_t> map_ = 0;
  std::uint64_t map_bytes_ = 0;
  std::uint64_t num_words_ = 0;
  std::unique_ptr<std::atomic<std::uint64_t>[]> touched_;  // a bit for each block
  std::atomic<std::uint64_t> num_touched_ = 0;
  std::mutex mutex_;  // of locate() and release()
};

}  // namespace locvol
