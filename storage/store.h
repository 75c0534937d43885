// Store keeps all that a run needs on disk, by octree leaf and in Morton order, in LMDB.
//
// Durability: a Batch is all or nothing, and durable once commit() returns. After a crash the
//     store opens at its last commit; there is no recovery step.
// Threads: many Snapshots at once, each used by one thread at a time; one Batch at a time.
// Memory: records are copies and outlive the Snapshot or Batch they came from. Besides them:
//     StoreOptions::memory_bytes for mapped pages; Batch::memory_bytes() and commit_bytes() for
//     the batch; kStoreThreadBytes for each thread that reads or writes at once; kStoreFixedBytes.
// Errors: StoreError when LMDB or the disk fails, CorruptRecord (a StoreError) when stored bytes
//     fail their checksum; it names the record and its leaf. What was never written is not an
//     error: an empty optional, or an empty list.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "octree/morton_key.h"
#include "storage/records.h"
#include "storage/store_error.h"
#include "storage/store_options.h"

namespace locvol {

// Upper bounds, measured (storage/README.md).
inline constexpr std::uint64_t kStoreFixedBytes = std::uint64_t{4} << 20;   // an open Store
inline constexpr std::uint64_t kStoreThreadBytes = std::uint64_t{2} << 20;  // zstd's contexts

// What both a Snapshot and a Batch can read.
class Reader {
 public:
  virtual ~Reader();
  std::optional<RunRecord> run() const;
  std::optional<MemoryRecord> memory() const;
  TimelineRecord timeline() const;
  std::optional<RankRecord> rank() const;  // absent: one process has all of the run
  SurfaceSheets sheets() const;            // of the run's surface
  RankWords words() const;                 // of the rank's last superstep
  std::optional<LeafInfo> leaf(MortonKey key) const;
  LeafPoints points(MortonKey key) const;
  LeafCells cells(MortonKey key) const;
  LeafFacets facets(MortonKey key) const;
  LeafSurface surface(MortonKey key) const;
  LeafUnresolved unresolved(MortonKey key) const;
  LeafSizes sizes(MortonKey key) const;
  std::vector<MortonKey> leaf_keys() const;  // all leaves, in Morton order
  // The leaves whose visits on other ranks found what is yet to be applied: all, in Morton order.
  std::vector<MortonKey> result_keys() const;
  std::optional<RankResult> result(MortonKey key) const;
  // The first `max` leaves, or entries of the queue, from `from` on, in order. Decodes no record,
  // so a damaged one is listed like any other; a damaged key may be no valid one.
  std::vector<MortonKey> leaf_keys(MortonKey from, std::size_t max) const;
  std::vector<QueueEntry> queue_keys(const QueueEntry& from, std::size_t max) const;
  // Every leaf with its info, in Morton order; stops when `visit` returns false.
  void for_each_leaf(const std::function<bool(MortonKey, const LeafInfo&)>& visit) const;
  // Queue entries in queue order; stops when `visit` returns false.
  void for_each_queued(const std::function<bool(const QueueEntry&)>& visit) const;
  bool has_queue_entry(const QueueEntry& entry) const;

 protected:
  struct Impl;
  explicit Reader(std::unique_ptr<Impl> impl);
  Reader(Reader&&) noexcept;
  std::unique_ptr<Impl> impl_;
};

// A consistent, read-only view. Short-lived: it keeps LMDB from reusing old pages.
class Snapshot : public Reader {
 public:
  Snapshot(Snapshot&&) noexcept;
  ~Snapshot() override;

 private:
  friend class Store;
  explicit Snapshot(std::unique_ptr<Impl> impl);
};

// A write transaction; reads see its own writes. Destroyed uncommitted, it is rolled back.
// A full map never shows: Batch keeps what it has written until commit and, when the map is full,
// grows it and writes all again (or Store grows it ahead of need; the caller cannot tell).
class Batch : public Reader {
 public:
  Batch(Batch&&) noexcept;
  ~Batch() override;

  void put_run(const RunRecord& run);
  void put_memory(const MemoryRecord& memory);
  void put_timeline(const TimelineRecord& timeline);
  void put_sheets(const SurfaceSheets& sheets);
  void put_rank(const RankRecord& rank);
  void put_words(const RankWords& words);
  void put_result(MortonKey key, const RankResult& result);
  void erase_result(MortonKey key);
  void put_leaf(MortonKey key, const LeafInfo& info);
  void put_points(MortonKey key, const LeafPoints& points);
  void put_cells(MortonKey key, const LeafCells& cells);
  void put_facets(MortonKey key, const LeafFacets& facets);
  void put_surface(MortonKey key, const LeafSurface& surface);
  void put_unresolved(MortonKey key, const LeafUnresolved& unresolved);
  void put_sizes(MortonKey key, const LeafSizes& sizes);
  void erase_leaf(MortonKey key);  // the leaf's info and all its records; not its queue entry
  void put_queue_entry(const QueueEntry& entry);
  void erase_queue_entry(const QueueEntry& entry);
  std::uint64_t bytes_written() const;  // compressed, since the batch began
  std::uint64_t memory_bytes() const;   // what the batch holds until it is over
  // What commit() takes besides, at most: LMDB's copies of the pages that change. LMDB keeps what
  // the largest commit took for the next ones.
  std::uint64_t commit_bytes() const;
  void commit();  // durable on return; the batch is over

 private:
  friend class Store;
  explicit Batch(std::unique_ptr<Impl> impl);
};

class Store {
 public:
  // Throws StoreError: no store there (and !create), in use by another process, of a newer format,
  // damaged, or on a file system that LMDB cannot use.
  static Store open(const std::filesystem::path& directory, const StoreOptions& options = {});
  Store(Store&&) noexcept;
  Store& operator=(Store&&) noexcept;
  ~Store();

  Snapshot snapshot() const;
  // The store as it is now, for reading: all its snapshots are of this one moment. Short-lived, as
  // a Snapshot is, and for one thread at a time.
  Store frozen() const;
  // The id of the process that has the store open for writing, if there is one.
  std::optional<std::string> writer() const;
  Batch begin();  // waits while another thread has a Batch
  std::vector<DatabaseSize> sizes() const;
  std::uint64_t mapped_bytes() const;  // pages of the map in memory, at most; costs nothing to ask
  void release_pages() const;          // gives them back ahead of StoreOptions::memory_bytes
  const std::filesystem::path& directory() const;
  // False too for what is left of a creation that was cut short: nothing was committed. Throws
  // StoreError when it cannot tell.
  static bool exists(const std::filesystem::path& directory);
  // A directory with a store in it, or with what is left of the creation of one, which may be
  // nothing; and with no other file.
  static bool owns(const std::filesystem::path& directory);

 private:
  struct Impl;
  explicit Store(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace locvol
