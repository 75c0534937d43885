// Points around the tip of a cone: with fewer, a slender one has no cells up to its tip.
// Internal to refine/.
#pragma once

#include <vector>

#include "octree/geometry.h"
#include "refine/domain/leaf_domain.h"

namespace locvol {

// How far they are from the tip at most, over h there, and how many. Five are closer to each other
// than samples are apart, on any cone.
inline constexpr double kTipRadius = 0.84;
inline constexpr int kNumAroundTip = 5;

// Points of the surface at one distance from the tip, at equal angles around its axis. The distance
// is `most`, or less where creases or other corners are near, or the surface is no cone up to
// there; there are none if that is below `least`. A function of the tip and the surface alone.
// REQUIRES: the region holds what is within twice `most` of the tip
std::vector<Point> ring_around_tip(const LeafDomain& domain, const Point& tip, double most,
                                   double least);

}  // namespace locvol
