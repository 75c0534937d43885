#include "refine/mirror.h"

#include <algorithm>
#include <cmath>

#include "refine/domain/closest_point.h"

namespace locvol {
namespace {

struct ClosestOfSheet {
  SheetId sheet = kOnlySheet;
  Point position, normal;
  double squared_distance = 0;
  Point normal_here = {};  // that of the sheet it is seen from
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
constexpr double kRightAngle = -0.01;

// Does the surface turn by more than 90 degrees from there to p, around what lies between? Between
// bodies a sheet has two sides, and may be given either way: both normals are turned to what lies
// between, as far as they tell.
bool turns_away(const Point& p, const Point& outwards, bool is_one_body, ClosestOfSheet& there) {
  constexpr double kTold = 0.2;
  there.normal_here = outwards;
  if (!is_one_body) {
    const Point way = unit(p - there.position);
    const double rise = dot(there.normal, way), rise_here = dot(outwards, way);
    if (std::abs(rise) < kTold || std::abs(rise_here) < -kRightAngle) return false;
    if (rise < 0) there.normal = -1.0 * there.normal;
    if (rise_here > 0) there.normal_here = -1.0 * outwards;
  }
  return dot(there.normal_here, there.normal) < kRightAngle;
}

// Does no other side stand between the two, which lie on theirs?
bool sees(const LeafDomain& domain, const Point& p, const Point& place) {
  constexpr double kEnd = 1e-3;  // of the way
  const Point end = kEnd * (place - p);
  return !domain.is_crossed(p + end, place - end);
}

// The triangles near a place, sheet by sheet: there may be hundreds of these.
void find_by_sheets(const LeafDomain& domain, const Point& p, double distance,
                    std::vector<Triangle>& out) {
  domain.triangles_near(p, distance, out);
  if (!std::ranges::is_sorted(out, {}, &Triangle::sheet))
    std::ranges::stable_sort(out, {}, &Triangle::sheet);
}

}  // namespace

Point sheared_across(const Point& way, double reach) {
  constexpr double kShear = 0.03;  // of the square
  static const Point kAxis = {0.55, 0.6, 0.58};
  return kShear / reach * norm(way) * cross(kAxis, way);
}

SurfaceSide mirrors_of(const LeafDomain& domain, const Point& p, double reach, double farthest,
                       std::vector<MirrorPoint>& out) {
  out.clear();
  const auto closest_here = domain.closest_to(p, reach);
  if (!closest_here) return {};
  const SurfaceSide& here = closest_here->side;
  const Point outwards = unit(here.normal);
  std::vector<Triangle> near;
  find_by_sheets(domain, p, reach, near);
  std::vector<ClosestOfSheet> closest;  // of each other sheet, and of what faces p of its own
  for (const Triangle& t : near) {
    const bool is_known = !closest.empty() && closest.back().sheet == t.sheet;
    const double most = is_known ? closest.back().squared_distance : reach * reach;
    if (t.sheet == here.sheet && !(dot(outwards, normal_of(t.corners)) < 0)) continue;
    if (t.box().squared_distance(p) >= most) continue;
    const Point place = closest_on_triangle(t.corners, p);
    const double distance2 = squared_distance(p, place);
    if (distance2 >= most) continue;
    const Point normal = unit(normal_of(t.corners));
    if (t.sheet == here.sheet && !faces(p, place, normal)) continue;
    if (!is_known) closest.emplace_back();
    closest.back() = {t.sheet, place, normal, distance2};
  }
  const bool is_one_body = domain.only_body().has_value();
  std::erase_if(closest, [&](ClosestOfSheet& other) {
    return !turns_away(p, outwards, is_one_body, other) || !sees(domain, p, other.position);
  });
  if (closest.empty()) return here;  // nearly always, where nothing is thin or acute
  find_by_sheets(domain, p, farthest, near);
  for (const ClosestOfSheet& other : closest) {
    const Point across = other.normal_here - other.normal;
    const double off = 2 * dot(other.normal, other.position - p) / dot(across, across);
    const Point way = off * across;
    // And no gap. Through a stack of bodies, one would lead farther and farther aside. Where sides
    // lean towards each other, two points and their mirrors are in a circle, too, but seldom does a
    // cell lead across from there, unless it is thin.
    constexpr double kThin = 0.25, kParallel = -0.95;  // of what it may be; a cosine
    const bool is_wall =
        is_one_body &&
        (dot(other.normal_here, other.normal) < kParallel || norm(way) < kThin * reach) &&
        is_in_body(domain.label(p - 0.5 * way));
    const Point image = p - way + (is_wall ? sheared_across(way, reach) : Point{});
    MirrorPoint mirror;
    double least = reach * reach;
    for (const Triangle& t : std::ranges::equal_range(near, other.sheet, {}, &Triangle::sheet)) {
      if (t.box().squared_distance(image) >= least) continue;
      if (t.sheet == here.sheet && !(dot(outwards, normal_of(t.corners)) < 0)) continue;
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

}  // namespace locvol
