// Where a winding number does not tell well what is inside. Internal to refine/winding.
#pragma once

#include <cmath>
#include <vector>

#include "octree/geometry.h"

namespace locvol {

// All over the box.
inline std::vector<Point> places_of_doubt(const Box& box) {
  constexpr int kAlong = 24;
  const Point step = (1.0 / kAlong) * (box.max - box.min);
  std::vector<Point> places;
  for (int i = 0; i < kAlong; ++i)
    for (int j = 0; j < kAlong; ++j)
      for (int k = 0; k < kAlong; ++k)
        places.push_back(box.min +
                         Point{(i + 0.5) * step.x, (j + 0.5) * step.y, (k + 0.5) * step.z});
  return places;
}

// Is the number far from an integer?
inline bool is_in_doubt(double number) {
  constexpr double kNear = 0.1;
  return std::abs(number - std::round(number)) > kNear;
}

}  // namespace locvol
