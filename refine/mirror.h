// Mirrors of a point of the surface: what keeps sheets apart that face each other, or meet in an
// acute crease. Internal to refine/.
//
// Where each sheet's points are the other's mirrored, a place of one sheet is never closer to the
// points of the other than to its own. So no facet joins the two but at their crease.
#pragma once

#include <vector>

#include "octree/geometry.h"
#include "refine/domain/leaf_domain.h"

namespace locvol {

// How far from a point another sheet may be, over h, for its mirror to matter.
inline constexpr double kMirrorReach = 0.84;

// How far it may be from its mirror.
inline constexpr double kMirrorDistance = 1.3;

struct MirrorPoint {
  Point position;
  SurfaceSide side;
};

// Of a point of the surface: for each other sheet closer than `reach` whose normal turns by more
// than 90 degrees from that here, the point's image in the plane that bisects the tangent planes
// here and at the sheet's closest place, moved to where the sheet is closest to it, unless that is
// farther than `farthest` from the point. Likewise of its own sheet, where that faces it. Then the
// mirrors of the nearest two of these, on sides that have none so far: beside an acute edge at a
// gap, one lies across the gap. REQUIRES: the domain is loaded within twice both
void mirrors_of(const LeafDomain& domain, const Point& p, double reach, double farthest,
                std::vector<MirrorPoint>& out);

}  // namespace locvol
