#include "refine/mirror.h"

#include <algorithm>

#include "refine/domain/closest_point.h"

namespace locvol {
namespace {

struct ClosestOfSheet {
  SheetId sheet = kOnlySheet;
  Point position, normal;
  double squared_distance = 0;
};

Point unit_normal_of(const Triangle& t) {
  const Point normal = cross(t.corners[1] - t.corners[0], t.corners[2] - t.corners[0]);
  const double length = norm(normal);
  return length > 0 ? (1 / length) * normal : Point{};
}

}  // namespace

void mirrors_of(const LeafDomain& domain, const Point& p, double reach, double farthest,
                std::vector<MirrorPoint>& out) {
  out.clear();
  std::vector<Triangle> near;
  domain.triangles_near(p, reach, near);
  std::vector<ClosestOfSheet> closest;  // of each sheet
  for (const Triangle& t : near) {
    const Point position = closest_on_triangle(t.corners, p);
    const double distance2 = squared_distance(p, position);
    if (distance2 >= reach * reach) continue;
    const auto known = std::ranges::find(closest, t.sheet, &ClosestOfSheet::sheet);
    if (known == closest.end())
      closest.push_back({t.sheet, position, unit_normal_of(t), distance2});
    else if (distance2 < known->squared_distance)
      *known = {t.sheet, position, unit_normal_of(t), distance2};
  }
  if (closest.size() < 2) return;
  std::ranges::sort(closest, {}, &ClosestOfSheet::sheet);
  const ClosestOfSheet here =
      *std::ranges::min_element(closest, {}, &ClosestOfSheet::squared_distance);
  for (const ClosestOfSheet& other : closest) {
    if (other.sheet == here.sheet || !(dot(here.normal, other.normal) < 0)) continue;
    const Point across = here.normal - other.normal;
    const double off = 2 * dot(other.normal, other.position - p) / dot(across, across);
    const Point image = p - off * across;
    domain.triangles_near(image, reach, near);
    MirrorPoint mirror{{}, other.sheet};
    double least = reach * reach;
    for (const Triangle& t : near) {
      if (t.sheet != other.sheet) continue;
      const Point position = closest_on_triangle(t.corners, image);
      if (squared_distance(image, position) >= least) continue;
      least = squared_distance(image, position);
      mirror.position = position;
    }
    if (least < reach * reach && squared_distance(p, mirror.position) <= farthest * farthest)
      out.push_back(mirror);
  }
}

}  // namespace locvol
