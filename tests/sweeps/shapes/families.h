// The families of shapes: what CAD systems and scanners make, with all that is hard about it.
#pragma once

#include <span>
#include <string_view>

#include "tests/sweeps/shapes/dice.h"
#include "tests/sweeps/shapes/solid.h"

namespace locvol::sweeps {

struct Family {
  std::string_view name;
  Solid (*make)(Dice& dice);  // some units across, up to some dozens
};
std::span<const Family> families();
// Of several bodies.
std::span<const Family> families_of_bodies();

// Unions of boxes.
Solid make_box(Dice& dice);
Solid make_stack(Dice& dice);   // boxes that overlap and abut
Solid make_blocks(Dice& dice);  // cells of a grid, at random
Solid make_frame(Dice& dice);   // struts along the edges of a grid
Solid make_hollow(Dice& dice);  // a box with walls: closed, open, or with windows

// Prisms.
Solid make_plate(Dice& dice);   // with holes, pockets and bosses
Solid make_steps(Dice& dice);   // stairs
Solid make_ribs(Dice& dice);    // a comb, as of a heat sink
Solid make_gear(Dice& dice);    // straight or helical
Solid make_spiral(Dice& dice);  // a wound band
Solid make_fold(Dice& dice);    // a bent strip of sheet metal
Solid make_wedge(Dice& dice);   // knife edges
Solid make_twist(Dice& dice);   // a twisted bar or tube

// Around an axis, or along a curve.
Solid make_sphere(Dice& dice);
Solid make_torus(Dice& dice);
Solid make_shaft(Dice& dice);   // turned, with shoulders, grooves and a bore
Solid make_tube(Dice& dice);    // with a wall, straight or bent
Solid make_cone(Dice& dice);    // with a tip, or two
Solid make_needle(Dice& dice);  // a long thin bar, rod or spindle
Solid make_thread(Dice& dice);  // of a screw
Solid make_spring(Dice& dice);  // a wire along a helix
Solid make_shell(Dice& dice);   // a hollow sphere or a cup

// Others.
Solid make_sheet(Dice& dice);   // thin and wavy
Solid make_urchin(Dice& dice);  // a sphere with spikes
Solid make_scan(Dice& dice);    // a rough sphere
Solid make_hull(Dice& dice);    // the convex hull of some points
Solid make_pair(Dice& dice);    // two parts that nearly touch
Solid make_nested(Dice& dice);  // a part in the cavity of another, which it nearly touches

// Several bodies.
Solid make_bricks(Dice& dice);  // side by side
Solid make_onion(Dice& dice);   // in each other
Solid make_apart(Dice& dice);   // without contact
Solid make_grains(Dice& dice);  // of a polycrystal

}  // namespace locvol::sweeps
