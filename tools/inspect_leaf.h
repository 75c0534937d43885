// `locvol inspect DIR --leaf KEY`: one leaf in full.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include "engine/inspect/run_part.h"
#include "tools/arguments.h"

namespace locvol {

// Both are called by all ranks, and read by the one that has the leaf, which throws
// std::runtime_error if there is none.

// Has the first print it, and at most `limit` of each of its lists; returns how many damaged
// records this rank met.
std::uint64_t inspect_leaf(const RunPart& part, const LeafSpec& spec,
                           std::optional<std::uint64_t> limit, bool is_json);

struct WrittenLeaf {
  // Known to the first rank.
  std::uint64_t num_cells = 0, bytes = 0;
  std::vector<Fault> faults;
  std::uint64_t num_own_faults = 0;  // which this rank met
};
// Has the first write its cells as VTU.
WrittenLeaf write_leaf(const RunPart& part, const LeafSpec& spec,
                       const std::filesystem::path& file);

}  // namespace locvol
