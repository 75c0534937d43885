// The thread of a screw.
#pragma once

#include "tests/sweeps/shapes/solid.h"

namespace locvol::sweeps {

struct ScrewPlan {
  double root = 1;     // radius
  double pitch = 0.2;  // from turn to turn
  double depth = 0.1;  // of the groove
  double flat = 0;     // share of the pitch that its crest takes, and its ground
  int num_turns = 4;
  int num_sides = 32, rows_a_turn = 8;  // of the triangulation
};
Solid screw(const ScrewPlan& plan);

}  // namespace locvol::sweeps
