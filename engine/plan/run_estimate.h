// What a run will take, told before it: laws in the volume V and the area A of the surface, in how
// far apart its parts are that face each other, and in λ, fitted to whole runs (engine/README.md,
// "Estimates").
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "engine/formats/output_estimate.h"
#include "engine/plan/phases.h"
#include "storage/records.h"

namespace locvol {

// Where sizes vary: cells to h³, with those at the boundary; the lattice has fewer.
inline constexpr double kGradedCells = 4.5;
constexpr double graded_num_cells(const SizeTotals& totals) {
  return kGradedCells * (totals.of_volume - totals.of_lattice) +
         kLatticeCellsPerVolume * totals.of_lattice;
}
// More are refused there: nobody could want them.
inline constexpr double kMostCells = 1e13;

// What takes more cells than λ asks for: parts of the surface that face each other across less than
// about λ.
struct NarrowParts {
  double num_cells = 0;  // those that are there for their sake alone
  // Half of these are where it is narrower, half where it is wider.
  double distance = 0;
  bool is_outside = false;  // most of these cells are at gaps between parts, not in walls
  // The part of the area that has walls which cannot be resolved, for they are thinner than the
  // spacing floor; and how thick half of these are at most.
  double lost_area = 0, lost_distance = 0;
  double largest_size = 0;  // λ that would resolve half of these; 0: none are lost
};

struct RunEstimate {
  double size = 0;  // λ
  // The mean thickness, 2 V/A, is below λ.
  bool is_thin = false;
  // Is it known how far apart the surface's parts are? (Of runs of an older locvol it is not.)
  bool is_narrow_known = false;
  NarrowParts narrow;
  // All ranges are wider by this factor: the more, the more cells are at narrow parts; and nobody
  // has asked yet how much of the shapes with sizes is inside.
  double doubt = 1;
  // Of the size λ alone: more comes where the surface asks for less, which is not known yet.
  bool is_least = false;
  bool is_surface_only = false;  // then cells are triangles
  // These may be infinite.
  double num_cells = 0, num_vertices = 0;
  double num_listed_cells = 0;  // not of the lattice core: nearly all the work is in them
  double num_boundary_facets = 0;
  double store_bytes = 0;  // at the end; it has been larger at no time
  OutputEstimate output;
  // Seconds of each stage, on as many cores of 2.6 GHz with a disk that takes 1 GB a second. In
  // paper mode, of which no law is known, of no more than the ingest.
  std::array<double, kNumStages> seconds{};

  double total_seconds() const;
};

// From the estimate over this to the estimate times this: 9 of 10 runs of 31 models, where no doubt
// is told.
inline constexpr double kCellsFactor = 1.15, kFileFactor = 1.2, kBytesFactor = 1.7,
                        kSecondsFactor = 2.5;

// `output`: what will be written of the mesh; it changes no time yet.
RunEstimate estimate_run(const SurfaceFacts& surface, const RunParameters& parameters,
                         int num_threads = 1, const OutputOptions& output = {});
// Of a run, as far as it has come: with its sizes once they are known; once it is done, its own
// counts.
RunEstimate estimate_run(const RunRecord& run, const OutputOptions& output, int num_threads = 1);
// `has_creases`: RunRecord's, or what is known of it
double estimated_num_cells(const SurfaceFacts& surface, bool has_creases,
                           const RunParameters& parameters);
// Of a uniform run, with all else as by default.
double estimated_num_cells(const SurfaceFacts& surface, bool has_creases, double size);
// Of all cells around a shape that has the part of it in the box filled, those that are there for
// its sake.
double estimated_num_cells_at(const SizeShape& shape, const SizeLaw& law, const Box& box);

// What of an estimate is there for walls and gaps that are narrower than λ, if it is much; and what
// cannot be resolved. Each a part of a sentence; empty: nothing.
std::string narrow_text(const RunEstimate& estimate);
std::string lost_text(const RunEstimate& estimate);

// λ for a user who gives none: of a uniform mesh with about half a million cells. Where narrow
// parts take more at any λ that does not lose walls, the least λ with hardly more than that.
// Rounded to two digits. 0 for a surface without volume.
double default_size(const SurfaceFacts& surface, bool has_creases = false);
// Why that is for many more cells, as a part of a sentence; empty: it is not.
std::string default_size_reason(const SurfaceFacts& surface, bool has_creases, double size);

}  // namespace locvol
