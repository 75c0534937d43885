// How a store is opened, and how large it is.
#pragma once

#include <cstdint>
#include <string>

namespace locvol {

struct StoreOptions {
  bool create = false;  // make the directory and an empty store if there is none
  bool read_only = false;
  bool is_durable = true;  // false only in tests and benchmarks that measure what durability costs
  // Address space to begin with, not memory; doubled when full, halved if there is not so much.
  std::uint64_t map_bytes = std::uint64_t{64} << 30;
  // Bound on the pages of the map that are in memory (Store::mapped_bytes()): beyond it, all are
  // given back to the system, which costs less than what was read to get there. A directory that
  // is open already in this process keeps its bound.
  std::uint64_t memory_bytes = std::uint64_t{8} << 20;
};

// Bytes on disk and entries of one named database; a record of points, cells, surface or unresolved
// sites is one entry per chunk of 4,080 bytes.
struct DatabaseSize {
  std::string name;
  std::uint64_t bytes = 0;
  std::uint64_t num_entries = 0;
};

}  // namespace locvol
