// The triangles on the sides of an edge of a crease. Internal to refine/.
#pragma once

#include <algorithm>
#include <vector>

#include "octree/crease.h"
#include "octree/geometry.h"
#include "refine/domain/leaf_domain.h"

namespace locvol {

// visit(triangle, corner beyond the edge) for those with both ends of the edge, in order of id.
// `at`: a place on it, in the region; `tolerance`: how far, by rounding, it may be off the edge
template <class Visit>
void for_each_at_edge(const LeafDomain& domain, const CreaseEdge& edge, const Point& at,
                      double tolerance, const Visit& visit) {
  std::vector<Triangle> near;
  domain.triangles_near(at, tolerance, near);
  const auto is_end = [&](const Point& p) { return p == edge.ends[0] || p == edge.ends[1]; };
  for (const Triangle& t : near)
    if (std::ranges::count_if(t.corners, is_end) == 2)
      visit(t, *std::ranges::find_if_not(t.corners, is_end));
}

struct EdgeSide {
  Point normal, way;  // unit; the way leads from the edge into it, at right angles to both
};

// `at`, `tolerance`: as above. An edge may be far longer than the region.
inline std::vector<EdgeSide> sides_of(const LeafDomain& domain, const CreaseEdge& edge,
                                      const Point& at, double tolerance) {
  const auto& [a, b] = edge.ends;
  const Point along = (1 / norm(b - a)) * (b - a);
  std::vector<EdgeSide> sides;
  for_each_at_edge(domain, edge, at, tolerance, [&](const Triangle& t, const Point& c) {
    const Point way = (c - a) - dot(c - a, along) * along, normal = normal_of(t.corners);
    if (norm(way) > 0 && norm(normal) > 0)
      sides.push_back({(1 / norm(normal)) * normal, (1 / norm(way)) * way});
  });
  return sides;
}

}  // namespace locvol
