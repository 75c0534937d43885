#include "octree/size_field.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace locvol {

namespace {

double interpolated(const std::array<float, 8>& distance, double x, double y, double z) {
  const auto along_x = [&](std::size_t k) {
    const double a = distance[k], b = distance[k + 1];
    return a + x * (b - a);
  };
  const auto along_y = [&](std::size_t k) {
    const double a = along_x(k), b = along_x(k + 2);
    return a + y * (b - a);
  };
  const double low = along_y(0), high = along_y(4);
  return low + z * (high - low);
}

}  // namespace

double interpolated(const std::array<float, 8>& corners, const Box& box, const Point& p) {
  const auto fraction = [&](int axis) {
    return std::clamp((p[axis] - box.min[axis]) / (box.max[axis] - box.min[axis]), 0.0, 1.0);
  };
  return interpolated(corners, fraction(0), fraction(1), fraction(2));
}

double size_in(const SizeLaw& law, const SizeCube& cube, const Box& box, const Point& p) {
  return law.at_distance(interpolated(cube.distance, box, p) - cube.excess,
                         interpolated(cube.less, box, p));
}

double largest_size(const SizeLaw& law, const SizeCube& cube) {  // interpolated, at a corner
  double most = 0;
  for (std::size_t k = 0; k < 8; ++k)
    most = std::max(most, law.at_distance(cube.distance[k], cube.less[k]));
  return most;
}

double SizeCursor::at(const Point& p) {
  if (last_ == nullptr || !is_in_leaf(last_box_, p)) {
    last_ = nullptr;
    if (!frame_->contains(p)) return law_->surface;
    const MortonKey key = frame_->key_of(p);
    const auto place = std::ranges::lower_bound(
        cubes_, key, {}, [](const SizeCube& cube) { return cube.key.range_max(); });
    if (place == cubes_.end() || !place->key.is_ancestor_or_self_of(key)) return law_->surface;
    last_ = &*place;
    last_box_ = frame_->box(place->key);
  }
  return size_in(*law_, *last_, last_box_, p);
}

bool is_outside(const SizeCube& cube, double side) {
  return std::ranges::max(cube.distance) < -0.87 * side;
}

// Interpolated, nothing is beyond what is at the corners.
SizeRange size_range(const SizeLaw& law, const Frame& frame, std::span<const SizeCube> cubes) {
  if (cubes.empty()) return {law.surface, law.surface, law.surface};
  SizeRange range{std::numeric_limits<double>::infinity(), 0, 0};
  for (const SizeCube& cube : cubes) {
    const double nearest = std::ranges::min(cube.distance);
    const double most = largest_size(law, cube);
    range.most = std::max(range.most, most);
    if (is_outside(cube, frame.side(cube.key.level()))) continue;
    range.least =
        std::min(range.least, law.at_distance(nearest - cube.excess, std::ranges::max(cube.less)));
    if (nearest <= 0) range.on_surface = std::max(range.on_surface, most);
  }
  if (!std::isfinite(range.least)) range.least = range.most;  // all is outside
  if (range.on_surface == 0) range.on_surface = range.most;
  range.on_surface = std::min(range.on_surface, law.surface);
  return range;
}

// At the centers of its eighths. Cubes that a plane passes through, in any direction, have faces of
// 1.5 times its area on average.
SizeTotals size_totals(const SizeLaw& law, const SizeCube& cube, const Box& box) {
  const double side = box.max.x - box.min.x;
  SizeTotals sum;
  for (int k = 0; k < 8; ++k) {
    const auto place = [&](int bit) { return (k >> bit & 1) != 0 ? 0.75 * side : 0.25 * side; };
    const Point p = box.min + Point{place(0), place(1), place(2)};
    if (interpolated(cube.distance, box, p) > 0)
      sum.of_volume += 0.125 * std::pow(side / size_in(law, cube, box, p), 3);
  }
  if (is_of_lattice(law, cube)) sum.of_lattice = sum.of_volume;
  if (is_of_core(law, cube)) sum.of_core = sum.of_volume;
  const auto [nearest, farthest] = std::ranges::minmax(cube.distance);
  if (nearest < 0 && farthest >= 0)
    sum.of_area = std::pow(side / size_in(law, cube, box, box.center()), 2) / 1.5;
  return sum;
}

double base_size(const SizeLaw& law, const SizeCube& cube) {
  return std::max(law.least, law.surface - std::ranges::min(cube.less));
}

bool is_saturated(const SizeLaw& law, const SizeCube& cube, double distance) {
  const double least = law.most + law.growth * distance;
  const auto size = [&](std::size_t k) {
    return law.surface - cube.less[k] + law.growth * (cube.distance[k] - cube.excess);
  };
  for (std::size_t k = 0; k < 8; ++k)
    if (!(size(k) >= least)) return false;
  return true;
}

bool is_of_lattice(const SizeLaw& law, const SizeCube& cube) {
  return law.has_core() && is_saturated(law, cube, kLatticeMargin * law.most);
}

bool is_of_core(const SizeLaw& law, const SizeCube& cube) {
  return law.has_core() && is_saturated(law, cube, kCoreMargin * law.most);
}

SizeField::SizeField(const SizeCubes& sizes)
    : law_(sizes.law),
      root_(sizes.frame.root_box()),
      inverse_unit_(1 / sizes.frame.unit()),
      range_(size_range(sizes.law, sizes.frame, sizes.cubes)) {
  std::vector<GridPoint> lows;
  lows.reserve(sizes.cubes.size());
  first_.reserve(sizes.cubes.size());
  last_.reserve(sizes.cubes.size());
  cubes_.reserve(sizes.cubes.size());
  const auto is_less = [&](const SizeCube& cube) {
    return law_.has_shapes() && std::ranges::any_of(cube.less, [](float d) { return d != 0; });
  };
  for (const SizeCube& cube : sizes.cubes) {
    first_.push_back(cube.key.range_min().bits());
    last_.push_back(cube.key.range_max().bits());
    lows.push_back(cube.key.grid_min());
    cubes_.push_back({.low = sizes.frame.position(lows.back()),
                      .inverse_side = 1 / sizes.frame.side(cube.key.level()),
                      .distance = cube.distance,
                      .less = cube.less,
                      .excess = cube.excess,
                      .is_less = is_less(cube)});
  }
  if (!cubes_.empty()) make_grid(sizes.cubes, lows);
}

// Nodes of the grid: about as many as cubes.
void SizeField::make_grid(std::span<const SizeCube> cubes, std::span<const GridPoint> lows) {
  constexpr std::uint32_t kMost = std::uint32_t{1} << MortonKey::kMaxLevel;
  std::array<std::uint32_t, 3> low{kMost, kMost, kMost}, high{};
  for (std::size_t n = 0; n < cubes.size(); ++n) {
    const auto [x, y, z] = lows[n];
    const std::uint32_t last = cubes[n].key.grid_side() - 1;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::uint32_t at = axis == 0 ? x : axis == 1 ? y : z;
      low[axis] = std::min(low[axis], at);
      high[axis] = std::max(high[axis], at + last);
    }
  }
  std::size_t num_nodes = 0;
  for (grid_shift_ = 0;; ++grid_shift_) {
    num_nodes = 1;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      grid_origin_[axis] = low[axis] >> grid_shift_;
      grid_shape_[axis] = (high[axis] >> grid_shift_) - grid_origin_[axis] + 1;
      num_nodes *= grid_shape_[axis];
    }
    if (num_nodes <= 2 * cubes.size()) break;
  }
  grid_.assign(num_nodes, {});
  for (std::uint32_t n = 0; n < cubes.size(); ++n) {
    const auto [x, y, z] = lows[n];
    const std::uint32_t last = cubes[n].key.grid_side() - 1;
    for (std::uint32_t k = z >> grid_shift_; k <= (z + last) >> grid_shift_; ++k)
      for (std::uint32_t j = y >> grid_shift_; j <= (y + last) >> grid_shift_; ++j)
        for (std::uint32_t i = x >> grid_shift_; i <= (x + last) >> grid_shift_; ++i) {
          Range& range = grid_[((k - grid_origin_[2]) * grid_shape_[1] + (j - grid_origin_[1])) *
                                   std::size_t{grid_shape_[0]} +
                               (i - grid_origin_[0])];
          if (range.first == range.end) range.first = n;
          range.end = n + 1;
        }
  }
}

// On which side of a face between cubes a place is decides little, but all leaves decide alike.
const SizeField::Cube* SizeField::cube_at(const Point& p) const {
  if (cubes_.empty() || !root_.contains(p)) return nullptr;
  constexpr double kLast = (std::uint32_t{1} << MortonKey::kMaxLevel) - 1;
  const auto step = [&](int axis) {
    return static_cast<std::uint32_t>(std::min((p[axis] - root_.min[axis]) * inverse_unit_, kLast));
  };
  const GridPoint at{step(0), step(1), step(2)};
  const std::uint32_t i = (at.x >> grid_shift_) - grid_origin_[0];
  const std::uint32_t j = (at.y >> grid_shift_) - grid_origin_[1];
  const std::uint32_t k = (at.z >> grid_shift_) - grid_origin_[2];
  if (i >= grid_shape_[0] || j >= grid_shape_[1] || k >= grid_shape_[2]) return nullptr;
  const auto [first, end] = grid_[(k * grid_shape_[1] + j) * std::size_t{grid_shape_[0]} + i];
  const std::uint64_t key = MortonKey::containing(at, MortonKey::kMaxLevel).bits();
  const auto place = std::lower_bound(last_.begin() + first, last_.begin() + end, key);
  const auto n = static_cast<std::size_t>(place - last_.begin());
  return n < end && first_[n] <= key ? &cubes_[n] : nullptr;
}

SizeField::Cube::Place SizeField::Cube::place(const Point& p) const {
  const auto fraction = [&](int axis) {
    return std::clamp((p[axis] - low[axis]) * inverse_side, 0.0, 1.0);
  };
  return {fraction(0), fraction(1), fraction(2)};
}

double SizeField::Cube::depth(const Place& at) const {
  return interpolated(distance, at[0], at[1], at[2]) - excess;
}

double SizeField::graded_at(const Point& p) const {
  const Cube* cube = cube_at(p);
  if (cube == nullptr) return law_.surface;
  const Cube::Place at = cube->place(p);
  return law_.at_distance(cube->depth(at),
                          cube->is_less ? interpolated(cube->less, at[0], at[1], at[2]) : 0);
}

double SizeField::room(const Point& p) const {
  const Cube* cube = cube_at(p);
  if (cube == nullptr) return -law_.most;
  const Cube::Place at = cube->place(p);
  const double less = cube->is_less ? interpolated(cube->less, at[0], at[1], at[2]) : 0;
  return law_.surface - less + law_.growth * cube->depth(at) - law_.most;
}

double SizeField::least_depth(const Point& p) const {
  constexpr double kToCorners = 0.9;  // over the side; √3/2 and what far distances are too large by
  const Cube* cube = cube_at(p);
  return cube == nullptr ? -1 : cube->depth(cube->place(p)) - kToCorners / cube->inverse_side;
}

}  // namespace locvol
