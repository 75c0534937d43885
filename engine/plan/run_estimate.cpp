#include "engine/plan/run_estimate.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <span>
#include <vector>

#include "engine/plan/options.h"
#include "octree/lattice.h"
#include "refine/cover_leaf.h"
#include "refine/measure_leaf.h"

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
// At narrow parts, where most vertices are on the boundary.
constexpr double kVerticesPerNarrowCell = 0.32, kFacetsPerNarrowCell = 0.6;

// In the store: points, cells and the surface, compressed.
constexpr double kBytesPerListedCell = 14, kBytesPerTriangle = 10, kLeastBytes = 1e5;
// With the sizes, where they vary.
constexpr double kBytesPerGradedCell = 17;
// Besides: leaves with narrow parts are written more often.
constexpr double kBytesPerNarrowCell = 6;
// Without a core, and with the queue of a paper run.
constexpr double kBytesPerPaperCell = 40;

// Seconds on one core of 2.6 GHz.
constexpr double kIngestTriangle = 4.1e-6, kCoverTriangle = 0.7e-6, kCoverCell = 1.85e-6,
                 kRefineTriangle = 1e-6, kRefineCell = 3.1e-6, kMeasureCell = 0.12e-6,
                 kNumberCell = 0.3e-6, kEncodeCell = 0.05e-6;
// Of the surface alone.
constexpr double kBytesPerListedFacet = 21, kCoverFacet = 2.2e-6, kRefineFacet = 3e-6,
                 kWriteFacet = 0.6e-6;
// Of second order besides, with the nodes.
constexpr double kNumberEdges = 1.1e-6, kEncodeNodes = 0.12e-6;
// Where sizes vary: with the sizes, and with more holes to fill.
constexpr double kGradedCoverCell = 5e-6;
// For C7, with angles up to this.
constexpr double kImproveCell = 1.6e-6, kImprovedTo = 15;
// At narrow parts, a third of an insertion.
constexpr double kNarrowCell = 40e-6;
// Of a VTU file, whatever is written.
constexpr double kWriteByte = 1e-9;
// Of each thread after the first: 9.8 s instead of 16.8 s on two.
constexpr double kFurtherThread = 0.7;

constexpr double kDoubtOfShapes = 1.6;
// Where all cells are at narrow parts.
constexpr double kDoubtOfNarrow = 0.6;

constexpr double kUsefulCells = 5e5, kManyCells = 1e6;
// What narrow parts take may be so much more than it takes at the largest λ that keeps walls, which
// is one that loses at most this part of the area.
constexpr double kMoreForShape = 1.15, kLostArea = 0.01;

double boundary_cells(double depth) { return kCellsPerArea * depth / (depth + kThinness); }

double cells_of(double volume, double area) {  // over λ³ and λ²
  if (!(volume > 0)) return 0;
  return kLatticeCellsPerVolume * volume + area * boundary_cells(volume / area);
}

// ---- Narrow parts: all in h, the size at the surface, and in cells to h² of one of two sheets
// ----
//
// Two sheets at a distance t are told apart by points about as close (refine/ALGORITHM.md, "It
// ends"): so they take as many cells as their area has squares of t².

// Of a wall between two planes; less where it is wider, for then it is told apart without more.
double wall_cells(double t) { return 1.87 * (1 - 0.15 * t) / (t * t); }
// Of a gap, besides those of the bodies on both sides; none from 1 on.
double gap_cells(double t) { return 2.75 / (t * t) * std::exp(-4 * t * t); }
// Around a thread of the inside, few points see that it is not flat: some to h of its length, if it
// is closed to a ring or joins others, and none if it ends. Where it is thicker, its cells are
// fewer than those of sheets, for what is cut off from it.
double rod_cells(double t) {
  const double depth = t / 5;  // volume to area, between a rod's and a ball's
  const double cut = depth * depth / (depth * depth + 0.09);
  return std::max(0.8 / t, cut * cells_of(depth, 1));
}
// Likewise, around a thread of the outside.
double hole_cells(double t) { return 3 / t * std::exp(-t * t); }

// Where sides are sampled each by itself, a wall between two has one layer of cells as wide as the
// size: a few more where it is thinner, for those along its rims, and for bends.
double layer_cells(double t) { return t < kMirrorReach ? 3 + 0.06 / t : 0; }

// Beyond what cells_of() has for the volume between the sheets.
double more_in_wall(double cells, double t) { return std::max(0.0, cells - cells_of(t / 2, 1)); }
double more_in_rod(double t) { return rod_cells(t) - cells_of(t / 5, 1); }
// Where sizes vary, the volume's share is kGradedCells · t / 2, of which so much has been found.
double more_in_graded_wall(double cells, double t, double found) {
  return std::max(0.0, std::max(cells, cells_of(t / 2, 1)) - found * kGradedCells * t / 2);
}

class NarrowLaw {
 public:
  // `sizes`: those of the run, if they vary and are known
  NarrowLaw(const SurfaceFacts& surface, bool has_creases, const RunParameters& parameters,
            const SizeTotals* sizes)
      : parameters_(parameters),
        has_creases_(has_creases),
        is_uniform_(parameters.sizes().is_uniform()),
        are_sizes_known_(sizes != nullptr),
        size_(parameters.size) {
    if (sizes != nullptr && sizes->of_area > 0)
      size_ = std::clamp(std::sqrt(surface.area / sizes->of_area), parameters.sizes().least, size_);
    place_area_ = surface.facing.num_places > 0
                      ? surface.area / static_cast<double>(surface.facing.num_places)
                      : 0;
  }

  // More than cells_of(), or graded_num_cells(), have; fewer, where it is below 0.
  double more_cells(const FacingPlaces& places) const {
    const auto of = [&](std::uint32_t count, double size, const auto& cells) {
      if (count == 0) return 0.0;
      const double t = distance_over(places, size);
      return t > 0 ? count * place_area_ / (size * size) * cells(t) : 0.0;
    };
    const double rods = is_uniform_ ? of(places.num_rods, size_, more_in_rod) : 0;
    const double size = size_in_wall(places);
    const auto in_wall = [&](double t) {
      const double cells = has_creases_ ? layer_cells(t) : wall_cells(t);
      return is_uniform_ ? more_in_wall(cells, t) : more_in_graded_wall(cells, t, found(t, size));
    };
    return rods + of(places.num_walls, size, in_wall) + cells_at_gaps(places);
  }
  double cells_at_gaps(const FacingPlaces& places) const {
    const double t = distance_over(places, size_);
    if (!(t > 0) || has_creases_) return 0;
    return place_area_ / (size_ * size_) *
           (places.num_gaps * gap_cells(t) + places.num_holes * hole_cells(t));
  }
  bool are_walls_lost(const FacingPlaces& places) const {
    return !(distance_over(places, size_in_wall(places)) > 0);
  }

 private:
  static double distance(double step) { return std::exp2(step / FacingPlaces::kStepsPerOctave); }

 public:
  static double middle(const FacingPlaces& places) { return distance(places.step + 0.5); }

 private:
  // In sizes. 0: below the spacing floor, where nothing is told apart.
  double distance_over(const FacingPlaces& places, double size) const {
    const double floor = parameters_.spacing_floor;
    if (distance(places.step + 1) < floor * size) return 0;
    return std::max(middle(places) / size, floor);
  }
  // An octree of sizes finds volume by its cubes' corners, and misses what is thinner than they
  // are. Before it is known, volume counts as if all had the size at the surface without layers.
  double found(double t, double size) const {
    return are_sizes_known_ ? std::min(1.0, t / 2.5) : std::pow(size / size_, 3);
  }
  // Layers make it smaller (refine/measure_leaf.h).
  double size_in_wall(const FacingPlaces& places) const {
    if (!(parameters_.layers > 0)) return size_;
    const double size = middle(places) / (kLayer * parameters_.layers);
    return std::clamp(size, std::min(parameters_.sizes().least, size_), size_);
  }

  const RunParameters& parameters_;
  const bool has_creases_;  // then sides are sampled each by itself
  bool is_uniform_, are_sizes_known_;
  double size_;        // at the surface, on average
  double place_area_;  // what a place stands for
};

// The distance that half of the weight is below.
double median(std::span<const FacingPlaces> places, double all, const auto& weight) {
  double sum = 0;
  for (const FacingPlaces& some : places)
    if ((sum += weight(some)) >= all / 2) return NarrowLaw::middle(some);
  return 0;
}

NarrowParts narrow_parts(const SurfaceFacts& surface, bool has_creases,
                         const RunParameters& parameters, const SizeTotals* sizes) {
  const NarrowLaw law(surface, has_creases, parameters, sizes);
  const std::vector<FacingPlaces>& places = surface.facing.places;
  const auto more = [&](const FacingPlaces& some) { return std::max(0.0, law.more_cells(some)); };
  const auto lost = [&](const FacingPlaces& some) {
    return law.are_walls_lost(some) ? static_cast<double>(some.num_walls) : 0.0;
  };
  NarrowParts parts;
  double positive = 0, at_gaps = 0, num_lost = 0;
  for (const FacingPlaces& some : places) {
    parts.num_cells += law.more_cells(some);
    positive += more(some);
    at_gaps += law.cells_at_gaps(some);
    num_lost += lost(some);
  }
  parts.distance = median(places, positive, more);
  parts.is_outside = at_gaps > positive / 2;
  if (num_lost > 0) {
    parts.lost_area = num_lost / static_cast<double>(surface.facing.num_places);
    parts.lost_distance = median(places, num_lost, lost);
    parts.largest_size = parts.lost_distance / parameters.spacing_floor;
  }
  return parts;
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

double rounded_to_two_digits(double v) {
  const double unit = std::pow(10, std::floor(std::log10(v)) - 1);
  // A negative power of ten is no double, its reciprocal is.
  return unit < 1 ? std::round(v / unit) / std::round(1 / unit) : std::round(v / unit) * unit;
}

MeshSizes sizes_of(const RunEstimate& estimate, const RunRecord& run) {
  const bool has_cells = !estimate.is_surface_only;
  return {.num_vertices = estimate.num_vertices,
          .num_cells = has_cells ? estimate.num_cells : 0,
          .num_listed_cells = has_cells ? estimate.num_listed_cells : 0,
          .num_boundary_facets = estimate.num_boundary_facets,
          .has_creases = run.has_creases,
          .box = run.surface.box};
}

// `area`: over h²
RunEstimate estimate_surface(const RunRecord& run, double area, const OutputOptions& output,
                             int num_threads) {
  const bool is_uniform = run.parameters.sizes().is_uniform();
  const auto num_triangles = static_cast<double>(run.surface.num_triangles);
  RunEstimate estimate;
  estimate.size = run.parameters.size;
  estimate.is_surface_only = true;
  estimate.is_narrow_known = run.surface.facing.num_places > 0;
  estimate.is_least = !run.sizes.are_known() && run.parameters.has_nodes();
  if (!run.sizes.are_known() && !run.parameters.shapes.empty()) estimate.doubt = kDoubtOfShapes;
  const bool is_done = run.phase == Phase::kDone;
  const double num_facets = is_done ? static_cast<double>(run.counts.num_cells)
                                    : (is_uniform ? kFacetsPerArea : kGradedFacetsPerArea) * area;
  estimate.num_cells = estimate.num_listed_cells = estimate.num_boundary_facets = num_facets;
  estimate.num_vertices = is_done ? static_cast<double>(run.counts.num_points) : num_facets / 2;
  estimate.store_bytes =
      kLeastBytes + kBytesPerTriangle * num_triangles + kBytesPerListedFacet * num_facets;
  estimate.output = estimate_output(output, sizes_of(estimate, run));
  const double threads = 1 + kFurtherThread * (std::max(1, num_threads) - 1);
  const auto set = [&](RunStage stage, double cpu_seconds) {
    estimate.seconds[static_cast<std::size_t>(stage)] = cpu_seconds / threads;
  };
  set(RunStage::kIngest, kIngestTriangle * num_triangles);
  set(RunStage::kInitialize, kCoverTriangle * num_triangles + kCoverFacet * num_facets);
  set(RunStage::kRefine, kRefineTriangle * num_triangles + kRefineFacet * num_facets);
  set(RunStage::kWrite, kWriteFacet * num_facets);
  return estimate;
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

namespace {

// Without what narrow parts take.
double num_wide_cells(const SurfaceFacts& surface, const SizeLaw& law,
                      std::span<const SizeShape> shapes) {
  const double size = law.surface, volume = std::abs(surface.volume);
  if (law.is_uniform())
    return cells_of(volume / (size * size * size), surface.area / (size * size));
  double at_shapes = 0;
  for (const SizeShape& shape : shapes)
    at_shapes += estimated_num_cells_at(shape, law, surface.box);
  // Shapes are put inside, or across the surface: between all and the domain's share of the box.
  // And all of it has cells no smaller than any.
  const double share = 0.5 * (1 + std::min(1.0, volume / surface.box.volume()));
  const double most = kGradedCells * volume / std::pow(law.least, 3);
  return graded_num_cells(estimated_totals(law, surface)) + std::min(most, share * at_shapes);
}

// Something is left of each part of the surface, be it as small as it may.
double with_narrow(double num_wide, const NarrowParts& narrow, const SurfaceFacts& surface) {
  const auto num_components = static_cast<double>(surface.num_components);
  return num_wide > 0 ? std::max(num_wide + narrow.num_cells, num_components) : 0;
}

RunParameters uniform_parameters(double size) {
  RunParameters parameters;
  parameters.size = size;
  parameters.spacing_floor = MeshOptions().spacing_floor;
  return parameters;
}

}  // namespace

double estimated_num_cells(const SurfaceFacts& surface, bool has_creases,
                           const RunParameters& parameters) {
  return with_narrow(num_wide_cells(surface, parameters.sizes(), parameters.shapes),
                     narrow_parts(surface, has_creases, parameters, nullptr), surface);
}

double estimated_num_cells(const SurfaceFacts& surface, bool has_creases, double size) {
  return estimated_num_cells(surface, has_creases, uniform_parameters(size));
}

RunEstimate estimate_run(const RunRecord& run, const OutputOptions& output, int num_threads) {
  const SurfaceFacts& surface = run.surface;
  const RunParameters& parameters = run.parameters;
  const bool are_sizes_known = run.sizes.are_known();
  const SizeTotals totals =
      are_sizes_known ? run.sizes : estimated_totals(parameters.sizes(), surface);
  const double area = totals.of_area;
  if (parameters.is_surface_only) return estimate_surface(run, area, output, num_threads);
  const auto num_triangles = static_cast<double>(surface.num_triangles);
  const bool is_cover = parameters.init == Initialization::kCover;
  RunEstimate estimate;
  estimate.size = parameters.size;
  estimate.is_thin = 2 * std::abs(surface.volume) < parameters.size * surface.area;
  const bool is_uniform = parameters.sizes().is_uniform();
  const double num_wide = are_sizes_known
                              ? graded_num_cells(run.sizes)
                              : num_wide_cells(surface, parameters.sizes(), parameters.shapes);
  estimate.is_narrow_known = surface.facing.num_places > 0;
  estimate.narrow =
      narrow_parts(surface, run.has_creases, parameters, are_sizes_known ? &run.sizes : nullptr);
  estimate.num_cells = with_narrow(num_wide, estimate.narrow, surface);
  const double num_narrow = estimate.num_cells - num_wide;
  if (!are_sizes_known && !parameters.shapes.empty()) estimate.doubt = kDoubtOfShapes;
  estimate.doubt *= 1 + kDoubtOfNarrow * std::clamp(num_narrow / estimate.num_cells, 0.0, 1.0);
  estimate.is_least = !are_sizes_known && parameters.has_nodes();
  estimate.num_vertices = kVerticesPerCell * num_wide +
                          (is_uniform ? kVerticesPerArea : kGradedVerticesPerArea) * area +
                          kVerticesPerNarrowCell * num_narrow;
  estimate.num_listed_cells =
      num_narrow + (is_cover && is_uniform ? listed_of(num_wide, area)
                                           : num_wide - kLatticeCellsPerVolume * totals.of_core);
  estimate.store_bytes = kLeastBytes + kBytesPerTriangle * num_triangles +
                         (!is_cover    ? kBytesPerPaperCell
                          : is_uniform ? kBytesPerListedCell
                                       : kBytesPerGradedCell) *
                             estimate.num_listed_cells +
                         kBytesPerNarrowCell * std::max(0.0, num_narrow);
  if (run.phase == Phase::kDone) {
    estimate.num_cells = static_cast<double>(run.counts.num_cells);
    estimate.num_vertices = static_cast<double>(run.counts.num_points);
    estimate.num_listed_cells = std::min(estimate.num_listed_cells, estimate.num_cells);
  }
  estimate.num_boundary_facets = (is_uniform ? kFacetsPerArea : kGradedFacetsPerArea) * area +
                                 kFacetsPerNarrowCell * std::max(0.0, num_narrow);
  estimate.output = estimate_output(output, sizes_of(estimate, run));

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
  set(RunStage::kRefine, kRefineTriangle * num_triangles +
                             (kRefineCell + kImproveCell * angle * angle) * listed +
                             kNarrowCell * std::max(0.0, num_narrow));
  set(RunStage::kMeasure, kMeasureCell * listed);
  const bool is_second = output.order == 2;
  set(RunStage::kWrite, (kNumberCell + (is_second ? kNumberEdges : 0)) * listed +
                            (kEncodeCell + (is_second ? kEncodeNodes : 0)) * estimate.num_cells);
  const OutputEstimate vtu =
      estimate_output({.format = MeshFormat::kVtu, .order = output.order}, sizes_of(estimate, run));
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

std::string narrow_text(const RunEstimate& estimate) {
  const NarrowParts& narrow = estimate.narrow;
  constexpr double kMuch = 0.2;
  if (!(narrow.num_cells > kMuch * estimate.num_cells) || !(narrow.distance > 0)) return {};
  return fmt::format("{:.0f}% of them {} about {:.2g} {}, {:.2g} λ",
                     100 * narrow.num_cells / estimate.num_cells,
                     narrow.is_outside ? "at gaps" : "in walls", narrow.distance,
                     narrow.is_outside ? "wide" : "thick", narrow.distance / estimate.size);
}

std::string lost_text(const RunEstimate& estimate) {
  const NarrowParts& narrow = estimate.narrow;
  if (!(narrow.lost_area > kLostArea)) return {};
  return fmt::format(
      "walls about {:.2g} thick, {:.2g}% of the area, are too thin for this size: they would stay "
      "unresolved; choose one below {:.2g}",
      narrow.lost_distance, 100 * narrow.lost_area, narrow.largest_size);
}

std::string default_size_reason(const SurfaceFacts& surface, bool has_creases, double size) {
  if (!(estimated_num_cells(surface, has_creases, size) > kManyCells)) return {};
  constexpr double kLarger = 3;  // where cells are there for walls alone
  RunRecord run;
  run.surface = surface;
  run.has_creases = has_creases;
  run.parameters = uniform_parameters(kLarger * size);
  const RunEstimate estimate = estimate_run(run, {});
  if (!(estimate.narrow.num_cells > 0.5 * estimate.num_cells)) return {};
  return fmt::format("for its {} about {:.2g} {} take about {:.2g} million at any size",
                     estimate.narrow.is_outside ? "gaps" : "walls", estimate.narrow.distance,
                     estimate.narrow.is_outside ? "wide" : "thick", estimate.num_cells / 1e6);
}

double default_size(const SurfaceFacts& surface, bool has_creases) {
  if (!(std::abs(surface.volume) > 0) || !(surface.area > 0)) return 0;
  // The largest size up to `most` for which is_fine() holds, as it does for all that are smaller.
  const auto largest = [](double most, const auto& is_fine) {
    double low = 0;
    for (int i = 0; i < 100; ++i) {
      const double size = 0.5 * (low + most);
      (is_fine(size) ? low : most) = size;
    }
    return most;
  };
  const double most = largest(std::sqrt(surface.area), [&](double size) {
    return narrow_parts(surface, has_creases, uniform_parameters(size), nullptr).lost_area <=
           kLostArea;
  });
  const double num_cells = std::max(
      kUsefulCells, kMoreForShape * estimated_num_cells(surface, has_creases, 0.999 * most));
  const double size = largest(most, [&](double finer) {
    return estimated_num_cells(surface, has_creases, finer) > num_cells;
  });
  const double rounded = rounded_to_two_digits(size);
  return rounded < most ? rounded : rounded_to_two_digits(0.95 * size);
}

}  // namespace locvol
