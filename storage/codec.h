// Records to bytes and back. codec.cpp is the only home of Boost.Serialization and zstd, and draws
// the byte formats.
#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>

#include "octree/morton_key.h"
#include "storage/records.h"

namespace locvol {

// The first record of every store: what reads it must know how all others are laid out.
struct StoreFormat {
  static constexpr std::uint32_t kCurrent = 1;
  std::uint32_t version = kCurrent;
  friend bool operator==(const StoreFormat&, const StoreFormat&) = default;
};

// The bytes are not the record that was asked for. Says what is wrong; the caller knows where.
class DecodeError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// Equal records give equal bytes. `leaf` goes into the bytes, so that a record which turns up in
// another leaf's place is noticed; records that belong to no leaf take MortonKey().
// For StoreFormat, RunRecord, LeafInfo, LeafPoints, LeafCells, LeafSurface, LeafUnresolved,
// QueueEntry and MemoryRecord. Safe from many threads; a thread keeps its zstd contexts (about
// 1 MB) until it ends.
// REQUIRES: enumerators and conditions in range, LeafCells::cells index LeafCells::vertices
template <class Record>
std::string encode(const Record& record, MortonKey leaf);

// Inverts encode(), coordinates bit by bit. Throws DecodeError on bytes that encode() did not make,
// or made for another leaf or kind of record; allocates in proportion to bytes.size() at most.
template <class Record>
Record decode(std::string_view bytes, MortonKey leaf);

}  // namespace locvol
