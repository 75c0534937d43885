#pragma once

#include "octree/lattice.h"
#include "storage/records.h"

namespace locvol {

inline constexpr double kMinChildSide = 2;  // over λ, of a leaf after splits

// The lattice of a run in cover mode: its points' positions are a function of the run alone.
inline Lattice lattice_of(const RunRecord& run) {
  if (!run.parameters.sizes().is_uniform()) return Lattice::of_cubes(run.frame);
  const double size = run.parameters.size;
  return {run.frame, size, kMinChildSide * size};
}

}  // namespace locvol
