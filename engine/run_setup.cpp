#include "engine/run_setup.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <stdexcept>

#include "engine/run_state.h"
#include "refine/cover_leaf.h"

namespace locvol {
namespace {

// A determinant of the predicates multiplies five lengths: within these bounds it neither overflows
// nor underflows.
constexpr double kMaxLength = 1e60, kMinLength = 1e-60;

// On disk: points, cells and the queue, compressed.
constexpr double kBytesPerCell = 40;

std::string decimal(double v) {  // the shortest that reads back as v
  std::array<char, 32> text;
  return {text.data(), std::to_chars(text.data(), text.data() + text.size(), v).ptr};
}

std::string rounded(double v) {
  std::array<char, 32> text;
  return {
      text.data(),
      std::to_chars(text.data(), text.data() + text.size(), v, std::chars_format::general, 3).ptr};
}

double smallest_side(const Box& box) {
  const Point sides = box.max - box.min;
  return std::min({sides.x, sides.y, sides.z});
}

double largest_side(const Box& box) {
  const Point sides = box.max - box.min;
  return std::max({sides.x, sides.y, sides.z});
}

double largest_coordinate(const Box& box) {
  double largest = 0;
  for (int axis = 0; axis < 3; ++axis)
    largest = std::max({largest, std::abs(box.min[axis]), std::abs(box.max[axis])});
  return largest;
}

void check_lengths(const SurfaceFacts& surface, double size) {
  if (!(largest_coordinate(surface.box) < kMaxLength) || !(largest_side(surface.box) > kMinLength))
    throw InputError(surface.file + ": coordinates of about " +
                     rounded(largest_coordinate(surface.box)) +
                     " are beyond double arithmetic: scale the model");
  if (!(size > kMinLength) || !(size < kMaxLength))
    throw InputError("size " + decimal(size) +
                     " is beyond double arithmetic: choose a size between " + decimal(kMinLength) +
                     " and " + decimal(kMaxLength) + ", or scale the model");
}

void check_options(const MeshOptions& options) {
  if (!(options.radius_edge_bound >= 2) || !std::isfinite(options.radius_edge_bound))
    throw InputError("radius-edge bound " + decimal(options.radius_edge_bound) +
                     ": give a finite number of at least 2; below it refinement need not end");
  if (!(options.spacing_floor >= 0) || !(options.spacing_floor <= 0.5))
    throw InputError("spacing floor " + decimal(options.spacing_floor) +
                     ": give a fraction of the size from 0 to 0.5");
}

// Wide enough for a leaf filled with lattice points to half of its capacity.
double start_leaf_side(const RunParameters& parameters) {
  const double lattice_density = 2 / (kLatticeSpacing * kLatticeSpacing * kLatticeSpacing);
  const double side =
      std::cbrt(0.5 * static_cast<double>(parameters.leaf_capacity) / lattice_density);
  return std::max(side, kMinLeafSide) * parameters.size;
}

Frame frame_around(const RunParameters& parameters, const Box& surface, double leaf_side) {
  const double margin = 0.5 * parameters.size + 0.01 * largest_side(surface);
  try {
    return Frame::around(surface, margin, leaf_side);
  } catch (const std::invalid_argument& e) {
    throw InputError("size " + decimal(parameters.size) + " is too small for this surface (" +
                     e.what() + "): choose a larger size or move the model to the origin");
  }
}

// The cells of the lattice core take next to nothing. The others, between the surface and a depth
// of some 4 λ, are about 16 to λ², where they do not meet those of another sheet.
double store_bytes(const RunRecord& run) {
  const double size = run.parameters.size;
  const double num_cells = estimated_num_cells(run.surface, size);
  if (run.parameters.init == Initialization::kPaper) return kBytesPerCell * num_cells;
  return kBytesPerCell * std::min(num_cells, 16 * run.surface.area / (size * size));
}

// The least size, within a tenth, whose mesh fits.
double least_size_that_fits(const RunRecord& run, double free_bytes) {
  RunRecord larger = run;
  while (store_bytes(larger) > free_bytes) larger.parameters.size *= 1.1;
  return larger.parameters.size;
}

// Of a box with the given side, grown by `distance` on all sides.
double volume_growth(double side, double distance) { return std::pow(1 + 2 * distance / side, 3); }

// What the visit of a leaf that wide will take, with some points more near the surface.
std::uint64_t expected_visit(const RunParameters& parameters, double side, double num_points,
                             double num_triangles) {
  const double reach = kReach * parameters.size;
  if (parameters.init == Initialization::kPaper)
    num_points = std::max(num_points, 2 * static_cast<double>(parameters.leaf_capacity));
  const VisitSize visit{
      .volume = std::pow((side + reach) / parameters.size, 3),
      .num_points = static_cast<std::uint64_t>(1.2 * num_points * volume_growth(side, reach)),
      .num_triangles = static_cast<std::uint64_t>(num_triangles * volume_growth(side, reach / 2))};
  return visit.bytes_to_refine();
}

const char* name_of(Initialization init) {
  return init == Initialization::kCover ? "cover" : "paper";
}

}  // namespace

double absolute_size(const SizeSpec& spec, const Box& box) {
  if (!(spec.value > 0) || !std::isfinite(spec.value))
    throw InputError("size " + decimal(spec.value) + (spec.is_percent ? "%" : "") +
                     ": give a finite number above 0");
  return spec.is_percent ? spec.value / 100 * smallest_side(box) : spec.value;
}

RunRecord planned_run(const MeshOptions& options, const std::string& digest, const Box& surface) {
  check_options(options);
  RunRecord run;
  run.surface.file =
      options.input.empty() ? kInMemory : std::filesystem::absolute(options.input).string();
  run.surface.box = surface;
  run.parameters = {
      .input_digest = digest,
      .size = absolute_size(options.size, surface),
      .radius_edge_bound = options.radius_edge_bound,
      .spacing_floor = options.spacing_floor,
      .leaf_capacity = options.leaf_capacity > 0 ? options.leaf_capacity : kDefaultLeafCapacity,
      .init = options.init,
      .seed = options.seed};
  check_lengths(run.surface, run.parameters.size);
  // Ids below are those of lattice points.
  if (options.init == Initialization::kCover) run.next_point_id = kFirstOtherId;
  return run;
}

OctreePlan plan_octree(const RunParameters& parameters, const Box& surface) {
  const double leaf_side = start_leaf_side(parameters);
  OctreePlan plan{.frame = frame_around(parameters, surface, leaf_side)};
  if (parameters.init == Initialization::kPaper) return plan;
  const double least_size = plan.frame.side(0) / (kLatticeSpacing * (kMaxSiteIndex - 8));
  if (parameters.size < least_size)
    throw InputError("size " + decimal(parameters.size) +
                     " is too small for this surface: the lattice would have more than 2^20 cells "
                     "to a side; choose a size of at least " +
                     rounded(1.01 * least_size));
  plan.level = plan.frame.level_of_side(leaf_side);
  return plan;
}

// The lattice has 2.2 cells to λ³, and up to 2.6 were measured of whole meshes less the surface
// layer, which has about 8 to λ².
double estimated_num_cells(const SurfaceFacts& surface, double size) {
  return 2.4 * std::abs(surface.volume) / (size * size * size) + 8 * surface.area / (size * size);
}

void check_room(const RunRecord& run, double free_bytes) {
  const double num_cells = estimated_num_cells(run.surface, run.parameters.size);
  if (store_bytes(run) <= free_bytes) return;
  throw InputError(
      "size " + decimal(run.parameters.size) + " would make about " + rounded(num_cells) +
      " tetrahedra of " + run.surface.file + ", and their store would take about " +
      rounded(store_bytes(run) / 1e9) + " GB where " + rounded(free_bytes / 1e9) +
      " GB are free: choose a size of at least " + rounded(least_size_that_fits(run, free_bytes)) +
      ", or a store on a larger disk");
}

std::filesystem::path existing_directory(const std::filesystem::path& directory) {
  std::filesystem::path existing = std::filesystem::absolute(directory);
  while (!std::filesystem::is_directory(existing) && existing.has_relative_path())
    existing = existing.parent_path();
  return existing;
}

double free_bytes_at(const std::filesystem::path& directory) {
  return static_cast<double>(std::filesystem::space(existing_directory(directory)).available);
}

MemoryPlan planned_memory(const RunRecord& run, std::uint64_t cap) {
  const double all_points = estimated_num_cells(run.surface, run.parameters.size) / 6;
  const double leaf_points =
      std::min(all_points, 0.5 * static_cast<double>(run.parameters.leaf_capacity));
  const double side = std::min(start_leaf_side(run.parameters), largest_side(run.surface.box));
  const double num_leaves = std::min(all_points / leaf_points, 1e9);
  const VisitSize all{.num_points = static_cast<std::uint64_t>(std::min(all_points, 1e12))};
  return {cap, static_cast<std::uint64_t>(num_leaves),
          std::min(expected_visit(run.parameters, side, leaf_points, 0), all.bytes_to_refine())};
}

MemoryPlan planned_memory(const Reader& reader, std::uint64_t cap) {
  const RunRecord run = reader.run().value();
  std::uint64_t num_leaves = 0, largest_visit = 0;
  reader.for_each_leaf([&](MortonKey key, const LeafInfo& info) {
    const double side = run.frame.side(key.level());
    ++num_leaves;
    if (info.num_triangles > 0 || info.num_points > 0)
      largest_visit = std::max(
          largest_visit, expected_visit(run.parameters, side, static_cast<double>(info.num_points),
                                        static_cast<double>(info.num_triangles)));
    return true;
  });
  return {cap, num_leaves, largest_visit};
}

void require_same_run(const RunParameters& held, const RunParameters& asked,
                      const std::filesystem::path& store) {
  std::string differences;
  const auto compare = [&](const char* name, const std::string& held_value,
                           const std::string& asked_value) {
    if (held_value == asked_value) return;
    differences += std::string(differences.empty() ? "" : "; ") + name + ": " + held_value +
                   " in the store, " + asked_value + " asked for";
  };
  compare("digest of the input", held.input_digest, asked.input_digest);
  compare("size", decimal(held.size), decimal(asked.size));
  compare("radius-edge bound", decimal(held.radius_edge_bound), decimal(asked.radius_edge_bound));
  compare("spacing floor", decimal(held.spacing_floor), decimal(asked.spacing_floor));
  compare("leaf capacity", std::to_string(held.leaf_capacity), std::to_string(asked.leaf_capacity));
  compare("initialization", name_of(held.init), name_of(asked.init));
  compare("seed", std::to_string(held.seed), std::to_string(asked.seed));
  if (differences.empty()) return;
  throw StoreMismatch("the store " + store.string() + " holds another run (" + differences +
                      "): give the same input and parameters to go on with it, another store, or "
                      "force a new run over it");
}

}  // namespace locvol
