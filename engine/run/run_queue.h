// RunQueue has leaves wait, and opens epochs: which leaves are visited next, and which of them at
// once. `LeafInfo::queued` says where in the queue a leaf waits.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "engine/run/leaf_queue.h"
#include "engine/run/run_view.h"
#include "octree/stop.h"

namespace locvol {

// Leaves no farther from a leaf than this must have other colors; below 0: none.
using ConflictDistance = std::function<double(MortonKey leaf)>;

// How long the leaf's next visit will take, over that of others, as far as is known.
std::uint64_t weight_of_visit(const LeafInfo& info);

class RunQueue : RunView {
 public:
  explicit RunQueue(RunData& data);

  const LeafQueue& entries() const { return queue_; }
  std::uint64_t num_own() const { return num_own_; }
  bool is_epoch_open() const { return !queue_.is_empty() && queue_.front().color != kNoColor; }

  // A leaf that waits keeps its place; another waits for the next epoch.
  void enqueue(MortonKey leaf) { enqueue(leaf, run().epoch + 1); }
  void enqueue(MortonKey leaf, std::uint32_t epoch);
  void dequeue(MortonKey leaf);  // REQUIRES: it waits

  // If the leaves at the front wait for an epoch that has not begun, begins it: gives them colors.
  // That is to be committed before any of them is visited. Throws Stopped before any change.
  bool open_epoch(const ConflictDistance& distance, const StopToken* stop = nullptr);
  // Which of the rank's leaves wait for the epoch, in Morton order. REQUIRES: it is not open
  std::vector<MortonKey> own_waiting(std::uint32_t epoch) const;
  // Opens the epoch with these colors, which are those that `own_waiting` of all ranks get. Throws
  // RefineError: a copy waits, and its leaf does not, or the reverse.
  void open_epoch(std::uint32_t epoch, std::span<const MortonKey> leaves,
                  std::span<const std::uint32_t> colors);
  // Can neither's visit read or change what the other's writes? REQUIRES: of the open epoch
  bool are_independent(const QueueEntry& a, const QueueEntry& b,
                       const ConflictDistance& distance) const;

 private:
  void put_color(MortonKey leaf, const QueuePosition& waiting, std::uint32_t color);

  friend class RunCommits;  // writes what has changed

  LeafQueue queue_;
  std::uint64_t num_own_;
};

}  // namespace locvol
