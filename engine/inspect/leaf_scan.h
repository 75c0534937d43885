// Reading a store that another process may be writing to, or that is damaged: piece by piece, each
// from its own short snapshot, and around the records that cannot be read.
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "octree/frame.h"
#include "storage/store.h"

namespace locvol {

// What is wrong in a store, and where. Not valid: in no leaf.
struct Fault {
  MortonKey leaf;
  std::string message;
};

// The result of `read`; on a CorruptRecord, notes the fault and gives nothing.
template <class Read>
auto read_around(std::vector<Fault>& faults, const Read& read) -> std::optional<decltype(read())> {
  try {
    return read();
  } catch (const CorruptRecord& e) {
    faults.push_back({e.leaf(), e.what()});
    return std::nullopt;
  }
}

// What a listing says of a leaf. Files have these numbers.
enum class LeafState {
  kDamaged,    // a record of it cannot be read
  kEmpty,      // no points, not waiting: outside the domain
  kUnvisited,  // has yet to be visited
  kWaiting,    // to be visited again
  kClean,
  kCore,  // not waiting, and all its points are of the lattice core: never visited
};
std::string_view state_name(LeafState state);

struct LeafRow {
  MortonKey key;
  std::optional<LeafInfo> info;  // absent if its record is damaged
  LeafUnresolved unresolved;     // if asked for
  std::vector<Fault> faults;     // of this leaf

  LeafState state() const;
};

struct QueueRow {
  QueueEntry entry;
  std::vector<Fault> faults;  // of its record
};

struct ScanOptions {
  bool reads_unresolved = false;
  bool reads_all = false;  // every record of the leaf, to find damage
};

// Visits every leaf, in Morton order, until `visit` returns false; no snapshot is held meanwhile.
// The run may go on: a leaf that is split between two pieces shows as itself or as its children,
// so that each place of the octree shows once. Damage in no leaf (a key) goes to `faults`.
void scan_leaves(const Store& store, const std::function<bool(const LeafRow&)>& visit,
                 std::vector<Fault>& faults, const ScanOptions& options = {});

// The queue, in order and in the same way. What is visited meanwhile may or may not show.
void scan_queue(const Store& store, const std::function<bool(const QueueRow&)>& visit,
                std::vector<Fault>& faults);

// The leaf whose box holds p; nothing if there is none, as outside the root.
std::optional<MortonKey> leaf_holding(const Reader& reader, const Frame& frame, const Point& p);

// Leaves whose closed box is at most `distance` from `box`, in Morton order. As
// LinearOctree::leaves_within, but reads only what lies near, and bears with missing leaves.
std::vector<MortonKey> stored_leaves_within(const Reader& reader, const Frame& frame,
                                            const Box& box, double distance);

}  // namespace locvol
