#include "engine/run/run_state.h"

#include <algorithm>
#include <cassert>
#include <numeric>
#include <string>
#include <utility>

#include "engine/run/coloring.h"
#include "refine/cover_leaf.h"
#include "refine/refine_leaf.h"

namespace locvol {
namespace {

constexpr int kMaxVisitsOfCommit = 64;  // what a crash may cost
constexpr std::chrono::seconds kMaxTimeOfCommit{1};

// Over λ: a leaf's cover reads samples within r_s of its box and writes to its box.
constexpr double kCoverConflict = 1.01 * kSampleRadius;

RunRecord read_run(const Store& store) {
  const auto run = store.snapshot().run();
  assert(run && run->phase != Phase::kIngest);
  return *run;
}

}  // namespace

RunState::RunState(Store& the_store, std::size_t cache_bytes, std::size_t max_unwritten_bytes)
    : store(the_store),
      run(read_run(the_store)),
      lattice(lattice_of(run)),
      octree(the_store.snapshot().leaf_keys()),
      leaves(the_store, cache_bytes),
      queue(the_store.snapshot()),
      max_unwritten_bytes_(max_unwritten_bytes) {}

void RunState::enqueue(MortonKey leaf, const Box& dirty) {
  if (const auto position = leaves.info(leaf).queued) return queue.grow(*position, leaf, dirty);
  const QueuePosition position{run.epoch + 1, kNoColor};
  leaves.edit_info(leaf).queued = position;
  queue.put({position, leaf, dirty});
}

void RunState::dequeue(MortonKey leaf) {
  auto& queued = leaves.edit_info(leaf).queued;
  assert(queued);
  queue.erase(*queued, leaf);
  queued.reset();
}

bool RunState::open_epoch(const StopToken* stop) {
  if (queue.is_empty() || queue.front().color != kNoColor) return false;
  const QueuePosition waiting = queue.front();
  const std::vector<MortonKey> epoch = queue.front_leaves();
  const std::vector<std::uint32_t> colors = colors_of(waiting.epoch, epoch, stop);
  for (std::size_t i = 0; i < epoch.size(); ++i) {
    const QueuePosition position{waiting.epoch, colors[i]};
    queue.move(waiting, position, epoch[i]);
    leaves.edit_info(epoch[i]).queued = position;
  }
  run.epoch = waiting.epoch;
  return true;
}

std::vector<std::uint32_t> RunState::colors_of(std::uint32_t epoch,
                                               const std::vector<MortonKey>& its_leaves,
                                               const StopToken* stop) const {
  if (is_cover())
    return color_leaves(octree, run.frame, its_leaves, conflict_distance(epoch), stop);
  std::vector<std::uint32_t> colors(
      its_leaves.size());  // any leaf may write into the reach of any other
  std::iota(colors.begin(), colors.end(), 0U);
  return colors;
}

double RunState::conflict_distance(std::uint32_t epoch) const {
  return (epoch == kCoverEpoch ? kCoverConflict : kConflict) * size();
}

bool RunState::are_independent(const QueuePlace& a, const QueuePlace& b) const {
  if (a.position == b.position) return true;
  if (!is_cover()) return false;
  const double distance = conflict_distance(a.position.epoch);
  return box(a.leaf).squared_distance(box(b.leaf)) > distance * distance;
}

MeshPoint RunState::add_point(const Point& position, PointKind kind) {
  const MeshPoint point{run.next_point_id++, position, kind};
  add_to_leaf(point);
  return point;
}

MeshPoint RunState::add_lattice_point(const LatticeSite& site) {
  const MeshPoint point = lattice.point(site);
  add_to_leaf(point);
  return point;
}

void RunState::add_to_leaf(const MeshPoint& point) {
  const Point& p = point.position;
  if (!run.frame.contains(p))
    throw RefineError("the new point (" + std::to_string(p.x) + ", " + std::to_string(p.y) + ", " +
                      std::to_string(p.z) + ") lies outside the octree");
  const MortonKey owner = octree.leaf_owning(run.frame, p);
  auto& points = leaves.edit_points(owner).points;
  points.insert(std::ranges::upper_bound(points, point.id, {}, &MeshPoint::id), point);
  ++leaves.edit_info(owner).num_points;
  ++run.num_points;
}

void RunState::put_unresolved(MortonKey leaf, LeafUnresolved unresolved) {
  LeafInfo& info = leaves.edit_info(leaf);
  run.num_unresolved -= info.num_unresolved;
  info.num_unresolved = unresolved.sites.size();
  run.num_unresolved += info.num_unresolved;
  leaves.put_unresolved(leaf, std::move(unresolved));
}

void RunState::note_visit() {
  ++num_unwritten_visits_;
  leaves.trim();
}

bool RunState::is_commit_due() const {
  return num_unwritten_visits_ >= kMaxVisitsOfCommit ||
         leaves.unwritten_bytes() > max_unwritten_bytes_ ||
         std::chrono::steady_clock::now() - last_commit_ > kMaxTimeOfCommit;
}

void RunState::commit(const std::optional<MemoryRecord>& memory, const TimelineRecord* timeline) {
  Batch batch = store.begin();
  leaves.write_to(batch);
  queue.write_to(batch);
  batch.put_run(run);
  if (memory) batch.put_memory(*memory);
  if (timeline) batch.put_timeline(*timeline);
  batch.commit();
  num_unwritten_visits_ = 0;
  last_commit_ = std::chrono::steady_clock::now();
  leaves.trim();
  store.release_pages();
}

}  // namespace locvol
