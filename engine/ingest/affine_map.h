// AffineMap takes the points of a part to where it is placed.
#pragma once

#include <array>

#include "octree/geometry.h"

namespace locvol {

// p goes to (x . p + x_0, ...), of which x and x_0 are the rows' first three numbers and their
// last.
struct AffineMap {
  std::array<std::array<double, 4>, 3> rows = {{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};

  Point operator()(const Point& p) const {
    Point to;
    for (int i = 0; i < 3; ++i) {
      const auto& row = rows[static_cast<std::size_t>(i)];
      to[i] = row[0] * p.x + row[1] * p.y + row[2] * p.z + row[3];
    }
    return to;
  }
  // What is inside comes to lie outside: corners are to be taken the other way around.
  bool turns() const {
    const auto& [a, b, c] = rows;
    return a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) +
               a[2] * (b[0] * c[1] - b[1] * c[0]) <
           0;
  }
  friend bool operator==(const AffineMap&, const AffineMap&) = default;
};

// The first is applied last.
inline AffineMap operator*(const AffineMap& f, const AffineMap& g) {
  AffineMap both;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 4; ++j) {
      double sum = j == 3 ? f.rows[i][3] : 0;
      for (std::size_t k = 0; k < 3; ++k) sum += f.rows[i][k] * g.rows[k][j];
      both.rows[i][j] = sum;
    }
  return both;
}

}  // namespace locvol
