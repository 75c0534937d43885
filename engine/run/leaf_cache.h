// LeafCache holds the decoded records of the leaves used last, and all changes that the next commit
// will write. It spares a visit the decoding of its 26 neighbors, and a leaf that several visits
// change is encoded once a commit.
//
// References stay valid until the leaf is erased or trim() is called.
// Memory: `max_bytes` for what is unchanged, plus the changes; trim() enforces it.
// Errors: StoreError when the store lacks a leaf or cannot be read.
#pragma once

#include <cstddef>
#include <optional>
#include <set>
#include <vector>

#include "engine/shared/recent_map.h"
#include "octree/table_hash.h"
#include "storage/store.h"

namespace locvol {

class LeafCache {
 public:
  LeafCache(const Store& store, std::size_t max_bytes) : store_(store), max_bytes_(max_bytes) {}

  const LeafInfo& info(MortonKey leaf);
  const LeafPoints& points(MortonKey leaf);
  const LeafSurface& surface(MortonKey leaf);
  const LeafSizes& sizes(MortonKey leaf);
  LeafCells cells(MortonKey leaf);            // not kept
  LeafFacets facets(MortonKey leaf);          // likewise
  LeafUnresolved unresolved(MortonKey leaf);  // likewise

  // Of what is unchanged; to be enforced by the next trim().
  void set_max_bytes(std::size_t max_bytes) { max_bytes_ = max_bytes; }

  void trim();  // lets go of the least recently used

  std::size_t unwritten_bytes() const;  // decoded, roughly

 protected:
  LeafInfo& edit_info(MortonKey leaf);
  LeafPoints& edit_points(MortonKey leaf);
  void put_cells(MortonKey leaf, LeafCells cells);
  void put_facets(MortonKey leaf, LeafFacets facets);
  void put_unresolved(MortonKey leaf, LeafUnresolved unresolved);
  void put_sizes(MortonKey leaf, LeafSizes sizes);
  // A leaf that the store has not had before.
  void add_leaf(MortonKey leaf, const LeafInfo& info, LeafPoints points, LeafSurface surface);
  void erase_leaf(MortonKey leaf);  // with all its records
  void write_to(Batch& batch);      // the changes, in Morton order

 private:
  // A record as decoded, and whether the store has yet to see it.
  template <class Record>
  struct Cached {
    std::optional<Record> record;
    bool is_changed = false;
  };
  struct Entry {
    Cached<LeafInfo> info;
    Cached<LeafPoints> points;
    Cached<LeafSurface> surface;
    Cached<LeafSizes> sizes;
    Cached<LeafCells> cells;            // only until they are written
    Cached<LeafFacets> facets;          // likewise
    Cached<LeafUnresolved> unresolved;  // likewise
    std::size_t bytes() const;
  };

  static constexpr std::size_t kEntryBytes = sizeof(Entry) + 64;  // and what the containers add

  // A record that is kept once it was read.
  template <class Record>
  const Record& kept(MortonKey leaf, Cached<Record> Entry::*which,
                     Record (Reader::*read)(MortonKey) const);
  Entry& touch(MortonKey leaf);  // the leaf's entry, now the most recently used
  Entry& touch_changed(MortonKey leaf);
  static void write(Batch& batch, MortonKey leaf, Entry& entry);

  const Store& store_;
  std::size_t max_bytes_;
  std::size_t most_bytes_ = 0;  // the unchanged records take no more
  RecentMap<MortonKey, Entry, TableHash> entries_;
  std::set<MortonKey> changed_;  // leaves with a record to write
  std::set<MortonKey> erased_;   // leaves to erase from the store
};

// The same for the parts of a RunState, which make all changes and keep what is counted of them.
class EditedLeaves : public LeafCache {
 public:
  using LeafCache::add_leaf;
  using LeafCache::edit_info;
  using LeafCache::edit_points;
  using LeafCache::erase_leaf;
  using LeafCache::LeafCache;
  using LeafCache::put_cells;
  using LeafCache::put_facets;
  using LeafCache::put_sizes;
  using LeafCache::put_unresolved;
  using LeafCache::write_to;
};

}  // namespace locvol
