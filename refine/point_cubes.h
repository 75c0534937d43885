// PointCubes finds points near a place: points of a box, in cubes. CubesOf<Item> finds what has a
// `position` likewise. Internal to refine/.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numeric>
#include <span>
#include <type_traits>
#include <vector>

#include "octree/geometry.h"

namespace locvol {

// The side of cubes for the box: as wanted, or wider, so that no more than some are in a row, and
// there are not many more of them than items.
inline double cube_side(const Box& box, double wanted, double most_in_row, std::size_t num_items) {
  constexpr double kMostOfAnItem = 8;
  const Point sides = box.max - box.min;
  const double most = kMostOfAnItem * static_cast<double>(std::max<std::size_t>(num_items, 1));
  return std::max(
      {wanted, max_norm(sides) / most_in_row, std::cbrt(sides.x * sides.y * sides.z / most)});
}

// The items of cubes in a row are side by side in memory; those that are added later, which should
// be few, hang on lists.
template <class Item>
class CubesOf {
 public:
  // What lies outside the box joins its outermost cubes. `wanted`, `most_in_row`: see cube_side()
  CubesOf(const Box& box, double wanted, double most_in_row, std::span<const Item> items)
      : origin_(box.min), inverse_side_(1 / cube_side(box, wanted, most_in_row, items.size())) {
    for (int axis = 0; axis < 3; ++axis)
      shape_[std::size_t(axis)] =
          1 + static_cast<std::int32_t>((box.max[axis] - box.min[axis]) * inverse_side_);
    const std::size_t num_rows = std::size_t(shape_[1]) * std::size_t(shape_[2]);
    std::vector<std::uint32_t> cubes(items.size());
    first_.assign(num_rows * std::size_t(shape_[0]) + 2, 0);
    for (std::size_t n = 0; n < items.size(); ++n) {
      cubes[n] = static_cast<std::uint32_t>(index(cube_of(position(items[n]))));
      ++first_[cubes[n] + 2];
    }
    std::partial_sum(first_.begin(), first_.end(), first_.begin());
    held_.resize(items.size());
    for (std::size_t n = 0; n < items.size(); ++n) held_[first_[cubes[n] + 1]++] = items[n];
    first_added_.assign(num_rows, kNone);
  }

  void add(const Item& item) {
    std::uint32_t& first = first_added_[row(cube_of(position(item)))];
    added_.push_back({item, first});
    first = static_cast<std::uint32_t>(added_.size() - 1);
  }

  // Calls visit(item) for all in the cubes that p's neighborhood along the axes meets, and for some
  // others, until it says false.
  template <class Visit>
  bool for_each_around(const Point& p, double distance, Visit visit) const {
    const Point d{distance, distance, distance};
    const Cube low = cube_of(p - d), high = cube_of(p + d);
    for (std::int32_t k = low[2]; k <= high[2]; ++k)
      for (std::int32_t j = low[1]; j <= high[1]; ++j)
        if (!for_each_in({low[0], j, k}, high[0], visit)) return false;
    return true;
  }
  // Tells whether an item of p's own cube is closer to it than `radius`. Cheap.
  bool has_in_cube(const Point& p, double radius) const {
    const Cube cube = cube_of(p);
    return !for_each_in(cube, cube[0], [&](const Item& item) {
      return squared_distance(p, position(item)) >= radius * radius;
    });
  }
  // Tells whether no item is closer to p than `radius`.
  bool is_free(const Point& p, double radius) const {
    return !has_in_cube(p, radius) && for_each_around(p, radius, [&](const Item& item) {
      return squared_distance(p, position(item)) >= radius * radius;
    });
  }
  // The squared distance of the nearest item from p, or most² if none is closer. Once an item is
  // closer than `least`, no other is looked at.
  double squared_clearance(const Point& p, double least, double most) const {
    double squared = most * most;
    for_each_around(p, most, [&](const Item& item) {
      squared = std::min(squared, squared_distance(p, position(item)));
      return squared >= least * least;
    });
    return squared;
  }

 private:
  using Cube = std::array<std::int32_t, 3>;
  struct Added {
    Item item;
    std::uint32_t next = 0;  // in the same row
  };
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

  static const Point& position(const Item& item) {
    if constexpr (std::is_same_v<Item, Point>)
      return item;
    else
      return item.position;
  }
  // Visits the items from a cube to the one at `last` in its row.
  template <class Visit>
  bool for_each_in(const Cube& from, std::int32_t last, Visit visit) const {
    const std::size_t begin = index(from), end = begin + std::size_t(last - from[0]) + 1;
    for (std::uint32_t n = first_[begin]; n < first_[end]; ++n)
      if (!visit(held_[n])) return false;
    for (std::uint32_t n = first_added_[row(from)]; n != kNone; n = added_[n].next)
      if (!visit(added_[n].item)) return false;
    return true;
  }
  Cube cube_of(const Point& p) const {
    const Point c = inverse_side_ * (p - origin_);
    const auto clamped = [&](double v, std::size_t axis) {
      return v <= 0 ? 0 : v >= shape_[axis] ? shape_[axis] - 1 : static_cast<std::int32_t>(v);
    };
    return {clamped(c.x, 0), clamped(c.y, 1), clamped(c.z, 2)};
  }
  std::size_t row(const Cube& c) const {
    return std::size_t(c[2]) * std::size_t(shape_[1]) + std::size_t(c[1]);
  }
  std::size_t index(const Cube& c) const {
    return row(c) * std::size_t(shape_[0]) + std::size_t(c[0]);
  }

  Point origin_;
  double inverse_side_;
  Cube shape_{};
  std::vector<std::uint32_t> first_;  // of a cube's items in held_, and the end
  std::vector<Item> held_;
  std::vector<std::uint32_t> first_added_;  // of a row's items in added_
  std::vector<Added> added_;
};

using PointCubes = CubesOf<Point>;

}  // namespace locvol
