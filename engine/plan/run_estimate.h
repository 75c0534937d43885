// What a run will take, told before it: laws in the volume V and the area A of the surface, and in
// λ, fitted to whole runs (engine/README.md, "Estimates").
#pragma once

#include <array>
#include <cstdint>

#include "engine/formats/output_estimate.h"
#include "storage/records.h"

namespace locvol {

// What takes time, one after another; in the first three is a run in some Phase.
enum class RunStage { kIngest, kInitialize, kRefine, kMeasure, kWrite, kAudit };
inline constexpr std::size_t kNumStages = 5;  // of a run: no audit
// Mending is the end of refinement.
constexpr RunStage stage_of(Phase phase) {
  if (phase == Phase::kIngest) return RunStage::kIngest;
  return phase < Phase::kRefine ? RunStage::kInitialize : RunStage::kRefine;
}

// Where sizes vary: cells to h³, with those at the boundary; the lattice has fewer.
inline constexpr double kGradedCells = 4.5;
constexpr double graded_num_cells(const SizeTotals& totals) {
  return kGradedCells * (totals.of_volume - totals.of_lattice) +
         kLatticeCellsPerVolume * totals.of_lattice;
}
// More are refused there: nobody could want them.
inline constexpr double kMostCells = 1e13;

struct RunEstimate {
  double size = 0;  // λ
  // The mean thickness, 2 V/A, is below λ: too thin to tell.
  bool is_thin = false;
  // All ranges are wider by this factor: nobody has asked yet how much of the shapes with sizes is
  // inside.
  double doubt = 1;
  // Of the size λ alone: more comes where the surface asks for less, which is not known yet.
  bool is_least = false;
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

// From the estimate over this to the estimate times this: 9 of 10 runs of 31 models. It may be
// several times as much where the surface is not smooth at the scale λ, or thin.
inline constexpr double kCellsFactor = 1.15, kFileFactor = 1.2, kBytesFactor = 1.7,
                        kSecondsFactor = 2.5;

// `output`: what will be written of the mesh; it changes no time yet.
RunEstimate estimate_run(const SurfaceFacts& surface, const RunParameters& parameters,
                         int num_threads = 1, const OutputOptions& output = {});
// Of a run, as far as it has come: with its sizes once they are known; once it is done, its own
// counts.
RunEstimate estimate_run(const RunRecord& run, const OutputOptions& output, int num_threads = 1);
double estimated_num_cells(const SurfaceFacts& surface, const SizeLaw& law,
                           std::span<const SizeShape> shapes = {});
// Of all cells around a shape that has the part of it in the box filled, those that are there for
// its sake.
double estimated_num_cells_at(const SizeShape& shape, const SizeLaw& law, const Box& box);

// λ for a user who gives none: of a mesh with about half a million cells; or of more, up to five
// million, if that is what it takes to have two or so λ of thickness where the surface is of
// average thickness, 2 V/A. Rounded to two digits. 0 for a surface without volume.
double default_size(const SurfaceFacts& surface);

}  // namespace locvol
