// RunState is the run in memory: what the engine has read of the store, and what the next commit
// will write. There is no other state: dropped at any time and read again from the store, it goes
// on from the last commit with the same result.
//
// Whatever changes the run is a verb of this class, which keeps what belongs together: a leaf's
// counts (LeafInfo) are those of its records, the run's (RunCounts) the sums over its leaves, and
// `LeafInfo::queued` says where in the queue the leaf waits.
#pragma once

#include <algorithm>
#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <span>
#include <vector>

#include "engine/run/leaf_cache.h"
#include "engine/run/leaf_queue.h"
#include "engine/shared/lattice_of_run.h"
#include "octree/lattice.h"
#include "octree/octree.h"
#include "octree/shares.h"
#include "refine/leaf.h"
#include "storage/store.h"

namespace locvol {

// Over λ, in cover mode. A visit deletes within kReach of its leaf, inserts within kInsertion, and
// makes core points explicit that are closer than kLatticeStar to that: these are the farthest that
// it writes. What it reads of the core is the farthest that it reads. Leaves farther apart than
// both together are independent of each other.
inline constexpr double kConflict = kInsertion + kLatticeStar + kCoreReach;

// Likewise, how far from a leaf a visit of it changes what is known of others: it makes a core
// point explicit, and those around that are to look at it. It reads no farther; sites of two leaves
// that may become one are as near.
inline constexpr double kTouch =
    std::max(kInsertion + kLatticeStar + kNeighborhood, 2 * kReach + 1);
// The same of any run in cover mode, as a length: before sizes are known, of visits that find them.
// Of those that come later, if leaves are not split. REQUIRES: LeafInfo has what is known of sizes
double touch_distance(const RunRecord& run, const LeafInfo& info);

// Each visit of an epoch has so many ids for its new points, far more than it takes: which ones
// depends on its place among those visits alone.
inline constexpr std::uint64_t kIdsOfVisit = std::uint64_t{1} << 24;

inline constexpr std::size_t kDefaultCacheBytes = std::size_t{128} << 20;
inline constexpr std::size_t kDefaultUnwrittenBytes = std::size_t{32} << 20;

class RunState {
 public:
  // `max_unwritten_bytes`: of changes as decoded, before a commit is due.
  // REQUIRES: the store holds a run that is past Phase::kIngest
  explicit RunState(Store& store, std::size_t cache_bytes = kDefaultCacheBytes,
                    std::size_t max_unwritten_bytes = kDefaultUnwrittenBytes);

  const Store& store() const { return store_; }
  const RunRecord& run() const { return run_; }
  const Lattice& lattice() const { return lattice_; }  // in paper mode without points
  const LinearOctree& octree() const { return octree_; }
  const LeafQueue& queue() const { return queue_; }
  LeafCache& leaves() { return leaves_; }  // to be read, and trimmed

  double size() const { return run_.parameters.size; }  // λ: no more at the surface
  bool is_cover() const { return run_.parameters.init == Initialization::kCover; }
  Box box(MortonKey leaf) const { return run_.frame.box(leaf); }
  SiteBox sites(MortonKey leaf) const { return lattice_.sites_in(box(leaf)); }

  // -- Ranks
  // Where several work on a run, a rank's store has, besides its own leaves, copies of those within
  // either's touch_distance() of them: what a visit changes there is told to it, so that its own
  // visits find what they read; their cells are not kept, but for mending. All else is empty
  // leaves, as large as the octree allows. Changes of those are dropped, and counts are of own
  // leaves.

  // kBeyond, too, of what is no leaf of the rank's octree.
  Holding holding(MortonKey leaf) {
    return rank_ && !octree_.is_leaf(leaf) ? Holding::kBeyond : leaves_.info(leaf).holding;
  }
  std::uint64_t num_own_leaves() const { return num_own_leaves_; }
  std::uint64_t num_own_queued() const { return num_own_queued_; }
  bool is_own(MortonKey leaf) { return holding(leaf) == Holding::kOwn; }
  // Others that have a leaf which a visit of this one may change, ascending. REQUIRES: it is own
  std::vector<int> others_touched(MortonKey leaf);
  // Others that have it, or a copy.
  std::vector<int> others_holding(MortonKey leaf);
  const Shares& shares() const { return shares_; }
  const RankRecord& rank() const { return *rank_; }  // REQUIRES: several work on the run
  // From now on `color` is applied: its first own new point gets this id, and after all the run's
  // next one is `end`.
  void begin_applying(const QueuePosition& color, std::uint64_t first, std::uint64_t end);
  void note_sent(std::uint64_t num_sent) { rank_->num_sent = num_sent; }
  void note_all_sent() { rank_->is_all_sent = true; }
  void put_next_own_id(std::uint64_t id) { rank_->next_id = id; }
  void end_applying();
  // A superstep of the phase that is no visits.
  void end_stage() { ++rank_->stage; }
  // Leaves are well where they are, from this phase on.
  void note_stay(Phase phase) { rank_->moved_at = phase; }
  // What a visit on another rank found, from the next commit on; it is applied, likewise.
  void keep_result(MortonKey leaf, RankResult result);
  void drop_result(MortonKey leaf);

  // -- Sizes

  bool is_uniform() const { return run_.parameters.sizes().is_uniform(); }
  double size_at(const Point& p);  // h(p)
  // How far from any point of the leaf a ball through it reaches if its radius is at most k / 2
  // times h at its center.
  double reach_of(MortonKey leaf, double k);
  // Of h in the leaf, the least; and the largest on the surface there.
  double least_size(MortonKey leaf);
  double surface_size(MortonKey leaf);
  void put_sizes(MortonKey leaf, LeafSizes sizes);
  // LeafInfo::reached_size. REQUIRES: sizes are known all around
  void find_reached_size(MortonKey leaf);

  // -- Phases and the queue

  void begin_phase(Phase next);
  void note_sizes(const SizeTotals& totals) { run_.sizes = totals; }
  // A leaf that waits keeps its place; another waits for the next epoch.
  void enqueue(MortonKey leaf) { enqueue(leaf, run_.epoch + 1); }
  void enqueue(MortonKey leaf, std::uint32_t epoch);
  void dequeue(MortonKey leaf);  // REQUIRES: it waits
  // If the leaves at the front wait for an epoch that has not begun, begins it: gives them colors.
  // That is to be committed before any of them is visited. Throws Stopped before any change.
  bool open_epoch(const StopToken* stop = nullptr);
  // Which of the rank's leaves wait for the epoch, in Morton order, and how far from each others
  // must have other colors. REQUIRES: the epoch is not open
  struct Waiting {
    MortonKey leaf;
    double conflict_distance = 0;
  };
  std::vector<Waiting> waiting(std::uint32_t epoch);
  // Opens the epoch with these colors, which are those that `waiting` of all ranks get. Throws
  // RefineError: a copy waits, and its leaf does not, or the reverse.
  void open_epoch(std::uint32_t epoch, std::span<const MortonKey> leaves,
                  std::span<const std::uint32_t> colors);
  bool is_epoch_open() const { return !queue_.is_empty() && queue_.front().color != kNoColor; }
  // Can neither's visit read or change what the other's writes? REQUIRES: of the open epoch
  bool are_independent(const QueueEntry& a, const QueueEntry& b);

  // -- Points

  // Whose ids follow each other from here on, until they end: those of a visit.
  void begin_ids(std::uint64_t first);
  void end_ids();
  // Appends to the points of the leaf that owns `position`, and gives the next id. Throws
  // RefineError: a visit has too few
  MeshPoint add_point(const Point& position, PointKind kind);
  // A point of the lattice has the site's id.
  MeshPoint add_lattice_point(const LatticeSite& site);
  void remove_point(const MeshPoint& point);  // throws RefineError unless it is in P
  // REQUIRES: the leaf had no core
  void put_core(MortonKey leaf, const LatticeCore& core);
  // From now on the leaf's record lists the point. REQUIRES: the site is of its core
  void list_core_point(MortonKey leaf, const LatticeSite& site);

  // -- What visits leave

  void add_visit(MortonKey leaf, const VisitStats& stats);
  // Of what a visit may build on: a later one may look at what is new since now; or it may not, for
  // of points that go nothing is known.
  void allow_short_visit(MortonKey leaf);
  void require_whole_visit(MortonKey leaf);
  // Each in place of what the leaf had. Of copies cells are dropped, unless they are shared for
  // mending; facets always.
  void put_cells(MortonKey leaf, LeafCells cells);
  void put_shared_cells(MortonKey leaf, LeafCells cells);
  void put_facets(MortonKey leaf, LeafFacets facets);
  // Of what an own leaf lists.
  void change(MortonKey leaf, const Changes<CellList>& changes);
  void change(MortonKey leaf, const Changes<FacetList>& changes);
  // The leaf is visited once more, and looks around the place if not at all of it; without points
  // it has nothing to restore.
  void ask_for_visit(MortonKey leaf, const Point& place);
  void put_unresolved(MortonKey leaf, LeafUnresolved unresolved);
  void put_num_core_cells(MortonKey leaf, std::uint64_t num_cells);
  // As put_cells(); what is missing is left out of the mesh.
  void leave_out_cells(MortonKey leaf, LeafCells left);

  // What the children of a leaf have of it.
  struct Child {
    bool is_center_inside = false;
    LeafPoints points;
    LeafSurface surface;
    LeafSizes sizes;
  };
  // Its cells and unresolved sites are gone, children with points wait.
  void split(MortonKey leaf, std::array<Child, 8> children);

  // -- Commits

  bool is_commit_due() const;
  void note_visit();
  // One batch with all changes; durable on return.
  void commit(const std::optional<MemoryRecord>& memory = std::nullopt,
              const TimelineRecord* timeline = nullptr);
  // The next commit ends a superstep, in which the rank has said this to others.
  void end_superstep(std::string said);

 private:
  bool is_beyond(MortonKey leaf) { return holding(leaf) == Holding::kBeyond; }
  // A count of the leaf, in the run's total if the leaf is own.
  void put_count(MortonKey leaf, std::uint64_t LeafInfo::*count, std::uint64_t now,
                 std::uint64_t RunCounts::*total);
  void put_color(MortonKey leaf, const QueuePosition& waiting, std::uint32_t color);
  MortonKey owner_of(const Point& position) const;
  void add_to_leaf(const MeshPoint& point);
  // Of leaves of this one alone, where sizes vary. REQUIRES: cover mode
  double conflict_distance(MortonKey leaf);
  std::vector<std::uint32_t> colors_of(const std::vector<MortonKey>& its_leaves,
                                       const StopToken* stop);

  Store& store_;
  std::optional<RankRecord> rank_;  // absent: one process has all of the run
  std::optional<RankWords> unwritten_words_;
  std::map<MortonKey, std::optional<RankResult>> unwritten_results_;  // nothing: to be erased
  Shares shares_;
  std::uint64_t num_own_leaves_ = 0, num_own_queued_ = 0;
  RunRecord run_;
  std::uint64_t ids_end_ = std::numeric_limits<std::uint64_t>::max();
  Lattice lattice_;
  LinearOctree octree_;
  LeafCache leaves_;
  LeafQueue queue_;
  std::size_t max_unwritten_bytes_;
  int num_unwritten_visits_ = 0;
  std::chrono::steady_clock::time_point last_commit_ = std::chrono::steady_clock::now();
};

}  // namespace locvol
