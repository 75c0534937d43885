// `locvol inspect DIR --leaf KEY`: one leaf in full.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include "engine/inspect/leaf_scan.h"
#include "tools/arguments.h"

namespace locvol {

// Prints it, and at most `limit` of each of its lists; returns how many damaged records it met.
// Throws std::runtime_error if there is no such leaf.
std::uint64_t inspect_leaf(const Store& store, const LeafSpec& spec,
                           std::optional<std::uint64_t> limit, bool is_json);

struct WrittenLeaf {
  std::uint64_t num_cells = 0, bytes = 0;
  std::vector<Fault> faults;
};
// Writes its cells as VTU.
WrittenLeaf write_leaf(const Store& store, const LeafSpec& spec, const std::filesystem::path& file);

}  // namespace locvol
