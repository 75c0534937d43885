#include "engine/run/leaf_cache.h"

#include <cassert>
#include <utility>

#include "engine/shared/leaf_name.h"

namespace locvol {
namespace {

template <class T>
std::size_t vector_bytes(const std::vector<T>& v) {
  return v.size() * sizeof(T);
}

std::size_t bytes_of(const LeafPoints& record) { return vector_bytes(record.points); }
std::size_t bytes_of(const LeafSurface& record) { return record.bytes(); }
std::size_t bytes_of(const LeafSizes& record) { return vector_bytes(record.cubes); }

}  // namespace

std::size_t LeafCache::Entry::bytes() const {
  std::size_t bytes = kEntryBytes;
  if (points.record) bytes += bytes_of(*points.record);
  if (surface.record) bytes += bytes_of(*surface.record);
  if (sizes.record) bytes += bytes_of(*sizes.record);
  if (cells.record)
    bytes += vector_bytes(cells.record->vertices) + vector_bytes(cells.record->cells) +
             vector_bytes(cells.record->bodies);
  if (facets.record)
    bytes += vector_bytes(facets.record->vertices) + vector_bytes(facets.record->facets);
  if (unresolved.record) bytes += vector_bytes(unresolved.record->sites);
  return bytes;
}

LeafCache::Entry& LeafCache::touch(MortonKey leaf) {
  if (Entry* const held = entries_.find(leaf)) return *held;
  most_bytes_ += kEntryBytes;
  return entries_.add(leaf);
}

LeafCache::Entry& LeafCache::touch_changed(MortonKey leaf) {
  changed_.insert(leaf);
  return touch(leaf);
}

const LeafInfo& LeafCache::info(MortonKey leaf) {
  auto& info = touch(leaf).info;
  if (!info.record) {
    info.record = store_.snapshot().leaf(leaf);
    if (!info.record) throw StoreError("the store has no record of " + leaf_name(leaf));
  }
  return *info.record;
}

template <class Record>
const Record& LeafCache::kept(MortonKey leaf, Cached<Record> Entry::*which,
                              Record (Reader::*read)(MortonKey) const) {
  auto& record = (touch(leaf).*which).record;
  if (!record) {
    record = (store_.snapshot().*read)(leaf);
    most_bytes_ += bytes_of(*record);
  }
  return *record;
}

const LeafPoints& LeafCache::points(MortonKey leaf) {
  return kept(leaf, &Entry::points, &Reader::points);
}

const LeafSurface& LeafCache::surface(MortonKey leaf) {
  return kept(leaf, &Entry::surface, &Reader::surface);
}

const LeafSizes& LeafCache::sizes(MortonKey leaf) {
  return kept(leaf, &Entry::sizes, &Reader::sizes);
}

LeafCells LeafCache::cells(MortonKey leaf) {
  const auto& cells = touch(leaf).cells;
  return cells.record ? *cells.record : store_.snapshot().cells(leaf);
}

LeafFacets LeafCache::facets(MortonKey leaf) {
  const auto& facets = touch(leaf).facets;
  return facets.record ? *facets.record : store_.snapshot().facets(leaf);
}

LeafUnresolved LeafCache::unresolved(MortonKey leaf) {
  const auto& unresolved = touch(leaf).unresolved;
  return unresolved.record ? *unresolved.record : store_.snapshot().unresolved(leaf);
}

LeafInfo& LeafCache::edit_info(MortonKey leaf) {
  info(leaf);
  auto& info = touch_changed(leaf).info;
  info.is_changed = true;
  return *info.record;
}

LeafPoints& LeafCache::edit_points(MortonKey leaf) {
  points(leaf);
  auto& points = touch_changed(leaf).points;
  points.is_changed = true;
  return *points.record;
}

void LeafCache::put_cells(MortonKey leaf, LeafCells cells) {
  touch_changed(leaf).cells = {std::move(cells), true};
}

void LeafCache::put_facets(MortonKey leaf, LeafFacets facets) {
  touch_changed(leaf).facets = {std::move(facets), true};
}

void LeafCache::put_unresolved(MortonKey leaf, LeafUnresolved unresolved) {
  touch_changed(leaf).unresolved = {std::move(unresolved), true};
}

void LeafCache::put_sizes(MortonKey leaf, LeafSizes sizes) {
  touch_changed(leaf).sizes = {std::move(sizes), true};
}

void LeafCache::add_leaf(MortonKey leaf, const LeafInfo& info, LeafPoints points,
                         LeafSurface surface) {
  assert(!erased_.contains(leaf));
  Entry& entry = touch_changed(leaf);
  entry.info = {info, true};
  entry.points = {std::move(points), true};
  entry.surface = {std::move(surface), true};
}

void LeafCache::erase_leaf(MortonKey leaf) {
  entries_.erase(leaf);
  changed_.erase(leaf);
  erased_.insert(leaf);
}

std::size_t LeafCache::unwritten_bytes() const {
  std::size_t bytes = 0;
  for (const MortonKey leaf : changed_) bytes += entries_.at(leaf).bytes();
  return bytes;
}

void LeafCache::write(Batch& batch, MortonKey leaf, Entry& entry) {
  if (entry.info.is_changed) batch.put_leaf(leaf, *entry.info.record);
  if (entry.points.is_changed) batch.put_points(leaf, *entry.points.record);
  if (entry.surface.is_changed) batch.put_surface(leaf, *entry.surface.record);
  if (entry.sizes.is_changed) batch.put_sizes(leaf, *entry.sizes.record);
  if (entry.cells.is_changed) batch.put_cells(leaf, *entry.cells.record);
  if (entry.facets.is_changed) batch.put_facets(leaf, *entry.facets.record);
  if (entry.unresolved.is_changed) batch.put_unresolved(leaf, *entry.unresolved.record);
  entry.info.is_changed = entry.points.is_changed = entry.surface.is_changed = false;
  entry.sizes.is_changed = false;
  entry.cells = {};
  entry.facets = {};
  entry.unresolved = {};
}

void LeafCache::write_to(Batch& batch) {
  for (const MortonKey leaf : erased_) batch.erase_leaf(leaf);
  most_bytes_ += unwritten_bytes();
  for (const MortonKey leaf : changed_) write(batch, leaf, entries_.at(leaf));
  erased_.clear();
  changed_.clear();
}

void LeafCache::trim() {
  if (most_bytes_ <= max_bytes_) return;
  const std::size_t kept_bytes = max_bytes_ / 4 * 3;  // so that not every call has to walk the list
  std::size_t bytes = 0;
  entries_.erase_if([&](MortonKey leaf, const Entry& entry) {
    if (changed_.contains(leaf)) return false;
    const bool is_kept = bytes + entry.bytes() <= kept_bytes;
    if (is_kept) bytes += entry.bytes();
    return !is_kept;
  });
  most_bytes_ = bytes;
}

}  // namespace locvol
