// Mirrors of a point of the surface: what keeps sheets apart that face each other, or meet in an
// acute crease. Internal to refine/.
//
// Where each sheet's points are the other's mirrored, a place of one sheet is never closer to the
// points of the other than to its own. So no facet joins the two but at their crease.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "octree/geometry.h"
#include "refine/domain/leaf_domain.h"

namespace locvol {

// How far from a point another sheet may be, over h, for its mirror to matter.
inline constexpr double kMirrorReach = 0.84;

// How far it may be from its mirror.
inline constexpr double kMirrorDistance = 1.3;

// A point of the mesh this close to where a mirror belongs, over the distance between the mirror
// and its point, will do in its place. A mirror may be off by 17% of that at creases of 10 degrees,
// and by 26 to 29% from 20 to 45 degrees, before facets join the two sheets (measured).
inline constexpr double kMirrorTolerance = 0.25;

struct MirrorPoint {
  Point position;
  SurfaceSide side;
};

// On the other side of a wall: how far a mirror is moved aside, so that it is not straight across.
// Two points and their mirrors would be in a circle, and many cells there flat. Of both mirrors of
// each other it is the same, so that two points and their mirrors stay in a plane. `way`: from the
// mirror to its point; `reach`: how long that may be. Below half of the square of the way over λ it
// joins no sides: a place of one is still closer to samples of its own.
Point sheared_across(const Point& way, double reach);

// Of a point of the surface: for each side that it sees, closer than `reach`, where the surface
// turns by more than 90 degrees from there to here around what lies between, the point's image in
// the plane that bisects the tangent planes here and at that side's closest place, moved to where
// the side is closest to it, unless that is farther than `farthest` from the point. Returns the
// point's own side. REQUIRES: the domain is loaded within both
SurfaceSide mirrors_of(const LeafDomain& domain, const Point& p, double reach, double farthest,
                       std::vector<MirrorPoint>& out);

// The same with the mirrors of mirrors, and so on, on each side one: through a stack of sheets, and
// around a crease where several meet. Of one body alone, whose walls and gaps are told apart by
// what is near them, none is farther than `farthest` from the point. Calls take(mirror, of which
// point), which tells whether those of this one follow.
template <class Take>
void for_each_in_orbit(const LeafDomain& domain, const Point& p, double reach, double farthest,
                       const Take& take) {
  std::vector<MirrorPoint> mirrors, sources;
  std::vector<SurfaceSide> sides;  // that have one
  const bool is_one_body = domain.only_body().has_value();
  Point source = p;
  for (std::size_t next = 0;; source = sources[next++].position) {
    const SurfaceSide here = mirrors_of(domain, source, reach, farthest, mirrors);
    if (sides.empty()) sides.push_back(here);
    for (const MirrorPoint& mirror : mirrors) {
      const auto is_same = [&](const SurfaceSide& side) { return are_same(side, mirror.side); };
      if (std::ranges::any_of(sides, is_same)) continue;
      sides.push_back(mirror.side);
      if (is_one_body && squared_distance(p, mirror.position) > farthest * farthest) continue;
      if (take(mirror, source)) sources.push_back(mirror);
    }
    if (next == sources.size()) return;
  }
}

}  // namespace locvol
