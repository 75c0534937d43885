// RunState is the run in memory: what the engine has read of the store, and what the next commit
// will write. There is no other state: dropped at any time and read again from the store, it goes
// on from the last commit with the same result.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "engine/run/leaf_cache.h"
#include "engine/run/leaf_queue.h"
#include "engine/shared/lattice_of_run.h"
#include "octree/lattice.h"
#include "octree/octree.h"
#include "refine/refine_leaf.h"
#include "storage/store.h"

namespace locvol {

// Lengths over λ, in cover mode. A visit reads listed points within kReach of its leaf, and the
// lattice core within kCoreReach: it inserts within kInsertion, and asks for core points 2 around.
inline constexpr double kInsertion = kReach - 1;
inline constexpr double kCoreReach = kInsertion + 2.1;
// It deletes within kReach, and makes core points explicit that are closer than kLatticeStar to
// what it inserts: these are the farthest that it writes. What it reads of the core is the farthest
// that it reads. Leaves farther apart than both together are independent of each other.
inline constexpr double kConflict = kInsertion + kLatticeStar + kCoreReach;
// In cover mode, epoch 0 covers the surface and the inside, and epoch 1 fills the holes that are
// left between leaves' first points; in between, all samples come to be known.
inline constexpr std::uint32_t kCoverEpoch = 0;

inline constexpr std::size_t kDefaultCacheBytes = std::size_t{128} << 20;
inline constexpr std::size_t kDefaultUnwrittenBytes = std::size_t{32} << 20;

struct RunState {
  // `max_unwritten_bytes`: of changes as decoded, before a commit is due.
  // REQUIRES: the store holds a run that is past Phase::kIngest
  explicit RunState(Store& store, std::size_t cache_bytes = kDefaultCacheBytes,
                    std::size_t max_unwritten_bytes = kDefaultUnwrittenBytes);

  double size() const { return run.parameters.size; }  // λ
  bool is_cover() const { return run.parameters.init == Initialization::kCover; }
  Box box(MortonKey leaf) const { return run.frame.box(leaf); }
  SiteBox sites(MortonKey leaf) const { return lattice.sites_in(box(leaf)); }
  // Where listed points matter to the leaf's first visit.
  Box surroundings(MortonKey leaf) const { return box(leaf).expanded(kReach * size()); }

  // A leaf that waits keeps its place, and its dirty box grows; another waits for the next epoch.
  void enqueue(MortonKey leaf, const Box& dirty);
  void dequeue(MortonKey leaf);  // REQUIRES: it waits
  // If the leaves at the front wait for an epoch that has not begun, begins it: gives them colors.
  // That is to be committed before any of them is visited. Throws Stopped before any change.
  bool open_epoch(const StopToken* stop = nullptr);

  // Can neither's visit read or change what the other's writes? REQUIRES: of the open epoch
  bool are_independent(const QueuePlace& a, const QueuePlace& b) const;

  // Appends to the points of the leaf that owns `position`, and gives the next id.
  MeshPoint add_point(const Point& position, PointKind kind);
  // A point of the lattice has the site's id.
  MeshPoint add_lattice_point(const LatticeSite& site);

  // In place of those that the leaf had.
  void put_unresolved(MortonKey leaf, LeafUnresolved unresolved);

  bool is_commit_due() const;
  void note_visit();
  // One batch with all changes; durable on return.
  void commit(const std::optional<MemoryRecord>& memory = std::nullopt,
              const TimelineRecord* timeline = nullptr);

  Store& store;
  RunRecord run;
  Lattice lattice;  // in paper mode without points
  LinearOctree octree;
  LeafCache leaves;
  LeafQueue queue;

 private:
  void add_to_leaf(const MeshPoint& point);
  double conflict_distance(std::uint32_t epoch) const;  // REQUIRES: cover mode
  std::vector<std::uint32_t> colors_of(std::uint32_t epoch,
                                       const std::vector<MortonKey>& its_leaves,
                                       const StopToken* stop) const;

  std::size_t max_unwritten_bytes_;
  int num_unwritten_visits_ = 0;
  std::chrono::steady_clock::time_point last_commit_ = std::chrono::steady_clock::now();
};

}  // namespace locvol
