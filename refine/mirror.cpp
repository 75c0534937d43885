#include "refine/mirror.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "refine/domain/closest_point.h"

namespace locvol {
namespace {

struct ClosestOfSheet {
  SheetId sheet = kOnlySheet;
  Point position, normal;
  double squared_distance = 0;
};

Point unit_normal_of(const Triangle& t) {
  const Point normal = normal_of(t.corners);
  const double length = norm(normal);
  return length > 0 ? (1 / length) * normal : Point{};
}

// Is p nearly straight above or below a place where it is closest to the surface? To the rim of
// what turns away from it, it is not.
bool faces(const Point& p, const Point& place, const Point& normal) {
  constexpr double kCosine = 0.7;
  const Point way = p - place;
  return std::abs(dot(way, normal)) >= kCosine * norm(way);
}

}  // namespace

void mirrors_of(const LeafDomain& domain, const Point& p, double reach, double farthest,
                std::vector<MirrorPoint>& out) {
  out.clear();
  std::vector<Triangle> near;
  domain.triangles_near(p, farthest, near);
  std::vector<Point> places;  // where each is closest
  const Triangle* of_here = nullptr;
  double least_here = reach * reach;
  for (const Triangle& t : near) {
    places.push_back(closest_on_triangle(t.corners, p));
    if (const double d2 = squared_distance(p, places.back()); d2 < least_here)
      least_here = d2, of_here = &t;
  }
  if (of_here == nullptr) return;
  const SheetId here = of_here->sheet;
  const Point normal_here = unit_normal_of(*of_here);
  std::vector<ClosestOfSheet> closest;  // of each sheet that turns by so much
  for (std::size_t i = 0; i < near.size(); ++i) {
    const Triangle& t = near[i];
    const double distance2 = squared_distance(p, places[i]);
    if (distance2 >= reach * reach) continue;
    const Point normal = unit_normal_of(t);
    if (t.sheet == here && (!(dot(normal_here, normal) < 0) || !faces(p, places[i], normal)))
      continue;
    const auto known = std::ranges::find(closest, t.sheet, &ClosestOfSheet::sheet);
    if (known == closest.end())
      closest.push_back({t.sheet, places[i], normal, distance2});
    else if (distance2 < known->squared_distance)
      *known = {t.sheet, places[i], normal, distance2};
  }
  std::ranges::sort(closest, {}, &ClosestOfSheet::sheet);
  for (const ClosestOfSheet& other : closest) {
    if (!(dot(normal_here, other.normal) < 0)) continue;
    const Point across = normal_here - other.normal;
    const double off = 2 * dot(other.normal, other.position - p) / dot(across, across);
    const Point image = p - off * across;
    MirrorPoint mirror;
    double least = reach * reach;
    for (const Triangle& t : near) {
      if (t.sheet != other.sheet || t.box().squared_distance(image) >= least) continue;
      if (t.sheet == here && !(dot(normal_here, normal_of(t.corners)) < 0)) continue;
      const Point position = closest_on_triangle(t.corners, image);
      if (squared_distance(image, position) >= least) continue;
      least = squared_distance(image, position);
      mirror = {position, {t.sheet, normal_of(t.corners)}};
    }
    if (least < reach * reach && squared_distance(p, mirror.position) <= farthest * farthest)
      out.push_back(mirror);
  }
}

}  // namespace locvol
