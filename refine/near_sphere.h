// Points so near a sphere, or cells so flat, that single precision does not tell. Internal to
// refine/.
#pragma once

#include <array>
#include <optional>

#include "octree/geometry.h"

namespace locvol {

// Tells whether p is inside the circumsphere of the positively oriented cell. It asks doubles, then
// twice their precision, which tells nearly always where coordinates were rounded: on planes at an
// angle to the axes above all, in a twentieth of the time of exact arithmetic. Empty where it is
// not certain, as for cospherical points.
std::optional<bool> is_in_near_sphere(const std::array<Point, 4>& cell, const Point& p);

}  // namespace locvol
