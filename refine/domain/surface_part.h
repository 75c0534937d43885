// What can be told of the surface in a box without a LeafDomain.
#pragma once

#include "octree/domain_state.h"
#include "octree/geometry.h"
#include "octree/leaf_surface.h"

namespace locvol {

// All that meets the box, and perhaps some triangles that only come close.
LeafSurface part_in(const Box& box, const LeafSurface& surface);

// Its half: adds creases and corners that meet the box.
void append_creases(const Box& box, const LeafSurface& surface, LeafSurface& part);

// About how much of it is in the box.
double area_in(const Box& box, const LeafSurface& surface);

// Adds triangles that are no farther from p than the distance; some of them are perhaps there.
void append_near(const Point& p, double distance, const LeafSurface& surface, LeafSurface& near);
// Tells whether what is closest to p leads on, farther away than that. `near`: all that is not
bool leads_on(const Point& p, double distance, const LeafSurface& near);

// REQUIRES: all that meets the box is there
CornerStates center_to_corners(const Box& box, const LeafSurface& surface);

}  // namespace locvol
