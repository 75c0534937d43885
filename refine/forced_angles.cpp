#include "refine/forced_angles.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "refine/cell_shape.h"
#include "refine/domain/closest_point.h"
#include "refine/edge_sides.h"

namespace locvol {
namespace {

// Of λ. Points are put on creases and sheets to within rounding.
constexpr double kOnSurface = 2e-6;
// From a corner of a triangle of unit sides to the edge across. One layer of cells has some with
// three points on one side and the fourth opposite one of these.
constexpr double kOverCorner = 0.866;

}  // namespace

ForcedAngles::ForcedAngles(DomainPiece piece, double size, double min_dihedral)
    : size_(size), min_dihedral_(min_dihedral), domain_(std::move(piece)) {}

bool ForcedAngles::are_forced(const std::array<Point, 4>& corners) const {
  std::array<OnSurface, 4> places;
  std::ranges::transform(corners, places.begin(), [&](const Point& p) { return find(p); });
  for (std::size_t i = 0; i < 4; ++i)
    for (std::size_t j = i + 1; j < 4; ++j)
      if (places[i].acute_crease > 0 && places[i].acute_crease == places[j].acute_crease)
        return true;
  return relative_width(corners, places) < kOverCorner * std::tan(min_dihedral_ * kDegree);
}

// As of C7's cells, but points on creases count on each of their sides. What a point lies on is as
// wide as nothing there.
double ForcedAngles::relative_width(const std::array<Point, 4>& corners,
                                    const std::array<OnSurface, 4>& places) {
  constexpr double kSame = 0.999, kFacing = -0.5;  // cosines between normals
  double width = std::numeric_limits<double>::infinity(), longest = 0;
  for (std::size_t i = 0; i < 4; ++i)
    for (std::size_t j = 0; j < 4; ++j) {
      longest = std::max(longest, squared_distance(corners[i], corners[j]));
      for (const Point& normal : places[i].normals) {
        const auto is_over = [&](double most) {
          return [&normal, most](const Point& n) { return dot(normal, n) > most; };
        };
        if (std::ranges::any_of(places[j].normals, is_over(kSame)) ||
            std::ranges::all_of(places[j].normals, is_over(kFacing)))
          continue;
        width = std::min(width, std::abs(dot(normal, corners[j] - corners[i])));
      }
    }
  const bool is_on_surface =
      std::ranges::none_of(places, [](const OnSurface& place) { return place.normals.empty(); });
  return is_on_surface ? width / std::sqrt(longest) : std::numeric_limits<double>::infinity();
}

ForcedAngles::OnSurface ForcedAngles::find(const Point& p) const {
  const double tolerance = kOnSurface * size_;
  OnSurface found;
  domain_.for_each_crease_near(p, tolerance, [&](std::size_t place) {
    const CreaseEdge& edge = domain_.creases()[place];
    const Point foot = closest_on_segment(edge.ends[0], edge.ends[1], p);
    if (squared_distance(foot, p) > tolerance * tolerance) return;
    double angle = 360;
    const std::vector<EdgeSide> sides = sides_of(domain_, edge, p, 2 * tolerance);
    for (const auto& [normal, way] : sides) {
      found.normals.push_back(normal);
      for (const auto& [other, other_way] : sides)
        if (way != other_way) angle = std::min(angle, angle_inside(normal, way, other_way));
    }
    if (angle < kAcuteCrease) found.acute_crease = std::max(found.acute_crease, edge.crease);
  });
  if (!found.normals.empty()) return found;
  if (const auto closest = domain_.closest_to(p, tolerance))
    found.normals.push_back((1 / norm(closest->side.normal)) * closest->side.normal);
  return found;
}

// Of the domain, between a side and another, in degrees.
double ForcedAngles::angle_inside(const Point& normal, const Point& way, const Point& other) {
  const double between = std::acos(std::clamp(dot(way, other), -1.0, 1.0)) / kDegree;
  return dot(normal, other) > 0 ? 360 - between : between;  // of a groove
}

}  // namespace locvol
