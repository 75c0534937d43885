// What a mesh will take on the disk in each format, told from its counts before it is written.
#pragma once

#include "engine/formats/mesh_format.h"
#include "octree/geometry.h"
#include "octree/lattice.h"

namespace locvol {

// How many cells the BCC lattice has, over λ³: 12 to its cubic cell.
inline constexpr double kLatticeCellsPerVolume =
    12 / (kLatticeSpacing * kLatticeSpacing * kLatticeSpacing);

// How large a mesh is, known or estimated.
struct MeshSizes {
  double num_vertices = 0, num_cells = 0;
  double num_listed_cells = 0;  // not of the lattice core
  double num_boundary_facets = 0;
  Box box;  // how long coordinates are as text
};

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
