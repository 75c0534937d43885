#include "refine/domain/surface_part.h"

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <map>
#include <vector>

#include "octree/sort_and_unite.h"
#include "refine/domain/closest_point.h"
#include "refine/domain/crossing.h"
#include "refine/domain/triangle_box.h"

namespace locvol {

LeafSurface part_in(const Box& box, const LeafSurface& surface) {
  LeafSurface part;
  std::ranges::copy_if(surface.triangles, std::back_inserter(part.triangles),
                       [&](const Triangle& t) { return meets(t, box); });
  append_creases(box, surface, part);
  return part;
}

void append_creases(const Box& box, const LeafSurface& surface, LeafSurface& part) {
  std::ranges::copy_if(surface.creases, std::back_inserter(part.creases),
                       [&](const CreaseEdge& edge) { return touches(edge, box); });
  std::ranges::copy_if(surface.corners, std::back_inserter(part.corners),
                       [&](const CornerPoint& corner) { return box.contains(corner.position); });
}

// By how much of a triangle's box is in it.
double area_in(const Box& box, const LeafSurface& surface) {
  double area = 0;
  for (const Triangle& triangle : surface.triangles) {
    const Box around = triangle.box();
    double share = 1;
    for (int axis = 0; axis < 3; ++axis) {
      const double width = around.max[axis] - around.min[axis];
      const double common =
          std::min(around.max[axis], box.max[axis]) - std::max(around.min[axis], box.min[axis]);
      if (width > 0) share *= std::max(0.0, common) / width;
    }
    const auto& [a, b, c] = triangle.corners;
    area += share * 0.5 * norm(cross(b - a, c - a));
  }
  return area;
}

void append_near(const Point& p, double distance, const LeafSurface& surface, LeafSurface& near) {
  std::ranges::copy_if(
      surface.triangles, std::back_inserter(near.triangles),
      [&](const Triangle& t) { return squared_distance(t, p) <= distance * distance; });
  sort_and_unite(near.triangles, &Triangle::id);
}

// From triangle to triangle, across common corners.
bool leads_on(const Point& p, double distance, const LeafSurface& near) {
  const std::vector<Triangle>& triangles = near.triangles;
  if (triangles.empty()) return false;
  std::multimap<Point, std::size_t> at;
  for (std::size_t n = 0; n < triangles.size(); ++n)
    for (const Point& corner : triangles[n].corners) at.emplace(corner, n);
  const auto nearest = std::ranges::min_element(
      triangles, {}, [&](const Triangle& t) { return squared_distance(t, p); });
  std::vector<bool> is_met(triangles.size());
  std::vector<std::size_t> next;
  const auto meet = [&](std::size_t n) {
    if (!is_met[n]) next.push_back(n);
    is_met[n] = true;
  };
  meet(static_cast<std::size_t>(nearest - triangles.begin()));
  while (!next.empty()) {
    const Triangle& t = triangles[next.back()];
    next.pop_back();
    for (const Point& corner : t.corners) {
      if (squared_distance(p, corner) > distance * distance) return true;
      const auto [first, end] = at.equal_range(corner);
      for (auto other = first; other != end; ++other) meet(other->second);
    }
  }
  return false;
}

CornerStates center_to_corners(const Box& box, const LeafSurface& surface) {
  const Point center = box.center();
  CornerStates corners;
  for (const Triangle& triangle : surface.triangles) {
    const Box tb = triangle.box();
    for (int k = 0; k < 8; ++k) {
      const Point corner{(k & 1 ? box.max : box.min).x, (k & 2 ? box.max : box.min).y,
                         (k & 4 ? box.max : box.min).z};
      if (tb.overlaps(Box::around(center).joined(corner)) &&
          segment_crosses(center, corner, triangle))
        corners.cross(k, change_across(triangle));
    }
  }
  return corners;
}

}  // namespace locvol
