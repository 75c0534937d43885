#include "tests/sweeps/shapes/shape_case.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "tests/sweeps/shapes/dice.h"
#include "tests/sweeps/shapes/families.h"

namespace locvol::sweeps {
namespace {

constexpr std::size_t kMaxTriangles = 20'000;

// The changes that a solid goes through after its family has made it, with a word on each.
class Changes {
 public:
  Changes(ShapeCase& changed, Dice& dice) : case_(changed), dice_(dice) {}

  void refine_triangulation() {
    const int kind = dice_.integer(0, 5);
    if (kind == 0) subdivide(dice_.integer(1, 3));
    if (kind == 1) split_edges(dice_.one_of(std::array{0.5, 0.1, 0.01, 1e-3, 1e-6}));
  }

  void turn() {
    const int kind = dice_.integer(0, 3);
    if (kind == 0) return;
    if (kind == 1) {
      shape() = rotated(shape(), random_permutation(dice_));
      note("axes permuted");
    } else if (kind == 2) {
      shape() = rotated(shape(), simple_rotation(dice_));
      note("turned by round angles");
    } else {
      shape() = rotated(shape(), random_rotation(dice_));
      note("turned");
    }
  }

  void stretch() {
    if (!dice_.chance(0.15)) return;
    const double factor = dice_.one_of(std::array{2.0, 5.0, 10.0, 0.1, 0.2, 0.5});
    const int axis = dice_.integer(0, 2);
    Point by = {1, 1, 1};
    by[axis] = factor;
    shape() = scaled(shape(), by);
    if (auto& volume = case_.solid.volume) *volume *= factor;
    case_.solid.thickness *= std::min(factor, 1.0);
    note(fmt::format("{} times as long on axis {}", factor, axis));
  }

  void scale() {
    if (!dice_.chance(0.3)) return;
    const double factor = dice_.one_of(std::array{25.4, 1000.0, 1e-3, 0.1, 1024.0, 0x1p-20, 1e6});
    shape() = scaled(shape(), {factor, factor, factor});
    if (auto& volume = case_.solid.volume) *volume *= factor * factor * factor;
    case_.solid.thickness *= factor;
    note(fmt::format("scaled by {}", factor));
  }

  // So far away that some digits are lost, but no features.
  void move() {
    if (!dice_.chance(0.3)) return;
    const double distance = dice_.one_of(std::array{1.0, 10.0, 1000.0}) * extent();
    if (least_length() < 1e-10 * distance) return;
    const Point by = {distance, dice_.chance(0.5) ? -distance : 0, dice_.chance(0.5) ? 0.5 : 0};
    shape() = translated(shape(), by);
    note(fmt::format("moved by {}, {}, {}", by.x, by.y, by.z));
  }

  // No more than triangles and gaps can stand, as far as is known.
  void add_noise() {
    if (!dice_.chance(0.25)) return;
    const double share = dice_.log_uniform(1e-16, 1e-2);
    const double amplitude = std::min(share * case_.size, 0.05 * least_length());
    shape() = with_noise(shape(), amplitude, dice_);
    case_.has_noise = true;
    note(fmt::format("noise of {:.1e} λ", amplitude / case_.size));
  }

  // Only where triangles and gaps survive it.
  void round_to_float() {
    const Box box = box_of(shape());
    const double largest = std::max(max_norm(box.min), max_norm(box.max));
    if (!dice_.chance(0.5) || least_length() < 1e-4 * largest) return;
    shape() = rounded_to_float(shape());
    case_.is_float = true;
    note("float32");
  }

 private:
  Shape& shape() { return case_.solid.shape; }
  double extent() {
    const Box box = box_of(shape());
    return max_norm(box.max - box.min);
  }
  // Of triangles, walls and gaps.
  double least_length() {
    const double least = smallest_height(shape());
    return case_.solid.thickness > 0 ? std::min(least, case_.solid.thickness) : least;
  }
  bool may_grow() { return shape().triangles.size() < kMaxTriangles / 4; }
  void note(const std::string& what) {
    case_.changes += (case_.changes.empty() ? "" : ", ") + what;
  }
  void subdivide(int num_times) {
    for (int i = 0; i < num_times && may_grow(); ++i) {
      shape() = subdivided(shape());
      note("subdivided");
    }
  }
  // Makes needles; but not such that cannot be told from nothing.
  void split_edges(double fraction) {
    const int num_passes = fraction < 0.1 ? 1 : dice_.integer(2, 6);
    for (int i = 0; i < num_passes && may_grow(); ++i)
      shape() = with_split_edges(shape(), fraction, dice_);
    note(fmt::format("edges split at {}", fraction));
  }

  ShapeCase& case_;
  Dice& dice_;
};

// λ for about so many cells.
double size_for(const MeshingWork& work, double extent, double num_cells) {
  double low = 0, high = extent;
  for (int i = 0; i < 60; ++i) {
    const double middle = low + (high - low) / 2;
    (work.num_cells(middle) > num_cells ? low : high) = middle;
  }
  return high;
}

// By the number of cells; or by what it is compared with, the thinnest feature.
double choose_size(const Solid& solid, double share, Dice& dice) {
  const MeshingWork work(solid.shape, dice);
  const Box box = box_of(solid.shape);
  const double extent = max_norm(box.max - box.min);
  const auto size = [&](double num_cells) { return size_for(work, extent, share * num_cells); };
  const double by_cells = size(dice.log_uniform(1500, 60'000));
  if (solid.thickness == 0 || dice.chance(0.3)) return by_cells;
  // Often several λ, which is what users have; as often, next to none.
  const double by_thickness =
      solid.thickness / (dice.chance(0.6) ? dice.uniform(3, 8) : dice.log_uniform(0.1, 3));
  return std::clamp(by_thickness, size(120'000), size(800));
}

std::vector<double> cumulated_areas(const Shape& shape) {
  std::vector<double> areas;
  for (const auto& [a, b, c] : shape.triangles) {
    const Point& corner = shape.vertices[a];
    const double twice = norm(cross(shape.vertices[b] - corner, shape.vertices[c] - corner));
    areas.push_back((areas.empty() ? 0 : areas.back()) + twice / 2);
  }
  return areas;
}

// Where the line through p meets the triangle, as a multiple of `direction` (Möller, Trumbore).
std::optional<double> place_on_line(const Point& p, const Point& direction, const Point& a,
                                    const Point& b, const Point& c) {
  const Point ab = b - a, ac = c - a, from_a = p - a;
  const Point across = cross(direction, ac);
  const double determinant = dot(ab, across);
  if (determinant == 0) return std::nullopt;
  const double u = dot(from_a, across) / determinant;
  const Point other = cross(from_a, ab);
  const double v = dot(direction, other) / determinant;
  if (!(u >= 0) || !(v >= 0) || !(u + v <= 1)) return std::nullopt;
  return dot(ac, other) / determinant;
}

// How far it is, along the normal on both sides, from a random point of the triangle to another.
double width_at(const Shape& shape, std::size_t triangle, Dice& dice) {
  const auto corner = [&](std::size_t t, std::size_t i) {
    return shape.vertices[shape.triangles[t][i]];
  };
  double u = dice.uniform(0, 1), v = dice.uniform(0, 1);
  if (u + v > 1) {
    u = 1 - u;
    v = 1 - v;
  }
  const Point a = corner(triangle, 0), ab = corner(triangle, 1) - a, ac = corner(triangle, 2) - a;
  const Point p = a + u * ab + v * ac;
  const Point across = cross(ab, ac), normal = (1 / norm(across)) * across;
  double width = HUGE_VAL;
  for (std::size_t t = 0; t < shape.triangles.size(); ++t) {
    if (t == triangle) continue;
    const auto place = place_on_line(p, normal, corner(t, 0), corner(t, 1), corner(t, 2));
    // In the plane of the triangle itself, it is a matter of rounding.
    if (place && std::abs(*place) > 1e-12 * max_norm(p)) width = std::min(width, std::abs(*place));
  }
  return width;
}

// Two or three digits, as people give them, or all.
double maybe_rounded(double size, Dice& dice) {
  if (dice.chance(0.4)) return size;
  if (dice.chance(0.3)) return std::exp2(std::round(std::log2(size)));
  const double unit = std::pow(10, std::floor(std::log10(size)) - 1);
  return std::round(size / unit) * unit;
}

}  // namespace

MeshingWork::MeshingWork(const Shape& shape, Dice& dice)
    : volume_(volume_of(shape)), area_(area_of(shape)) {
  constexpr std::size_t kMaxTests = 2'000'000;  // of a triangle by a ray: some 20 ms
  const std::size_t num_samples =
      std::clamp<std::size_t>(kMaxTests / shape.triangles.size(), 50, 500);
  const std::vector<double> areas = cumulated_areas(shape);
  for (std::size_t i = 0; i < num_samples; ++i) {
    // Stratified, so that all parts have their share.
    const double at =
        (static_cast<double>(i) + dice.uniform(0, 1)) / static_cast<double>(num_samples);
    const auto triangle = std::ranges::lower_bound(areas, at * areas.back()) - areas.begin();
    widths_.push_back(width_at(shape, static_cast<std::size_t>(triangle), dice));
  }
}

double MeshingWork::num_cells(double size) const {
  // Points come as close to each other as surfaces do, but for a floor.
  constexpr double kSpacingFloor = 0.02;
  double num_squares = 0;
  for (const double width : widths_) {
    const double spacing = std::clamp(width, kSpacingFloor * size, size);
    num_squares += area_ / static_cast<double>(widths_.size()) / (spacing * spacing);
  }
  // Those of the lattice, and those along the surface.
  return 2.4 * volume_ / (size * size * size) + 3 * num_squares;
}

// Not much smaller than λ, so that there is not much more to mesh.
std::vector<std::string> some_sizes(double size, Dice& dice) {
  std::vector<std::string> sizes;
  const auto add = [&](const char* name, double value) {
    sizes.insert(sizes.end(), {name, fmt::format("{}", value)});
  };
  if (dice.chance(0.6)) add("--growth", dice.one_of(std::array{0.05, 0.1, 0.2, 0.3}));
  const bool is_growing = !sizes.empty();
  if (is_growing && dice.chance(0.5)) add("--max-size", size * dice.uniform(1.2, 5));
  const std::size_t num_before = sizes.size();
  if (dice.chance(0.4)) add("--per-circle", dice.integer(8, 20));
  if (dice.chance(0.3)) add("--deviation", size * dice.uniform(0.02, 0.2));
  if (sizes.empty() || dice.chance(0.2)) add("--layers", dice.integer(2, 3));
  if (sizes.size() > num_before) add("--min-size", size * dice.uniform(0.4, 0.9));
  return sizes;
}

ShapeCase make_case(std::uint64_t seed, std::uint64_t number, bool has_sizes, double share,
                    bool has_bodies) {
  Dice dice(seed, number);
  // In turn, so that a short sweep has them all.
  const auto all = has_bodies ? families_of_bodies() : families();
  const Family& family = all[number % all.size()];
  ShapeCase made{.seed = seed,
                 .number = number,
                 .share = share,
                 .family = family.name,
                 .solid = family.make(dice)};
  Changes changes(made, dice);
  changes.stretch();
  if (!has_bodies) changes.refine_triangulation();  // it would have to be the same on two sides
  changes.turn();
  changes.scale();
  made.size = maybe_rounded(choose_size(made.solid, share, dice), dice);
  changes.move();
  changes.add_noise();
  changes.round_to_float();

  made.leaf_capacity = dice.one_of(std::array<std::uint64_t, 5>{300, 1000, 3000, 10'000, 30'000});
  made.num_threads = dice.integer(1, 2);
  if (dice.chance(0.1)) made.memory = "160M";
  made.is_repeated = dice.chance(0.1);
  made.refine_seed = dice.chance(0.2) ? dice.bits() % 1000 : 0;
  if (has_sizes) made.sizes = some_sizes(made.size, dice);
  return made;
}

std::string ShapeCase::file_name() const {
  return fmt::format("{}-{}-{}.{}", family, seed, number,
                     !solid.bodies.empty() ? "obj"
                     : is_float            ? "stl"
                                           : "off");
}

void ShapeCase::write_surface(const std::filesystem::path& directory) const {
  const auto file = directory / file_name();
  if (!solid.bodies.empty()) return write_obj(solid, file);
  is_float ? write_stl(solid.shape, file) : write_off(solid.shape, file);
}

std::vector<std::string> ShapeCase::mesh_arguments() const {
  std::vector<std::string> arguments = {"--size", fmt::format("{}", size), "--leaf-capacity",
                                        fmt::format("{}", leaf_capacity)};
  if (refine_seed > 0)
    arguments.insert(arguments.end(), {"--seed", fmt::format("{}", refine_seed)});
  arguments.insert(arguments.end(), sizes.begin(), sizes.end());
  if (!solid.bodies.empty()) arguments.push_back("--bodies");
  if (!memory.empty()) arguments.insert(arguments.end(), {"--memory", memory});
  return arguments;
}

bool ShapeCase::is_resolved() const {
  constexpr double kThickness = 4;
  return !has_noise && solid.thickness >= kThickness * size;
}

}  // namespace locvol::sweeps
