#include "tests/sweeps/shapes/shape_case.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

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
double size_for(const Shape& shape, double num_cells) {
  const Box box = box_of(shape);
  double low = 0, high = max_norm(box.max - box.min);
  for (int i = 0; i < 60; ++i) {
    const double middle = low + (high - low) / 2;
    (expected_num_cells(shape, middle) > num_cells ? low : high) = middle;
  }
  return high;
}

// By the number of cells, or by what it is compared with: the thinnest feature.
double choose_size(const Solid& solid, Dice& dice) {
  const double by_cells = size_for(solid.shape, dice.log_uniform(1500, 60'000));
  if (solid.thickness == 0 || dice.chance(0.4)) return by_cells;
  const double by_thickness = solid.thickness / dice.log_uniform(0.25, 8);
  return std::clamp(by_thickness, size_for(solid.shape, 100'000), size_for(solid.shape, 800));
}

// Two or three digits, as people give them, or all.
double maybe_rounded(double size, Dice& dice) {
  if (dice.chance(0.4)) return size;
  if (dice.chance(0.3)) return std::exp2(std::round(std::log2(size)));
  const double unit = std::pow(10, std::floor(std::log10(size)) - 1);
  return std::round(size / unit) * unit;
}

}  // namespace

double expected_num_cells(const Shape& shape, double size) {
  // Of the lattice, and of what lies along the surface.
  return 2.4 * volume_of(shape) / (size * size * size) + 3 * area_of(shape) / (size * size);
}

ShapeCase make_case(std::uint64_t seed, std::uint64_t number) {
  Dice dice(seed, number);
  // In turn, so that a short sweep has them all.
  const Family& family = families()[number % families().size()];
  ShapeCase made{.seed = seed, .number = number, .family = family.name, .solid = family.make(dice)};
  Changes changes(made, dice);
  changes.stretch();
  changes.refine_triangulation();
  changes.turn();
  changes.scale();
  made.size = maybe_rounded(choose_size(made.solid, dice), dice);
  changes.move();
  changes.add_noise();
  changes.round_to_float();

  made.leaf_capacity = dice.one_of(std::array<std::uint64_t, 5>{300, 1000, 3000, 10'000, 30'000});
  made.num_threads = dice.integer(1, 2);
  if (dice.chance(0.1)) made.memory = "160M";
  made.is_repeated = dice.chance(0.1);
  made.refine_seed = dice.chance(0.2) ? dice.bits() % 1000 : 0;
  return made;
}

std::string ShapeCase::file_name() const {
  return fmt::format("{}-{}-{}.{}", family, seed, number, is_float ? "stl" : "off");
}

void ShapeCase::write_surface(const std::filesystem::path& directory) const {
  const auto file = directory / file_name();
  is_float ? write_stl(solid.shape, file) : write_off(solid.shape, file);
}

std::vector<std::string> ShapeCase::mesh_arguments() const {
  std::vector<std::string> arguments = {"--size", fmt::format("{}", size), "--leaf-capacity",
                                        fmt::format("{}", leaf_capacity)};
  if (refine_seed > 0)
    arguments.insert(arguments.end(), {"--seed", fmt::format("{}", refine_seed)});
  if (!memory.empty()) arguments.insert(arguments.end(), {"--memory", memory});
  return arguments;
}

bool ShapeCase::is_resolved() const {
  constexpr double kThickness = 4;
  return !has_noise && solid.thickness >= kThickness * size;
}

}  // namespace locvol::sweeps
