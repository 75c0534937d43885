// RunPart is what a process sees of a run that it looks into: all of it, or what a rank's store has
// of its own; then all ranks look together.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "engine/exchange/one_rank.h"
#include "engine/inspect/leaf_scan.h"
#include "octree/shares.h"

namespace locvol {

struct RunPart {
  Exchange& exchange;
  std::filesystem::path directory;
  std::optional<Store> store;    // absent: it cannot be opened, and nothing of it is seen
  std::optional<Shares> shares;  // absent: all that is in the store is seen

  bool is_first() const { return exchange.rank() == 0; }
  bool is_of_ranks() const { return shares.has_value(); }
  bool has(MortonKey leaf) const { return !shares || shares->owner_of(leaf) == exchange.rank(); }
  // "rank 1: "; nothing, if one process has all of the run.
  std::string name() const;
};

// The part that is all of a store.
RunPart whole_run(Store store);
// A rank's part of the run that several ranks have in their stores, each of which calls it; see
// part_to_look_into(). What is damaged of the store, or of who has what, goes to `faults`.
RunPart part_of_rank(const std::filesystem::path& stores, Exchange& exchange,
                     std::vector<Fault>& faults);

// Scans the part's own leaves, as those of a store are scanned. What is damaged of others' goes to
// `faults`.
void scan_leaves(const RunPart& part, const std::function<bool(const LeafRow&)>& visit,
                 std::vector<Fault>& faults, const ScanOptions& options = {});
void scan_queue(const RunPart& part, const std::function<bool(const QueueRow&)>& visit,
                std::vector<Fault>& faults);

// The faults with the part's name in front of what they say.
std::vector<Fault> named(const RunPart& part, std::vector<Fault> faults);
// The faults of all ranks, by rank, with their names.
std::vector<Fault> gather_named(const RunPart& part, const std::vector<Fault>& faults);

}  // namespace locvol
