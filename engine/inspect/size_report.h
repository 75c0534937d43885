// What sizes a run whose sizes vary has found, before anything is meshed or after.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "engine/inspect/run_part.h"
#include "storage/records.h"

namespace locvol {

// Sizes from `least` to twice that.
struct SizeOctave {
  double least = 0;
  double volume = 0;     // of the domain, where they are so
  double num_cells = 0;  // expected there
};

struct SizeReport {
  std::uint64_t num_cubes = 0;      // that the domain may meet
  double least = 0, most = 0;       // at their centers
  std::vector<SizeOctave> octaves;  // ascending
};

// Reports sizes; empty where they are not known, or do not vary. All ranks call it and get the
// same: numbers are added up rank by rank.
SizeReport report_sizes(const RunPart& part, const RunRecord& run);

// The cubes of the octree of sizes that the domain may meet, as hexahedra with the cell data `size`
// (h at their centers), `distance` (of these from the surface), `level` and `leaf`. Called by all
// ranks, written by the first, which returns the numbers of cubes and bytes. Memory: there 32 bytes
// for each cube. Errors as PartialFile.
struct WrittenSizes {
  std::uint64_t num_cubes = 0, bytes = 0;
};
WrittenSizes write_sizes_vtu(const RunPart& part, const RunRecord& run,
                             const std::filesystem::path& file);

}  // namespace locvol
