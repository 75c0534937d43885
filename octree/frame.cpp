#include "octree/frame.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <string>

namespace locvol {
namespace {

constexpr double kGridSide = std::uint32_t{1} << MortonKey::kMaxLevel;  // steps of the root's side
constexpr int kUnitBits = 20;
// Farther from the origin of space, neighboring grid positions would no longer be two numbers.
constexpr double kMaxSteps = std::uint64_t{1} << 51;

double rounded_up(double v, int significant_bits) {
  int exponent = 0;
  const double mantissa = std::frexp(v, &exponent);
  return std::ldexp(std::ceil(std::ldexp(mantissa, significant_bits)), exponent - significant_bits);
}

std::string decimal(double v) {
  std::array<char, 32> text;
  return {text.data(), std::to_chars(text.data(), text.data() + text.size(), v).ptr};
}

double largest_magnitude(const Box& box) {
  return std::max({std::abs(box.min.x), std::abs(box.min.y), std::abs(box.min.z),
                   std::abs(box.max.x), std::abs(box.max.y), std::abs(box.max.z)});
}

void check_arguments(const Box& box, double margin, double leaf_side) {
  const bool is_ordered =
      box.min.x <= box.max.x && box.min.y <= box.max.y && box.min.z <= box.max.z;
  if (!is_ordered || !std::isfinite(largest_magnitude(box)))
    throw std::invalid_argument("octree frame: the box is empty or not finite");
  if (!(margin >= 0) || !std::isfinite(margin))
    throw std::invalid_argument("octree frame: the margin must be finite and at least 0, it is " +
                                decimal(margin));
  if (!(leaf_side > 0) || !std::isfinite(leaf_side))
    throw std::invalid_argument("octree frame: the leaf side must be finite and above 0, it is " +
                                decimal(leaf_side));
}

// The frame whose nodes of `level` have sides of just over `leaf_side`, centered on the box as well
// as an origin at a multiple of the unit can be.
Frame centered_frame(const Box& box, double leaf_side, int level) {
  const double unit = rounded_up(std::ldexp(leaf_side, level - MortonKey::kMaxLevel), kUnitBits);
  if (!(unit >= std::numeric_limits<double>::min()) || !std::isfinite(unit * kGridSide))
    throw std::invalid_argument("octree frame: the leaf side is too small or too large a number");
  if (largest_magnitude(box) / unit + kGridSide > kMaxSteps)
    throw std::invalid_argument(
        "octree frame: the model lies too far from the origin of space for its leaf side: grid "
        "coordinates cannot be told apart; move it, or ask for a larger size");
  Point origin;
  for (int axis = 0; axis < 3; ++axis) {
    const double center = 0.5 * box.min[axis] + 0.5 * box.max[axis];
    origin[axis] = std::round((center - 0.5 * kGridSide * unit) / unit) * unit;
  }
  return {origin, unit};
}

// The number of the grid step on one axis that owns v: position(i) <= v < position(i + 1).
std::uint32_t step_owning(double origin, double unit, double v) {
  const auto position = [&](double step) { return origin + unit * step; };
  double step = std::clamp(std::floor((v - origin) / unit), 0.0, kGridSide - 1);
  while (step > 0 && v < position(step)) --step;  // the quotient is rounded, positions decide
  while (step < kGridSide - 1 && v >= position(step + 1)) ++step;
  return static_cast<std::uint32_t>(step);
}

}  // namespace

Frame Frame::around(const Box& box, double margin, double leaf_side) {
  check_arguments(box, margin, leaf_side);
  const Box needed = box.expanded(margin);
  const Point extent = needed.max - needed.min;
  const double longest = std::max({extent.x, extent.y, extent.z});
  for (int level = 0; level <= MortonKey::kMaxLevel; ++level) {
    if (std::ldexp(leaf_side, level) < longest) continue;
    const Frame frame = centered_frame(box, leaf_side, level);
    // Rounding the origin costs up to half a step on a side: where none is to spare, go one up.
    const Box root = frame.root_box();
    if (root.contains(needed.min) && root.contains(needed.max) && frame.contains(box.max))
      return frame;
  }
  throw std::invalid_argument("octree frame: leaves of side " + decimal(leaf_side) +
                              " are too small for a model of extent " + decimal(longest) +
                              ": more than 2^" + std::to_string(MortonKey::kMaxLevel) +
                              " to a side");
}

double Frame::side(int level) const {
  assert(0 <= level && level <= MortonKey::kMaxLevel);
  return std::ldexp(unit_, MortonKey::kMaxLevel - level);
}

int Frame::level_of_side(double wanted) const {
  int level = MortonKey::kMaxLevel;
  while (level > 0 && side(level) < wanted) --level;
  return level;
}

int Frame::level_no_wider(double wanted) const {
  int level = 0;
  while (level < MortonKey::kMaxLevel && side(level) > wanted) ++level;
  return level;
}

Point Frame::position(GridPoint g) const {
  return {origin_.x + unit_ * g.x, origin_.y + unit_ * g.y, origin_.z + unit_ * g.z};
}

Box Frame::box(MortonKey key) const {
  const GridPoint low = key.grid_min();
  const std::uint32_t side = key.grid_side();
  return {position(low), position({low.x + side, low.y + side, low.z + side})};
}

MortonKey Frame::key_of(const Point& p, int level) const {
  assert(contains(p));
  return MortonKey::containing(
      {step_owning(origin_.x, unit_, p.x), step_owning(origin_.y, unit_, p.y),
       step_owning(origin_.z, unit_, p.z)},
      level);
}

bool Frame::contains(const Point& p) const {
  const Box root = root_box();
  return root.contains(p) && p.x < root.max.x && p.y < root.max.y && p.z < root.max.z;
}

}  // namespace locvol
