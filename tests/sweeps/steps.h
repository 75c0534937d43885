// The steps of a run at which steps.cpp can kill it, and the letters that it logs them with.
#pragma once

#include <cstddef>
#include <iterator>
#include <string_view>

namespace locvol::sweeps {

enum class Step : std::size_t { kIngest, kLoad, kCover, kRefine, kSplit, kCommit, kExport };

struct StepName {
  std::string_view name;
  char letter;
};
inline constexpr StepName kSteps[] = {
    {"ingest", 'i'},  // a leaf's piece of the surface goes into a batch
    {"load", 'l'},    // a leaf's points are read
    {"cover", 'v'},   // a leaf gets its first points
    {"refine", 'r'},  // a leaf is refined
    {"split", 's'},   // a leaf is split
    {"commit", 'c'},  // a batch is committed
    {"export", 'e'},  // a leaf's cells are read
};

}  // namespace locvol::sweeps
