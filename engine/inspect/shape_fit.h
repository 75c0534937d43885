// Fits cones and tori to a few points, by steps of least squares: their equations are not linear.
#pragma once

#include <optional>
#include <span>

#include "octree/geometry.h"

namespace locvol {

// Around an axis; its tip is where the radius is 0.
struct FittedCone {
  Point tip, axis;        // from the tip into the cone, of length 1
  double half_angle = 0;  // in radians
};
struct FittedTorus {
  Point center, axis;
  double radius = 0, tube_radius = 0;  // of the circle in the middle of the tube, and of the tube
};

// `axes`: which the axis may be like, the likeliest first. Nothing where the points are too few, or
// none comes within the tolerance of all of them. Functions of what is given alone.
std::optional<FittedCone> fitted_cone(std::span<const Point> points, std::span<const Point> axes,
                                      double tolerance);
std::optional<FittedTorus> fitted_torus(std::span<const Point> points, std::span<const Point> axes,
                                        double tolerance);

}  // namespace locvol
