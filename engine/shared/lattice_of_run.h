#pragma once

#include "octree/lattice.h"
#include "storage/records.h"

namespace locvol {

inline constexpr double kMinChildSide = 2;  // over λ, of a leaf after splits

// The lattice of a run in cover mode: its points' positions are a function of the run alone. Where
// sizes vary, that of the largest, or if there is none of the octree's cubes.
inline Lattice lattice_of(const RunRecord& run) {
  const SizeLaw law = run.parameters.sizes();
  if (law.is_uniform()) return {run.frame, law.surface, kMinChildSide * law.surface};
  if (law.has_core()) return {run.frame, law.most, kMinChildSide * law.least};
  return Lattice::of_cubes(run.frame);
}
// λ in uniform runs. Asked often: it looks at no shapes.
inline double core_size(const RunParameters& p) {
  return SizeLaw{.growth = p.growth, .most = p.max_size}.has_core() ? p.max_size : p.size;
}

}  // namespace locvol
