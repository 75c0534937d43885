// Records to bytes and back. codec.cpp is the only home of Boost.Serialization and zstd, and draws
// the byte formats.
#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "octree/morton_key.h"
#include "storage/records.h"

namespace locvol {

// The first record of every store: what reads it must know how all others are laid out, which is
// drawn in store.cpp.
struct StoreFormat {
  static constexpr std::uint32_t kCurrent = 6;
  std::uint32_t version = kCurrent;
  friend bool operator==(const StoreFormat&, const StoreFormat&) = default;
};

// Written by every commit, in its transaction: the sum modulo 2^64 of the key_hash() of all keys of
// each database but this record's own. LMDB has no checksums; a key that is damaged hides its
// record, and shows here.
struct KeySums {
  std::vector<std::uint64_t> sums;  // by Database
  friend bool operator==(const KeySums&, const KeySums&) = default;
};

// The bytes are not the record that was asked for. Says what is wrong; the caller knows where.
class DecodeError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// Equal records give equal bytes. `leaf` goes into the bytes, so that a record which turns up in
// another leaf's place is noticed; records that belong to no leaf take MortonKey().
// For StoreFormat, KeySums, RunRecord, LeafInfo, LeafPoints, LeafCells, LeafFacets,
// LeafSurface, LeafUnresolved, LeafSizes, QueueEntry, MemoryRecord, RankRecord, RankWords,
// RankResult, TimelineRecord and SurfaceSheets. Safe from many threads; as many zstd contexts are
// kept as were in use at once. REQUIRES: enumerators and conditions in range, indices into lists of
// vertices are below their lengths
template <class Record>
std::string encode(const Record& record, MortonKey leaf);

// Inverts encode(), coordinates bit by bit. Throws DecodeError on bytes that encode() did not make,
// or made for another leaf or kind of record; allocates in proportion to bytes.size() at most.
template <class Record>
Record decode(std::string_view bytes, MortonKey leaf);

}  // namespace locvol
