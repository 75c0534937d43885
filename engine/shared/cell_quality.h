// How good the shape of a cell is.
#pragma once

#include <array>

#include "octree/geometry.h"

namespace locvol {

// A flat cell has an infinite radius and ratio, and angles of 0 and 180 degrees.
struct CellQuality {
  double circumradius = 0, radius_edge_ratio = 0;
  double min_dihedral_degrees = 180, max_dihedral_degrees = 0;
};
CellQuality quality_of(const std::array<Point, 4>& corners);

}  // namespace locvol
