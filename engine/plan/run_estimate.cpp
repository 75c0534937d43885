#include "engine/plan/run_estimate.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include "engine/plan/octree_plan.h"
#include "engine/plan/options.h"
#include "octree/lattice.h"

namespace locvol {
namespace {

// At a smooth boundary, more than the lattice would have; and how that falls where the volume is
// thin: at a mean thickness 2 V/A of 0.8 λ, half of it.
constexpr double kCellsPerArea = 3.75, kThinness = 0.4;
// At most, of a layer as deep as the core lies.
constexpr double kListedPerArea = 11.7;
constexpr double kVerticesPerCell = 1.0 / 6, kVerticesPerArea = 0.43, kFacetsPerArea = 1.9;
// Where sizes vary.
constexpr double kGradedVerticesPerArea = 0.35, kGradedFacetsPerArea = 1.5;

// In the store: points, cells and the surface, compressed.
constexpr double kBytesPerListedCell = 14, kBytesPerTriangle = 14, kLeastBytes = 1e5;
// With the sizes, where they vary.
constexpr double kBytesPerGradedCell = 17;
// Without a core, and with the queue of a paper run.
constexpr double kBytesPerPaperCell = 40;

// Seconds on one core of 2.6 GHz.
constexpr double kIngestTriangle = 4.1e-6, kCoverTriangle = 0.7e-6, kCoverCell = 1.85e-6,
                 kRefineTriangle = 1e-6, kRefineCell = 3.1e-6, kMeasureCell = 0.12e-6,
                 kNumberCell = 0.3e-6, kEncodeCell = 0.05e-6;
// Where sizes vary: with the sizes, and with more holes to fill.
constexpr double kGradedCoverCell = 5e-6;
// For C7, with angles up to this.
constexpr double kImproveCell = 1.6e-6, kImprovedTo = 15;
// Of a VTU file, whatever is written.
constexpr double kWriteByte = 1e-9;
// Of each thread after the first: 9.8 s instead of 16.8 s on two.
constexpr double kFurtherThread = 0.7;

constexpr double kDoubtOfShapes = 1.6;

constexpr double kUsefulCells = 5e5, kManyCells = 5e6;

double cells_of(double volume, double area) {  // over λ³ and λ²
  if (!(volume > 0)) return 0;
  return kLatticeCellsPerVolume * volume +
         kCellsPerArea * area * volume / (volume + kThinness * area);
}

// Of a surface, as if it were a ball of the same volume and area, without shapes.
SizeTotals estimated_totals(const SizeLaw& law, const SurfaceFacts& surface) {
  SizeTotals totals{.of_area = surface.area / (law.surface * law.surface)};
  const double radius = 3 * std::abs(surface.volume) / surface.area;
  if (law.is_uniform() || !(radius > 0) || !std::isfinite(radius)) return totals;
  const auto size_beyond = [&](double margin) { return law.most * (1 + margin * law.growth); };
  constexpr int kSteps = 1000;
  for (int i = 0; i < kSteps; ++i) {  // finer where h is smaller
    const auto depth = [&](double step) { return radius * std::pow(step / kSteps, 3); };
    const double low = depth(i), high = depth(i + 1), middle = depth(i + 0.5);
    const double sum = surface.area * (high - low) * std::pow(1 - middle / radius, 2) /
                       std::pow(law.at_distance(middle), 3);
    totals.of_volume += sum;
    const double size = law.surface + law.growth * middle;  // without a bound
    if (size >= size_beyond(kLatticeMargin)) totals.of_lattice += sum;
    if (size >= size_beyond(kCoreMargin)) totals.of_core += sum;
  }
  return totals;
}

Box box_of(const SizeShape& shape) {
  if (shape.kind == ShapeKind::kBall) return Box::around(shape.a).expanded(shape.radius);
  return Box::around(shape.a).joined(shape.b);
}

// Of the places that are no farther from the shape.
double volume_around(const SizeShape& shape, double distance) {
  constexpr double kPi = std::numbers::pi;
  const double radius = shape.radius + distance, ball = 4 * kPi / 3 * std::pow(radius, 3);
  if (shape.kind == ShapeKind::kBall) return ball;
  const Point sides = shape.b - shape.a;
  if (shape.kind == ShapeKind::kSegment) return kPi * radius * radius * norm(sides) + ball;
  const auto& [x, y, z] = sides;
  return x * y * z + 2 * (x * y + y * z + z * x) * distance +
         kPi * distance * distance * (x + y + z) + ball;
}

// Cells of the core take their share from where the volume is deeper than they lie.
double listed_of(double num_cells, double area) {
  if (!(num_cells > 0) || !std::isfinite(num_cells)) return num_cells;
  const double deepest = kListedPerArea * area;
  return num_cells / std::pow(1 + std::pow(num_cells / deepest, 4), 0.25);
}

// λ of a mesh with so many cells.
double size_of(const SurfaceFacts& surface, double num_cells) {
  double low = 0, high = std::sqrt(surface.area);
  for (int i = 0; i < 100; ++i) {
    const double size = 0.5 * (low + high);
    (estimated_num_cells(surface, {.surface = size}) > num_cells ? low : high) = size;
  }
  return high;
}

double rounded_to_two_digits(double v) {
  const double unit = std::pow(10, std::floor(std::log10(v)) - 1);
  // A negative power of ten is no double, its reciprocal is.
  return unit < 1 ? std::round(v / unit) / std::round(1 / unit) : std::round(v / unit) * unit;
}

MeshSizes sizes_of(const RunEstimate& estimate, const SurfaceFacts& surface,
                   const RunParameters& parameters) {
  return {.num_vertices = estimate.num_vertices,
          .num_cells = estimate.num_cells,
          .num_listed_cells = estimate.num_listed_cells,
          .num_boundary_facets = estimate.num_boundary_facets,
          .leaf_side = start_leaf_side(parameters) / parameters.size,
          .box = surface.box};
}

}  // namespace

double RunEstimate::total_seconds() const {
  return std::accumulate(seconds.begin(), seconds.end(), 0.0);
}

// The sum of 1 / h³ over the shape and what grows around it, up to where h is λ again.
double estimated_num_cells_at(const SizeShape& shape, const SizeLaw& law, const Box& box) {
  const auto volume_within = [&](double distance) {
    const Box around = box_of(shape).expanded(distance);
    const double all = around.volume(), in_box = around.common(box).volume();
    return all > 0 ? volume_around(shape, distance) * in_box / all : 0;
  };
  const double growth = law.growth > 0 ? law.growth : kDefaultGrowth;
  const double most = std::min(law.surface, law.most);
  double before = volume_within(0), sum = before / std::pow(shape.size, 3);
  constexpr int kSteps = 40;
  for (int i = 1; i <= kSteps && shape.size < most; ++i) {
    const auto size = [&](double step) {
      return shape.size * std::pow(most / shape.size, step / kSteps);
    };
    const double volume = volume_within((size(i) - shape.size) / growth);
    sum += (volume - before) / std::pow(size(i - 0.5), 3);
    before = volume;
  }
  return kGradedCells * sum;
}

double estimated_num_cells(const SurfaceFacts& surface, const SizeLaw& law,
                           std::span<const SizeShape> shapes) {
  const double size = law.surface;
  if (!law.is_uniform()) {
    const double volume = std::abs(surface.volume);
    double at_shapes = 0;
    for (const SizeShape& shape : shapes)
      at_shapes += estimated_num_cells_at(shape, law, surface.box);
    // Shapes are put inside, or across the surface: between all and the domain's share of the box.
    // And all of it has cells no smaller than any.
    const double share = 0.5 * (1 + std::min(1.0, volume / surface.box.volume()));
    const double most = kGradedCells * volume / std::pow(law.least, 3);
    return graded_num_cells(estimated_totals(law, surface)) + std::min(most, share * at_shapes);
  }
  return cells_of(std::abs(surface.volume) / (size * size * size), surface.area / (size * size));
}

RunEstimate estimate_run(const RunRecord& run, const OutputOptions& output, int num_threads) {
  const SurfaceFacts& surface = run.surface;
  const RunParameters& parameters = run.parameters;
  const bool are_sizes_known = run.sizes.are_known();
  const SizeTotals totals =
      are_sizes_known ? run.sizes : estimated_totals(parameters.sizes(), surface);
  const double area = totals.of_area;
  const auto num_triangles = static_cast<double>(surface.num_triangles);
  const bool is_cover = parameters.init == Initialization::kCover;
  RunEstimate estimate;
  estimate.size = parameters.size;
  estimate.is_thin = 2 * std::abs(surface.volume) < parameters.size * surface.area;
  const bool is_uniform = parameters.sizes().is_uniform();
  estimate.num_cells = are_sizes_known
                           ? graded_num_cells(run.sizes)
                           : estimated_num_cells(surface, parameters.sizes(), parameters.shapes);
  if (!are_sizes_known && !parameters.shapes.empty()) estimate.doubt = kDoubtOfShapes;
  estimate.is_least = !are_sizes_known && parameters.has_nodes();
  estimate.num_vertices = kVerticesPerCell * estimate.num_cells +
                          (is_uniform ? kVerticesPerArea : kGradedVerticesPerArea) * area;
  estimate.num_listed_cells = is_cover && is_uniform
                                  ? listed_of(estimate.num_cells, area)
                                  : estimate.num_cells - kLatticeCellsPerVolume * totals.of_core;
  estimate.store_bytes = kLeastBytes + kBytesPerTriangle * num_triangles +
                         (!is_cover    ? kBytesPerPaperCell
                          : is_uniform ? kBytesPerListedCell
                                       : kBytesPerGradedCell) *
                             estimate.num_listed_cells;
  if (run.phase == Phase::kDone) {
    estimate.num_cells = static_cast<double>(run.counts.num_cells);
    estimate.num_vertices = static_cast<double>(run.counts.num_points);
    estimate.num_listed_cells = std::min(estimate.num_listed_cells, estimate.num_cells);
  }
  estimate.num_boundary_facets = (is_uniform ? kFacetsPerArea : kGradedFacetsPerArea) * area;
  estimate.output = estimate_output(output, sizes_of(estimate, surface, parameters));

  const double threads = 1 + kFurtherThread * (std::max(1, num_threads) - 1);
  const auto set = [&](RunStage stage, double cpu_seconds) {
    estimate.seconds[static_cast<std::size_t>(stage)] = cpu_seconds / threads;
  };
  set(RunStage::kIngest, kIngestTriangle * num_triangles);
  if (!is_cover) return estimate;
  const double listed = estimate.num_listed_cells;
  set(RunStage::kInitialize,
      kCoverTriangle * num_triangles + (is_uniform ? kCoverCell : kGradedCoverCell) * listed);
  const double angle = parameters.min_dihedral / kImprovedTo;
  set(RunStage::kRefine,
      kRefineTriangle * num_triangles + (kRefineCell + kImproveCell * angle * angle) * listed);
  set(RunStage::kMeasure, kMeasureCell * listed);
  set(RunStage::kWrite, kNumberCell * listed + kEncodeCell * estimate.num_cells);
  const OutputEstimate vtu =
      estimate_output({MeshFormat::kVtu}, sizes_of(estimate, surface, parameters));
  estimate.seconds[static_cast<std::size_t>(RunStage::kWrite)] += kWriteByte * vtu.file_bytes;
  return estimate;
}

RunEstimate estimate_run(const SurfaceFacts& surface, const RunParameters& parameters,
                         int num_threads, const OutputOptions& output) {
  RunRecord run;
  run.parameters = parameters;
  run.surface = surface;
  return estimate_run(run, output, num_threads);
}

double default_size(const SurfaceFacts& surface) {
  const double volume = std::abs(surface.volume);
  if (!(volume > 0) || !(surface.area > 0)) return 0;
  const double thin = volume / surface.area;  // half the mean thickness
  const double size =
      std::min(size_of(surface, kUsefulCells), std::max(thin, size_of(surface, kManyCells)));
  return rounded_to_two_digits(size);
}

}  // namespace locvol
