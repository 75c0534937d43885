// What a mesh will take on the disk in each format, told from its counts before it is written.
#pragma once

#include "engine/formats/mesh_format.h"
#include "engine/formats/mesh_sizes.h"
#include "octree/lattice.h"

namespace locvol {

// How many cells the BCC lattice has, over λ³: 12 to its cubic cell.
inline constexpr double kLatticeCellsPerVolume =
    12 / (kLatticeSpacing * kLatticeSpacing * kLatticeSpacing);

struct OutputEstimate {
  double file_bytes = 0;  // of all files of the output
  // Nameless files beside the output: while the boundary is sought, before the file is begun, and
  // while the file is written.
  double bytes_before = 0, bytes_beside = 0;

  // What the disk must have room for, at the worst moment.
  double disk_bytes() const;
};

// Constants are from measurement: README.md, "Size".
OutputEstimate estimate_output(const OutputOptions& output, const MeshSizes& mesh);

}  // namespace locvol
