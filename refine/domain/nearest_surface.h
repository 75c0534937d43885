// NearestSurface tells how far places are from the surface, also from what is far: by a tree over
// all of it. (LeafDomain has a grid, for what is near.)
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

#include "octree/geometry.h"
#include "refine/domain/box_tree.h"
#include "refine/domain/closest_point.h"
#include "refine/domain/leaf_domain.h"

namespace locvol {

class NearestSurface {
 public:
  // The domain must outlive it.
  explicit NearestSurface(const LeafDomain& domain) : triangles_(domain.triangles()) {
    std::vector<Box> boxes;
    for (const Triangle& t : triangles_) {
      boxes.push_back(t.box());
      planes_.push_back(plane_of(t));
    }
    tree_ = BoxTree(std::move(boxes));
  }

  // What is known of a place: a triangle near it, if any, and a bound of the distance.
  struct Known {
    std::uint32_t triangle = kNone;
    double bound = std::numeric_limits<double>::infinity();
  };
  // Notes the triangle that is nearest to p. A little more than the bound if none is nearer.
  double distance(const Point& p, Known& known) const {
    double squared = known.bound * known.bound * (1 + 1e-9);
    if (known.triangle != kNone)
      squared = std::min(squared, squared_distance_of(known.triangle, p));
    tree_.for_each_within(p, squared, [&](std::uint32_t n) {
      const double off = dot(planes_[n].normal, p) - planes_[n].offset;
      if (off * off >= squared) return;
      const double d = squared_distance_of(n, p);
      if (d < squared) squared = d, known.triangle = n;
    });
    return std::sqrt(squared);
  }

 private:
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

  // Of a triangle: no place of it is closer to p than its plane. Most of those whose boxes are near
  // are seen to be farther so.
  struct Plane {
    Point normal;  // of length 1; of a flat triangle 0
    double offset = 0;
  };
  static Plane plane_of(const Triangle& t) {
    const auto& [a, b, c] = t.corners;
    const Point normal = cross(b - a, c - a);
    const double length = norm(normal);
    if (!(length > 0)) return {};
    const Point unit = 1 / length * normal;
    return {unit, dot(unit, a)};
  }

  double squared_distance_of(std::uint32_t n, const Point& p) const {
    return squared_distance(p, closest_on_triangle(triangles_[n].corners, p));
  }

  std::span<const Triangle> triangles_;
  std::vector<Plane> planes_;
  BoxTree tree_;
};

}  // namespace locvol
