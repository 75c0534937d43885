#include "refine/domain/fragment.h"

#include <cmath>
#include <limits>

#include "octree/mix.h"

namespace locvol {
namespace {

// The part of the polygon on one side of an axis plane (sign +1: at or above it; -1: at or below).
void clip(std::vector<Point>& polygon, int axis, double plane, double sign) {
  std::vector<Point> kept;
  kept.reserve(polygon.size() + 2);
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Point& a = polygon[i];
    const Point& b = polygon[(i + 1) % polygon.size()];
    const bool is_a_kept = sign * a[axis] >= sign * plane;
    const bool is_b_kept = sign * b[axis] >= sign * plane;
    if (is_a_kept) kept.push_back(a);
    if (is_a_kept == is_b_kept) continue;
    Point cut = a + (plane - a[axis]) / (b[axis] - a[axis]) * (b - a);
    cut[axis] = plane;
    kept.push_back(clamped(cut, Box::around(a).joined(b)));
  }
  polygon = std::move(kept);
}

}  // namespace

Point clamped(const Point& p, const Box& box) {
  return {std::clamp(p.x, box.min.x, box.max.x), std::clamp(p.y, box.min.y, box.max.y),
          std::clamp(p.z, box.min.z, box.max.z)};
}

std::array<Fragment, 2> halves(const Fragment& f, std::size_t edge) {
  const Point& a = f.corners[edge];
  const Point& b = f.corners[(edge + 1) % 3];
  const Point& apex = f.corners[(edge + 2) % 3];
  const Point middle = 0.5 * (a + b);
  return {Fragment{{a, middle, apex}, mix(f.key), f.sheet},
          Fragment{{middle, b, apex}, mix(f.key ^ 1), f.sheet}};
}

Box closed(const Box& box) {
  const auto before = [](double v) {
    return std::nextafter(v, -std::numeric_limits<double>::infinity());
  };
  return {box.min, {before(box.max.x), before(box.max.y), before(box.max.z)}};
}

std::vector<Fragment> fragments_in(const Box& box, const LeafDomain& domain, std::uint64_t seed,
                                   const StopToken* stop) {
  StopPoll poll(stop);
  const Box owned = closed(box);
  std::vector<Fragment> fragments;
  for (const Triangle& triangle : domain.triangles()) {
    poll();
    const Box bounds = triangle.box();
    if (!bounds.overlaps(owned)) continue;
    const std::uint64_t key = mix(mix(seed) ^ triangle.id);
    if (owned.contains(bounds.min) && owned.contains(bounds.max)) {
      fragments.push_back({triangle.corners, key, triangle.sheet});
      continue;
    }
    const std::vector<Point> polygon = clipped(triangle, box);
    for (std::size_t i = 2; i < polygon.size(); ++i)
      fragments.push_back({{polygon[0], polygon[i - 1], polygon[i]}, mix(key + i), triangle.sheet});
  }
  return fragments;
}

std::vector<Point> clipped(const Triangle& triangle, const Box& box) {
  std::vector<Point> polygon(triangle.corners.begin(), triangle.corners.end());
  for (int axis = 0; axis < 3; ++axis) {
    clip(polygon, axis, box.min[axis], +1);
    clip(polygon, axis, box.max[axis], -1);
  }
  return polygon;
}

}  // namespace locvol
