#include "engine/run/run_queue.h"

#include <algorithm>
#include <cassert>
#include <numeric>
#include <string>

#include "engine/run/coloring.h"
#include "engine/shared/leaf_name.h"

namespace locvol {

// Visits that come later look at a few of the points.
std::uint64_t weight_of_visit(const LeafInfo& info) {
  return info.num_visits == 0 ? info.num_points : 0;
}

namespace {

std::vector<std::uint32_t> colors_of(const RunView& run, const std::vector<MortonKey>& its_leaves,
                                     const ConflictDistance& distance, const StopToken* stop) {
  if (!run.is_cover()) {  // any leaf may write into the reach of any other
    std::vector<std::uint32_t> colors(its_leaves.size());
    std::iota(colors.begin(), colors.end(), 0U);
    return colors;
  }
  if (run.is_uniform())
    return color_leaves(run.octree(), run.frame(), its_leaves, distance(its_leaves.front()), stop);
  std::vector<LeafToColor> leaves;
  leaves.reserve(its_leaves.size());
  for (const MortonKey leaf : its_leaves)
    leaves.push_back({leaf, distance(leaf), weight_of_visit(run.leaves().info(leaf))});
  return color_leaves(run.octree(), run.frame(), leaves, stop);
}

}  // namespace

RunQueue::RunQueue(RunData& data) : RunView(data), queue_(data.store.snapshot()) {
  num_own_ = queue_.count_if([&](MortonKey leaf) {
    return !data.rank || data.shares.owner_of(leaf) == static_cast<int>(data.rank->rank);
  });
}

void RunQueue::enqueue(MortonKey leaf, std::uint32_t epoch) {
  if (is_beyond(leaf) || leaves().info(leaf).queued) return;
  const QueuePosition position{epoch, kNoColor};
  data_.leaves.edit_info(leaf).queued = position;
  queue_.put({position, leaf});
  if (is_own(leaf)) ++num_own_;
}

void RunQueue::dequeue(MortonKey leaf) {
  if (is_beyond(leaf)) return;
  auto& queued = data_.leaves.edit_info(leaf).queued;
  assert(queued);
  queue_.erase({*queued, leaf});
  queued.reset();
  if (is_own(leaf)) --num_own_;
}

bool RunQueue::open_epoch(const ConflictDistance& distance, const StopToken* stop) {
  if (queue_.is_empty() || queue_.front().color != kNoColor) return false;
  const QueuePosition waiting = queue_.front();
  const std::vector<MortonKey> epoch = queue_.front_leaves();
  open_epoch(waiting.epoch, epoch, colors_of(*this, epoch, distance, stop));
  return true;
}

void RunQueue::put_color(MortonKey leaf, const QueuePosition& waiting, std::uint32_t color) {
  const QueuePosition position{waiting.epoch, color};
  queue_.erase({waiting, leaf});
  queue_.put({position, leaf});
  data_.leaves.edit_info(leaf).queued = position;
}

std::vector<MortonKey> RunQueue::own_waiting(std::uint32_t epoch) const {
  std::vector<MortonKey> waiting;
  if (queue_.is_empty() || queue_.front() != QueuePosition{epoch, kNoColor}) return waiting;
  for (const MortonKey leaf : queue_.front_leaves())
    if (is_own(leaf)) waiting.push_back(leaf);
  return waiting;
}

void RunQueue::open_epoch(std::uint32_t epoch, std::span<const MortonKey> leaves,
                          std::span<const std::uint32_t> colors) {
  const QueuePosition waiting{epoch, kNoColor};
  std::size_t num_held = 0;
  for (std::size_t i = 0; i < leaves.size(); ++i) {
    if (!octree().is_leaf(leaves[i]) || is_beyond(leaves[i])) continue;
    if (this->leaves().info(leaves[i]).queued != waiting)
      throw RefineError(leaf_name(leaves[i]) + ": waits on its rank, and not where it is a copy");
    ++num_held;
    put_color(leaves[i], waiting, colors[i]);
  }
  if (queue_.num_in_epoch(epoch) != num_held)
    throw RefineError(std::to_string(queue_.num_in_epoch(epoch) - num_held) +
                      " leaves wait where they are copies, and not on their ranks");
  data_.run.epoch = epoch;
}

bool RunQueue::are_independent(const QueueEntry& a, const QueueEntry& b,
                               const ConflictDistance& distance) const {
  if (a.position == b.position) return true;
  if (!is_cover()) return false;
  const double farthest = std::max(distance(a.leaf), distance(b.leaf));
  return box(a.leaf).squared_distance(box(b.leaf)) > farthest * farthest;
}

}  // namespace locvol
