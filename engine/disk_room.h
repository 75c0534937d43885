// Whether the disks have room for what a run will write.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>

#include "storage/records.h"

namespace locvol {

struct Disk {
  std::uint64_t id = 0;
  double free_bytes = 0;  // for users who are not root
};
using DiskOf = std::function<Disk(const std::filesystem::path&)>;

// Of a file or directory, which need not exist yet.
Disk disk_of(const std::filesystem::path& place);
// The directory, or the nearest one above it that exists.
std::filesystem::path existing_directory(const std::filesystem::path& directory);

// Throws InputError, with the least size that would do, unless the run's store and its output (if
// it is named) will fit, as far as is known before: on one disk, or each on its own. What the store
// has already is no longer needed.
void require_room(const RunRecord& run, const std::filesystem::path& store,
                  const std::filesystem::path& output, const DiskOf& disk = disk_of);

}  // namespace locvol
