// PointCubes finds points near a place: points of a box, in cubes. Internal to refine/.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "octree/geometry.h"

namespace locvol {

class PointCubes {
 public:
  PointCubes(const Box& box, double side) : origin_(box.min), inverse_side_(1 / side) {
    for (int axis = 0; axis < 3; ++axis)
      shape_[std::size_t(axis)] =
          1 + static_cast<std::int32_t>((box.max[axis] - box.min[axis]) * inverse_side_);
    first_.assign(std::size_t(shape_[0]) * std::size_t(shape_[1]) * std::size_t(shape_[2]), kNone);
  }

  // What lies outside the box joins its outermost cubes.
  void add(const Point& p) {
    std::uint32_t& first = first_[index(cube_of(p))];
    held_.push_back({p, first});
    first = static_cast<std::uint32_t>(held_.size() - 1);
  }

  // Calls visit(point) for all points in the cubes that p's neighborhood along the axes meets,
  // until it says false.
  template <class Visit>
  bool for_each_around(const Point& p, double distance, Visit visit) const {
    const Point d{distance, distance, distance};
    const Cube low = cube_of(p - d), high = cube_of(p + d);
    for (std::int32_t k = low[2]; k <= high[2]; ++k)
      for (std::int32_t j = low[1]; j <= high[1]; ++j)
        for (std::int32_t i = low[0]; i <= high[0]; ++i)
          if (!for_each_in({i, j, k}, visit)) return false;
    return true;
  }
  // Is a point of p's own cube closer to it than `radius`? Cheap.
  bool has_in_cube(const Point& p, double radius) const {
    return !for_each_in(cube_of(p),
                        [&](const Point& q) { return squared_distance(p, q) >= radius * radius; });
  }
  // Is no point closer to p than `radius`?
  bool is_free(const Point& p, double radius) const {
    return !has_in_cube(p, radius) && for_each_around(p, radius, [&](const Point& q) {
      return squared_distance(p, q) >= radius * radius;
    });
  }

 private:
  using Cube = std::array<std::int32_t, 3>;
  struct Held {
    Point point;
    std::uint32_t next = 0;  // in the same cube
  };
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

  template <class Visit>
  bool for_each_in(const Cube& cube, Visit visit) const {
    for (std::uint32_t n = first_[index(cube)]; n != kNone; n = held_[n].next)
      if (!visit(held_[n].point)) return false;
    return true;
  }
  Cube cube_of(const Point& p) const {
    const Point c = inverse_side_ * (p - origin_);
    const auto clamped = [&](double v, std::size_t axis) {
      return v <= 0 ? 0 : v >= shape_[axis] ? shape_[axis] - 1 : static_cast<std::int32_t>(v);
    };
    return {clamped(c.x, 0), clamped(c.y, 1), clamped(c.z, 2)};
  }
  std::size_t index(const Cube& c) const {
    return (std::size_t(c[2]) * std::size_t(shape_[1]) + std::size_t(c[1])) *
               std::size_t(shape_[0]) +
           std::size_t(c[0]);
  }

  Point origin_;
  double inverse_side_;
  Cube shape_{};
  std::vector<std::uint32_t> first_;  // of a cube's points in held_
  std::vector<Held> held_;
};

}  // namespace locvol
