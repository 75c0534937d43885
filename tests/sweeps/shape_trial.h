// Meshes one case of the sweep of shapes with the command, as its users do, and judges what came of
// it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "tests/sweeps/limited_run.h"
#include "tests/sweeps/shapes/shape_case.h"

namespace locvol::sweeps {

struct TrialResult : Judgment {
  double seconds = 0;  // of CPU time: they depend little on what else runs
  std::uint64_t num_cells = 0, num_boundary_vertices = 0, num_unresolved = 0;
  double volume_shift = 0;  // difference of the volumes over area and λ
  // Of creases: from point to point along them, and what of it is no path of edges of the mesh.
  double crease_length = 0, lost_crease_length = 0;
  double min_dihedral_degrees = 180;
  std::uint64_t num_poor_cells = 0;    // with a smaller angle than asked for
  std::uint64_t num_forced_cells = 0;  // of these, those that the surface has no more room for
};

// The words of the command for a surface in that directory.
std::vector<std::string> mesh_command(const ShapeCase& shape_case,
                                      const std::filesystem::path& directory, int num_threads);

// Uses the directory, which it leaves as it was. A process that takes longer than the limit, in
// seconds of CPU time, is ended.
TrialResult try_case(const ShapeCase& shape_case, const std::filesystem::path& directory,
                     double limit);

}  // namespace locvol::sweeps
