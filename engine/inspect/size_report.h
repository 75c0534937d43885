// What sizes a run whose sizes vary has found, before anything is meshed or after.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "storage/store.h"

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

// Empty where sizes are not known, or do not vary.
SizeReport report_sizes(const Reader& reader);

// The cubes of the octree of sizes that the domain may meet, as hexahedra with the cell data `size`
// (h at their centers), `distance` (of these from the surface), `level` and `leaf`. Returns the
// numbers of cubes and bytes. Errors as PartialFile.
struct WrittenSizes {
  std::uint64_t num_cubes = 0, bytes = 0;
};
WrittenSizes write_sizes_vtu(const Reader& reader, const std::filesystem::path& file);

}  // namespace locvol
