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

double interpolated(const SizeCube& cube, const Box& box, const Point& p) {
  const auto fraction = [&](int axis) {
    return std::clamp((p[axis] - box.min[axis]) / (box.max[axis] - box.min[axis]), 0.0, 1.0);
  };
  return interpolated(cube.distance, fraction(0), fraction(1), fraction(2));
}

double size_at(const SizeLaw& law, const Frame& frame, std::span<const SizeCube> cubes,
               const Point& p) {
  if (!frame.contains(p)) return law.surface;
  const MortonKey key = frame.key_of(p);
  const auto place = std::ranges::lower_bound(
      cubes, key, {}, [](const SizeCube& cube) { return cube.key.range_max(); });
  if (place == cubes.end() || !place->key.is_ancestor_or_self_of(key)) return law.surface;
  const double distance = interpolated(*place, frame.box(place->key), p) - place->excess;
  return law.at_distance(std::max(distance, 0.0));
}

double least_distance(std::span<const SizeCube> cubes) {
  float least = std::numeric_limits<float>::infinity();
  for (const SizeCube& cube : cubes) {
    const auto [low, high] = std::ranges::minmax(cube.distance);
    if (high < 0) continue;
    least = std::min(least, std::max(low, 0.0F));
  }
  return std::isfinite(least) ? least : 0;
}

double largest_size(const SizeLaw& law, std::span<const SizeCube> cubes) {
  float farthest = 0;
  for (const SizeCube& cube : cubes)
    for (const float d : cube.distance) farthest = std::max(farthest, d);
  return law.at_distance(farthest);
}

SizeField::SizeField(const SizeCubes& sizes)
    : law_(sizes.law),
      root_(sizes.frame.root_box()),
      inverse_unit_(1 / sizes.frame.unit()),
      largest_(largest_size(sizes.law, sizes.cubes)) {
  for (const SizeCube& cube : sizes.cubes) {
    first_.push_back(cube.key.range_min().bits());
    last_.push_back(cube.key.range_max().bits());
    cubes_.push_back({.low = sizes.frame.box(cube.key).min,
                      .inverse_side = 1 / sizes.frame.side(cube.key.level()),
                      .distance = cube.distance,
                      .excess = cube.excess});
  }
}

// On which side of a face between cubes a place is decides little, but all leaves decide alike.
double SizeField::graded_at(const Point& p) const {
  if (!root_.contains(p)) return law_.surface;
  constexpr double kLast = (std::uint32_t{1} << MortonKey::kMaxLevel) - 1;
  const auto step = [&](int axis) {
    return static_cast<std::uint32_t>(std::min((p[axis] - root_.min[axis]) * inverse_unit_, kLast));
  };
  const std::uint64_t key =
      MortonKey::containing({step(0), step(1), step(2)}, MortonKey::kMaxLevel).bits();
  if (cubes_.empty()) return law_.surface;
  if (key < first_[last_cube_] || key > last_[last_cube_]) {
    const auto place = std::ranges::lower_bound(last_, key);
    if (place == last_.end()) return law_.surface;
    const auto n = static_cast<std::size_t>(place - last_.begin());
    if (key < first_[n]) return law_.surface;
    last_cube_ = n;
  }
  const auto& [low, inverse_side, distance, excess] = cubes_[last_cube_];
  const auto fraction = [&](int axis) {
    return std::clamp((p[axis] - low[axis]) * inverse_side, 0.0, 1.0);
  };
  const double depth = interpolated(distance, fraction(0), fraction(1), fraction(2)) - excess;
  return law_.at_distance(std::max(depth, 0.0));
}

}  // namespace locvol
