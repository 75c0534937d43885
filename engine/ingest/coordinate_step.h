// CoordinateStep tells how finely coordinates are given, from the coordinates alone: what lies a
// few steps apart may have been at one place before it was rounded.
#pragma once

#include "octree/geometry.h"

namespace locvol {

class CoordinateStep {
 public:
  void add(const Point& p);

  // Between neighboring values as large as the largest coordinate: of single precision, if all fit
  // in it; else a unit of the last decimal digit that any has. 0: they are as fine as doubles are,
  // or have so few digits that nothing was rounded.
  double value() const;

 private:
  void add(double coordinate);

  int num_digits_ = 1;  // decimal ones, of the coordinate that has most
  bool is_single_ = true;
  double largest_ = 0;
};

}  // namespace locvol
