#include "engine/plan/run_setup.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "engine/plan/octree_plan.h"
#include "engine/plan/option_table.h"
#include "engine/plan/run_estimate.h"
#include "engine/shared/input_error.h"
#include "engine/shared/number_text.h"
#include "engine/shared/standard_input.h"
#include "refine/refine_leaf.h"

namespace locvol {
namespace {

// A determinant of the predicates multiplies five lengths: within these bounds it neither overflows
// nor underflows.
constexpr double kMaxLength = 1e60, kMinLength = 1e-60;

double smallest_side(const Box& box) {
  const Point sides = box.max - box.min;
  return std::min({sides.x, sides.y, sides.z});
}

double largest_coordinate(const Box& box) {
  double largest = 0;
  for (int axis = 0; axis < 3; ++axis)
    largest = std::max({largest, std::abs(box.min[axis]), std::abs(box.max[axis])});
  return largest;
}

void check_lengths(const SurfaceFacts& surface, double size) {
  if (!(largest_coordinate(surface.box) < kMaxLength) ||
      !(max_norm(surface.box.max - surface.box.min) > kMinLength))
    throw InputError(surface.file + ": coordinates of about " +
                     rounded(largest_coordinate(surface.box)) +
                     " are beyond double arithmetic: scale the model");
  if (!(size > kMinLength) || !(size < kMaxLength))
    throw InputError("size " + decimal(size) +
                     " is beyond double arithmetic: choose a size between " + decimal(kMinLength) +
                     " and " + decimal(kMaxLength) + ", or scale the model");
}

// What the run's record keeps of an option, which is what it has by itself where none is given.
void keep(const OptionText& option, const Size& given, const Box& surface, double& kept) {
  if (given.value != 0 || option.is_required) kept = absolute_size(given, surface, option.noun);
}
void keep(const OptionText&, const std::optional<Size>& given, const Box& surface,
          std::optional<double>& kept) {
  kept = weld_length(given, surface);
}
void keep(const OptionText& option, double given, const Box&, double& kept) {
  if (given == kept) return;
  if (!(given >= option.range.least && given <= option.range.most))
    throw InputError(
        fmt::format("{} {}: {}", option.noun, decimal(given), filled(option.cure, option)));
  kept = given;
}
void keep(const OptionText& option, const std::optional<double>& given, const Box& surface,
          double& kept) {
  if (given) keep(option, *given, surface, kept);
}
void keep(const OptionText&, std::uint64_t given, const Box&, std::uint64_t& kept) { kept = given; }
void keep(const OptionText&, Initialization given, const Box&, Initialization& kept) {
  kept = given;
}
void keep(const OptionText&, InsideRule given, const Box&, InsideRule& kept) { kept = given; }
void keep(const OptionText&, bool given, const Box&, bool& kept) { kept = given; }
void keep(const OptionText&, const std::vector<std::string>& given, const Box&,
          std::vector<std::string>& kept) {
  kept = given;
}
void keep(const OptionText& option, const std::vector<SizedPart>& given, const Box& surface,
          std::vector<PartSize>& kept) {
  for (const auto& [name, size, place] : given) try {
      kept.push_back({name, absolute_size(size, surface)});
    } catch (const InputError& e) {
      throw InputError(fmt::format(
          "{}: {}", place.empty() ? fmt::format("{} {}", option.noun, name) : place, e.what()));
    }
}
// See add_shapes() and FilesOfOptions.
void keep(const OptionText&, const std::vector<SizedShape>&, const Box&, std::vector<SizeShape>&) {}
void keep(const OptionText&, const std::filesystem::path&, const Box&, std::string&) {}

// Of a box with the given side, grown by `distance` on all sides.
double volume_growth(double side, double distance) { return std::pow(1 + 2 * distance / side, 3); }

// What the visit of a leaf that wide will take, with some points more near the surface.
std::uint64_t expected_visit(const RunParameters& parameters, double side, double num_points,
                             double surface_size) {
  const double reach = kReach * parameters.size;
  // Where sizes vary, leaves far from the surface are large, and their grids coarse.
  if (!parameters.sizes().is_uniform()) side = std::min(side, 2 * start_leaf_side(parameters));
  if (parameters.init == Initialization::kPaper)
    num_points = std::max(num_points, 2 * static_cast<double>(parameters.leaf_capacity));
  const VisitSize visit{
      .volume = std::pow((side + reach) / parameters.size, 3),
      .num_points = static_cast<std::uint64_t>(1.2 * num_points * volume_growth(side, reach)),
      .surface_size = static_cast<std::uint64_t>(surface_size * volume_growth(side, reach / 2))};
  return visit.bytes_to_refine();
}

// Points of the mesh, and of a leaf at the start.
struct ExpectedPoints {
  double all, of_leaf;
};
ExpectedPoints expected_points(const RunRecord& run) {
  const double all = estimate_run(run, {}).num_vertices;
  return {all, std::min(all, 0.5 * static_cast<double>(run.parameters.leaf_capacity))};
}

std::uint64_t expected_leaves(const RunRecord& run) {
  const auto [all, of_leaf] = expected_points(run);
  return static_cast<std::uint64_t>(std::min(all / of_leaf, 1e9));
}

std::uint64_t expected_largest_visit(const RunRecord& run) {
  const auto [all, of_leaf] = expected_points(run);
  const double side = std::min(start_leaf_side(run.parameters),
                               max_norm(run.surface.box.max - run.surface.box.min));
  const VisitSize whole{.num_points = static_cast<std::uint64_t>(std::min(all, 1e12))};
  return std::min(expected_visit(run.parameters, side, of_leaf, 0), whole.bytes_to_refine());
}

std::string name_of(const std::filesystem::path& input) {
  if (input.empty()) return kInMemory;
  if (input == kFromStandardInput) return kStandardInput;
  return std::filesystem::absolute(input).string();
}

double distance_between(const SizeShape& shape, const Box& box) {
  if (shape.kind == ShapeKind::kBall)
    return std::max(0.0, std::sqrt(box.squared_distance(shape.a)) - shape.radius);
  return std::sqrt(box.squared_distance(box_of(shape)));
}

SizeShape stored_shape(const SizedShape& given, const Box& surface) {
  static_assert(static_cast<int>(SizedShape::Kind::kBall) == static_cast<int>(ShapeKind::kBall) &&
                static_cast<int>(SizedShape::Kind::kBox) == static_cast<int>(ShapeKind::kBox) &&
                static_cast<int>(SizedShape::Kind::kSegment) ==
                    static_cast<int>(ShapeKind::kSegment));
  const auto point = [](const Coordinates& c) { return Point{c[0], c[1], c[2]}; };
  SizeShape shape{.kind = static_cast<ShapeKind>(given.kind),
                  .size = absolute_size(given.size, surface),
                  .a = point(given.a),
                  .b = point(given.b),
                  .radius = given.radius};
  const Box box = box_of(shape);
  if (!(shape.radius >= 0) || !std::isfinite(dot(box.min, box.min) + dot(box.max, box.max)))
    throw InputError("give finite coordinates, and a radius of at least 0");
  if (shape.kind == ShapeKind::kBox) shape.a = box.min, shape.b = box.max;
  return shape;
}

void add_shapes(const MeshOptions& options, const Box& surface, RunParameters& parameters) {
  for (const SizedShape& given : options.shapes) {
    try {
      const SizeShape& added = parameters.shapes.emplace_back(stored_shape(given, surface));
      const double num_cells = estimated_num_cells_at(added, parameters.sizes(), surface);
      if (!(num_cells < kMostCells))
        throw InputError(fmt::format(
            "size {} asks for {:.2g} cells there: choose a size of at least {:.3g}", added.size,
            num_cells, 1.01 * added.size * std::cbrt(num_cells / kMostCells)));
    } catch (const InputError& e) {
      throw InputError(given.place + ": " + e.what());
    }
  }
}

// What stands for options that are not given, and depends on others.
void add_defaults(const MeshOptions& options, RunParameters& parameters) {
  if (options.leaf_capacity == 0) parameters.leaf_capacity = kDefaultLeafCapacity;
  if (!options.min_dihedral && options.init == Initialization::kCover && !options.is_surface_only)
    parameters.min_dihedral = kDefaultMinDihedral;
  if (options.min_size.value == 0 && parameters.follows_shape())
    parameters.min_size = kDefaultLeast * parameters.size;
  if ((options.shapes.empty() && !parameters.has_nodes()) || parameters.growth > 0) return;
  parameters.growth = kDefaultGrowth;
  if (options.max_size.value == 0) parameters.max_size = parameters.size;
}

// What does not go together.
void check_bodies(const RunRecord& run) {
  const RunParameters& p = run.parameters;
  const bool has_files = !run.surface.more_files.empty();
  if (p.has_bodies && has_files)
    throw InputError("several files are a body each: leave --bodies out");
  if (!p.voids.empty() && !p.has_bodies && !has_files)
    throw InputError("--void names one of several bodies: give --bodies, or more files");
  if (p.gap > 0 && !p.has_bodies && !has_files)
    throw InputError("--gap is what may be between bodies: give --bodies, or more files");
  if (!p.body_sizes.empty() && !p.has_bodies && !has_files)
    throw InputError(
        fmt::format("a size is given for the body '{}', one of several: give --bodies, or more "
                    "files; or give the size with --size",
                    p.body_sizes.front().name));
  if ((p.has_bodies || has_files) && p.inside == InsideRule::kWrap)
    throw InputError(
        "what is wrapped is one body: leave --wrap out, or give one file without --bodies");
  if ((p.has_bodies || has_files) && p.init == Initialization::kPaper)
    throw InputError("several bodies are meshed in cover mode only: give --init cover");
}
void check_wrap(const MeshOptions& options) {
  for (const auto& [name, length] : {std::pair("--wrap-alpha", options.wrap_alpha),
                                     std::pair("--wrap-offset", options.wrap_offset)}) {
    if (length.value == 0) continue;
    if (options.inside != InsideRule::kWrap)
      throw InputError(fmt::format("{} says how a surface is wrapped: give --wrap, too", name));
    if (length.is_percent)
      throw InputError(
          fmt::format("{} {}%: give a length; percentages are of the box of what is meshed, which "
                      "is not known before the surface is wrapped",
                      name, decimal(length.value)));
  }
}
void check_surface_only(const RunParameters& p) {
  if (!p.is_surface_only) return;
  if (p.init == Initialization::kPaper)
    throw InputError("a surface alone is meshed in cover mode only: give --init cover");
  if (p.min_dihedral > 0)
    throw InputError(
        "--min-dihedral bounds angles of cells, of which --surface-only makes none: leave one of "
        "the two out");
}
void check_sizes(const RunParameters& p) {
  if (p.growth > 0 && p.init == Initialization::kPaper)
    throw InputError("sizes vary in cover mode only: leave the growth out, or give --init cover");
  if (std::isfinite(p.max_size) && p.growth == 0)
    throw InputError("a largest size bounds what grows: give a growth, too");
  if (p.min_size > 0 && !p.follows_shape())
    throw InputError(
        "a smallest size bounds what curvature, deviation or layers ask for: give one");
  if (p.min_size > p.size)
    throw InputError("smallest size " + decimal(p.min_size) + " is above the size, " +
                     decimal(p.size) + ": give less");
  if (p.max_size < p.size)
    throw InputError("largest size " + decimal(p.max_size) + " is below the size at the surface, " +
                     decimal(p.size) + ": give more");
}

}  // namespace

void require_few_cells(const RunRecord& run) {
  const double num_cells = estimate_run(run, {}).num_cells;
  if (num_cells < kMostCells) return;
  throw InputError(fmt::format(
      "{}: the sizes, from {} on, ask for {:.2g} cells: ask for sizes {:.2g} times as large",
      run.surface.file, run.parameters.sizes().least, num_cells,
      1.01 * std::cbrt(num_cells / kMostCells)));
}

double absolute_size(const Size& spec, const Box& box, const std::string& name) {
  if (!(spec.value > 0) || !std::isfinite(spec.value))
    throw InputError(name + " " + decimal(spec.value) + (spec.is_percent ? "%" : "") +
                     ": give a finite number above 0");
  if (!spec.is_percent) return spec.value;
  const double side = smallest_side(box);
  if (side == 0 && max_norm(box.max - box.min) > 0)
    throw InputError(fmt::format(
        "{} {}%: percentages are of the smallest side of the surface's box, and this box is flat: "
        "give a length, such as {:.3g}, which is {}% of its largest side",
        name, decimal(spec.value), spec.value / 100 * max_norm(box.max - box.min),
        decimal(spec.value)));
  return spec.value / 100 * side;
}

std::optional<double> weld_length(const std::optional<Size>& weld, const Box& box) {
  if (!weld) return std::nullopt;
  return weld->value == 0 ? 0 : absolute_size(*weld, box, "weld");
}

double gap_length(const Size& gap, const Box& box) {
  return gap.value == 0 ? 0 : absolute_size(gap, box, "gap");
}

RunRecord planned_run(const MeshOptions& options, const std::string& digest, const Box& surface,
                      const FilesOfOptions& files) {
  RunRecord run;
  run.surface.file = name_of(options.input);
  for (const std::filesystem::path& file : options.more_inputs)
    run.surface.more_files.push_back(name_of(file));
  run.surface.box = surface;
  if (!options.size_image.empty())
    run.image_file = std::filesystem::absolute(options.size_image).string();
  if (!options.sharp_polylines.empty())
    run.sharp_file = std::filesystem::absolute(options.sharp_polylines).string();
  check_wrap(options);
  RunParameters& parameters = run.parameters;
  parameters.input_digest = digest;
  for_each_given_option([&](const auto& option) {
    keep(option, options.*option.given, surface, parameters.*option.kept);
  });
  parameters.size_image = files.image.digest;
  parameters.image_least = files.image.least;
  parameters.sharp_polylines = files.sharp_polylines;
  add_defaults(options, parameters);
  add_shapes(options, surface, parameters);
  check_surface_only(parameters);
  check_sizes(parameters);
  check_bodies(run);
  check_lengths(run.surface, parameters.size);
  // Ids below are those of lattice points.
  if (options.init == Initialization::kCover) run.next_point_id = kFirstOtherId;
  return run;
}

RunRecord planned_run(const MeshOptions& options, const std::string& digest,
                      const SurfaceFacts& surface, const FilesOfOptions& files) {
  RunRecord run = planned_run(options, digest, surface.box, files);
  run.surface = surface;
  return run;
}

std::vector<std::string> notes_on_shapes(const MeshOptions& options, const RunParameters& planned,
                                         const Box& surface) {
  const double most = std::min(planned.size, planned.max_size);
  std::vector<std::string> notes;
  for (std::size_t begin = 0, end = 0; begin < options.shapes.size(); begin = end) {
    double distance = std::numeric_limits<double>::infinity(), size = distance;
    // A line of several points is as many shapes, of one place.
    for (; end < options.shapes.size() && options.shapes[end].place == options.shapes[begin].place;
         ++end) {
      const double from_box = distance_between(planned.shapes[end], surface);
      distance = std::min(distance, from_box);
      size = std::min(size, planned.shapes[end].size + planned.growth * from_box);
    }
    if (distance > 0)
      notes.push_back(fmt::format(
          "{}: this shape lies outside the model, {:.3g} from the box ({}, {}, {}) to ({}, {}, {}) "
          "around it{}",
          options.shapes[begin].place, distance, surface.min.x, surface.min.y, surface.min.z,
          surface.max.x, surface.max.y, surface.max.z,
          size < most ? "" : ": it makes no cell smaller"));
  }
  return notes;
}

MemoryPlan planned_memory(const RunRecord& run, std::uint64_t cap) {
  return {cap, expected_leaves(run), expected_largest_visit(run)};
}

std::uint64_t least_memory(const RunRecord& run) {
  constexpr std::uint64_t kAnyRun = std::uint64_t{1} << 50;
  const std::uint64_t visit = expected_largest_visit(run);
  return std::max(
      kLeastMemory,
      MemoryPlan(kAnyRun, expected_leaves(run), visit).cap_with_heap(visit + kLeastCacheBytes));
}

MemoryPlan planned_memory(const Reader& reader, std::uint64_t cap) {
  const RunRecord run = reader.run().value();
  std::uint64_t num_leaves = 0, largest_visit = 0;
  reader.for_each_leaf([&](MortonKey key, const LeafInfo& info) {
    const double side = run.frame.side(key.level());
    ++num_leaves;
    if (info.has_surface() || info.num_points > 0)
      largest_visit = std::max(
          largest_visit, expected_visit(run.parameters, side, static_cast<double>(info.num_points),
                                        static_cast<double>(info.num_triangles)));
    return true;
  });
  return {cap, num_leaves, largest_visit};
}

}  // namespace locvol
