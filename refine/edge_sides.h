// The triangles on the sides of an edge of a crease. Internal to refine/.
#pragma once

#include <algorithm>
#include <vector>

#include "octree/crease.h"
#include "octree/geometry.h"
#include "refine/domain/leaf_domain.h"

namespace locvol {

struct EdgeSide {
  Point normal, way;  // unit; the way leads from the edge into it, at right angles to both
};

// `tolerance`: how far from the edge's middle, by rounding, its triangles may be.
inline std::vector<EdgeSide> sides_of(const LeafDomain& domain, const CreaseEdge& edge,
                                      double tolerance) {
  const auto& [a, b] = edge.ends;
  const Point along = (1 / norm(b - a)) * (b - a);
  std::vector<Triangle> near;
  domain.triangles_near(0.5 * (a + b), tolerance, near);
  std::vector<EdgeSide> sides;
  for (const Triangle& t : near) {
    const auto is_end = [&](const Point& p) { return p == a || p == b; };
    if (std::ranges::count_if(t.corners, is_end) != 2) continue;
    const Point& c = *std::ranges::find_if_not(t.corners, is_end);
    const Point way = (c - a) - dot(c - a, along) * along, normal = normal_of(t.corners);
    if (norm(way) > 0 && norm(normal) > 0)
      sides.push_back({(1 / norm(normal)) * normal, (1 / norm(way)) * way});
  }
  return sides;
}

}  // namespace locvol
