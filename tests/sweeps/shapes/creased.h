// Shapes with creases of one kind each, by a measure that goes through its range: angles, steps,
// slots, corners of many creases. A unit is λ.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "tests/sweeps/shapes/solid.h"

namespace locvol::sweeps {

struct CreasedShape {
  std::string_view kind;
  double measure = 0;  // degrees, λ or a count, as the kind has it
  bool is_oblique = false;
  Solid solid;

  std::string name() const;  // such as "wedge 20 oblique"
  // All of its creases must be kept, without a site: nothing is smaller than the spacing floor, and
  // no corner is sharper, and has no more creases, than the mesher can do.
  bool is_to_be_whole() const;
};

// All, in a fixed order. Each is there twice if it is a prism: along the axes, with edges that
// begin side by side; and oblique, with edges that begin beside each other's samples, turned so
// that nothing is along an axis. Others are there as they are and turned.
std::vector<CreasedShape> creased_shapes();

}  // namespace locvol::sweeps
