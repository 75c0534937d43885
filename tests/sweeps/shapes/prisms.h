// Solids from plane polygons: prisms with holes, pockets and bosses, and solids of revolution.
#pragma once

#include <vector>

#include "tests/sweeps/shapes/solid.h"

namespace locvol::sweeps {

struct Point2 {
  double x = 0, y = 0;
};
using Ring = std::vector<Point2>;  // closed; its last point is not its first

Ring rectangle(const Point2& min, const Point2& max);
Ring regular_polygon(const Point2& center, double radius, int num_sides, double phase = 0);
Ring reversed(Ring ring);
double signed_area(const Ring& ring);

// An area with holes: its outline counterclockwise, holes clockwise, without common points.
using Region = std::vector<Ring>;
double area(const Region& region);

// A part of the top of a prism that lies `height` above or (a pocket) below the rest.
struct Boss {
  Ring outline;  // counterclockwise, within the region, beside its holes and the other bosses
  double height = 0;
};

// All points of the region between z = 0 and `height`. Its thickness is for the caller to say.
Solid prism(const Region& region, double height, const std::vector<Boss>& bosses = {});
// The same, turned about the z axis on its way up; `angle` in all. Without a claim of its volume.
Solid twisted_prism(const Region& region, double height, double angle, int num_steps);

// A profile (x: distance from the axis, y: height; counterclockwise) turned about the z axis in
// `num_sides` steps: planar quadrilaterals, and triangles where it meets the axis.
Solid turned(const Ring& profile, int num_sides);

}  // namespace locvol::sweeps
