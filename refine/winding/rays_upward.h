// RaysUpward counts how often rays upwards from many places cross triangles that come one after
// another: the whole winding numbers of these places, if the triangles are closed. So of triangles
// none has to be in memory. Internal to refine/winding.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "octree/geometry.h"

namespace locvol {

// Memory: 32 bytes a place.
class RaysUpward {
 public:
  // REQUIRES: coordinates are finite
  explicit RaysUpward(std::vector<Point> places);

  void add(const std::array<Point, 3>& triangle);
  std::span<const Point> places() const { return places_; }
  // By place.
  std::span<const std::int32_t> sums() const { return sums_; }

 private:
  std::uint32_t along(double x, int axis) const;  // of the grid, the nearest

  std::vector<Point> places_;
  std::vector<std::int32_t> sums_;
  // A grid seen from above, with about as many squares as places.
  std::array<double, 2> low_{}, inverse_{};
  std::uint32_t side_ = 1;
  std::vector<std::uint32_t> first_, listed_;  // of each square, its places
};

}  // namespace locvol
