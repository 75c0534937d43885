// AuditGrid finds the points in a box: buckets of a uniform grid, filled once.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "octree/geometry.h"

namespace locvol {

class AuditGrid {
 public:
  // Buckets have sides of about `side`, or more where that would take many more buckets than
  // points. REQUIRES: finite coordinates, side > 0
  AuditGrid(std::span<const Point> points, double side);

  // Calls visit(index, position) for each point in the closed box, and some outside it.
  template <class Visit>
  void for_each_near(const Box& box, Visit visit) const {
    if (entries_.empty()) return;
    const std::array<std::size_t, 3> low = bucket(box.min), high = bucket(box.max);
    for (std::size_t z = low[2]; z <= high[2]; ++z) {
      for (std::size_t y = low[1]; y <= high[1]; ++y) {
        const std::size_t row = (z * size_[1] + y) * size_[0];
        for (std::uint32_t i = starts_[row + low[0]]; i < starts_[row + high[0] + 1]; ++i) {
          visit(entries_[i].index, entries_[i].position);
        }
      }
    }
  }

 private:
  struct Entry {
    Point position;
    std::uint32_t index;
  };

  std::array<std::size_t, 3> bucket(const Point& p) const;  // the nearest one, for p outside
  std::size_t row_major(const std::array<std::size_t, 3>& b) const {
    return (b[2] * size_[1] + b[1]) * size_[0] + b[0];
  }

  Box box_;
  double side_;
  std::array<std::size_t, 3> size_{1, 1, 1};
  std::vector<std::uint32_t> starts_;  // of each bucket in entries_, and the end
  std::vector<Entry> entries_;
};

}  // namespace locvol
