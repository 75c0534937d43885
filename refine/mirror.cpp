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

Point unit(const Point& normal) {
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

// Where sheets meet, it may be closest to several.
bool is_at_one_of(const Point& place, const Point& p, const std::vector<MirrorPoint>& mirrors) {
  return place == p || std::ranges::find(mirrors, place, &MirrorPoint::position) != mirrors.end();
}

// A turn of a right angle is none by more, but for rounding.
bool turns_away(const Point& normal, const Point& other) {
  constexpr double kCosine = -0.01;
  return dot(normal, other) < kCosine;
}

// On the other side of a thin wall: how far a mirror is moved aside, so that it is not straight
// across. Two points and their mirrors would be in a circle, and many cells there flat. Of both
// mirrors of each other it is the same, so that two points and their mirrors stay in a plane.
// `way`: from the mirror to its point. Below half of the square of the way over λ it joins no
// sides: a place of one is still closer to samples of its own.
Point sheared(const Point& way, double size) {
  constexpr double kShear = 0.03, kThin = 0.25;  // of the square, of λ
  static const Point kAxis = {0.55, 0.6, 0.58};
  const double length = norm(way);
  return length < kThin * size ? kShear / size * length * cross(kAxis, way) : Point{};
}

// Those of p itself. Returns its own side.
SurfaceSide direct_mirrors_of(const LeafDomain& domain, const Point& p, double reach,
                              double farthest, std::vector<MirrorPoint>& out) {
  const auto closest_here = domain.closest_to(p, reach);
  if (!closest_here) return {};
  const SurfaceSide& here = closest_here->side;
  const Point normal_here = unit(here.normal);
  std::vector<Triangle> near;
  domain.triangles_near(p, reach, near);
  std::vector<ClosestOfSheet> closest;  // of each sheet that turns by so much
  for (const Triangle& t : near) {
    const auto known = std::ranges::find(closest, t.sheet, &ClosestOfSheet::sheet);
    const double most = known == closest.end() ? reach * reach : known->squared_distance;
    if (t.sheet == here.sheet && !(dot(normal_here, normal_of(t.corners)) < 0)) continue;
    if (t.box().squared_distance(p) >= most) continue;
    const Point place = closest_on_triangle(t.corners, p);
    const double distance2 = squared_distance(p, place);
    if (distance2 >= most) continue;
    const Point normal = unit(normal_of(t.corners));
    if (t.sheet == here.sheet && !faces(p, place, normal)) continue;
    if (known == closest.end())
      closest.push_back({t.sheet, place, normal, distance2});
    else
      *known = {t.sheet, place, normal, distance2};
  }
  std::erase_if(
      closest, [&](const ClosestOfSheet& other) { return !turns_away(normal_here, other.normal); });
  if (closest.empty()) return here;  // nearly always, where nothing is thin or acute
  domain.triangles_near(p, farthest, near);
  std::ranges::sort(closest, {}, &ClosestOfSheet::sheet);
  for (const ClosestOfSheet& other : closest) {
    const Point across = normal_here - other.normal;
    const double off = 2 * dot(other.normal, other.position - p) / dot(across, across);
    const bool is_inside = off > 0;  // what lies between the two
    const Point image = p - off * across + (is_inside ? sheared(off * across, reach) : Point{});
    MirrorPoint mirror;
    double least = reach * reach;
    for (const Triangle& t : near) {
      if (t.sheet != other.sheet || t.box().squared_distance(image) >= least) continue;
      if (t.sheet == here.sheet && !(dot(normal_here, normal_of(t.corners)) < 0)) continue;
      const Point position = closest_on_triangle(t.corners, image);
      if (squared_distance(image, position) >= least) continue;
      least = squared_distance(image, position);
      mirror = {position, {t.sheet, normal_of(t.corners)}};
    }
    if (least < reach * reach && squared_distance(p, mirror.position) <= farthest * farthest &&
        !is_at_one_of(mirror.position, p, out))
      out.push_back(mirror);
  }
  return here;
}

}  // namespace

void mirrors_of(const LeafDomain& domain, const Point& p, double reach, double farthest,
                std::vector<MirrorPoint>& out) {
  out.clear();
  const SurfaceSide here = direct_mirrors_of(domain, p, reach, farthest, out);
  if (out.empty()) return;
  std::vector<Point> nearest;  // of these the first have mirrors on what others have theirs on
  for (const MirrorPoint& mirror : out) nearest.push_back(mirror.position);
  std::ranges::stable_sort(nearest, {}, [&](const Point& q) { return squared_distance(p, q); });
  constexpr std::size_t kMost = 2;
  std::vector<MirrorPoint> further;
  for (std::size_t n = 0; n < std::min(nearest.size(), kMost); ++n) {
    further.clear();
    direct_mirrors_of(domain, nearest[n], reach, farthest, further);
    for (const MirrorPoint& mirror : further) {
      const auto is_there = [&](const MirrorPoint& known) {
        return are_same(known.side, mirror.side);
      };
      if (!are_same(here, mirror.side) && std::ranges::none_of(out, is_there) &&
          squared_distance(p, mirror.position) <= farthest * farthest &&
          !is_at_one_of(mirror.position, p, out))
        out.push_back(mirror);
    }
  }
}

}  // namespace locvol
