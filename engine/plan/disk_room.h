// Whether the disks have room for what a run will write, and its format numbers enough.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

#include "engine/formats/mesh_format.h"
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

// Of a store, on its disk; 0: there is none.
double bytes_held(const std::filesystem::path& store);

// Throws InputError, with the least size that would do if there is one, unless the run's store and
// its output (if it is named) will fit, as far as is known before, with the temporary files beside
// the output: on one disk, or each on its own. What the store has already is no longer needed; of a
// finished run, the counts are known.
void require_room(const RunRecord& run, const std::filesystem::path& store,
                  const std::filesystem::path& output, const OutputOptions& options,
                  const DiskOf& disk = disk_of);

// Throws FormatLimit if the run's mesh is too large for the output's format: by its own counts once
// it is done, by an estimate before.
void require_format(const RunRecord& run, const std::filesystem::path& output,
                    const OutputOptions& options);

// What the ingest of a surface takes at most of temporary files, in the store's directory.
inline constexpr double kIngestBytesPerTriangle = 181;

// Throws InputError unless there is room for the temporary files of the ingest, of which some are
// written already. `surface`: its name
void require_ingest_room(const std::string& surface, std::uint64_t num_triangles,
                         const std::filesystem::path& directory, std::uint64_t bytes_written,
                         const DiskOf& disk = disk_of);

}  // namespace locvol
