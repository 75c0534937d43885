// What the cells of a finished mesh are like: histograms of their shapes, extremes, volume.
#pragma once

#include <cstdint>
#include <vector>

#include "engine/shared/step_progress.h"
#include "octree/stop.h"
#include "storage/store.h"

namespace locvol {

// counts[i]: how many lie in edges[i] <= value < edges[i + 1]; the last bin also holds all above.
struct Histogram {
  std::vector<double> edges;  // ascending, one more than counts
  std::vector<std::uint64_t> counts;

  std::uint64_t total() const;
};

struct MeshStatistics {
  MeshStatistics();  // of a mesh without cells

  std::uint64_t num_cells = 0;  // with those of the lattice core
  std::uint64_t num_core_cells = 0;
  double volume = 0;
  double min_dihedral_degrees = 180, max_dihedral_degrees = 0;
  double max_radius_edge_ratio = 0;
  double max_circumradius = 0;  // over λ
  // In degrees, with edges at 0, 1, 3, 5, ..., 179, 180: the angles of the lattice's cells, 60 and
  // 90 degrees, are in the middle of a bin.
  Histogram dihedral_angles;      // six a cell
  Histogram min_dihedral_angles;  // one a cell, its smallest
  Histogram radius_edge_ratios;   // edges at 0.6, 0.65, ..., 2, 2.05
};

// Streams over the cells that the store lists. Those of the lattice core are all alike and are
// taken by formula, without the lattice's displacement of 2^-18 of its spacing. The result is the
// same for any number of threads. Steps are listed cells.
// Memory: for each thread a leaf, its cells, and 8 MB for the points around it.
// Throws StoreError unless the store holds a finished run; CorruptRecord, Stopped.
MeshStatistics mesh_statistics(const Store& store, int num_threads = 1,
                               const StepProgress& on_step = {}, const StopToken* stop = nullptr);

}  // namespace locvol
