#include "refine/far_surface.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

#include "refine/closest_point.h"

namespace locvol {
namespace {

constexpr int kParts = 16;  // of a leaf, on each axis

}  // namespace

void FarSurface::add(const Box& leaf, std::span<const Triangle> triangles) {
  constexpr double kNone = std::numeric_limits<double>::infinity();
  struct Nearest {
    Point point;
    double squared_distance = kNone;
  };
  std::vector<Nearest> nearest(std::size_t{kParts} * kParts * kParts);
  const Point step = 1.0 / kParts * (leaf.max - leaf.min);
  const auto place = [&](double v, int axis) {
    const double part = std::floor((v - leaf.min[axis]) / step[axis]);
    return static_cast<int>(std::clamp(part, 0.0, kParts - 1.0));
  };
  for (const Triangle& triangle : triangles) {
    const Box box = triangle.box();
    if (!box.overlaps(leaf)) continue;
    std::array<int, 3> low{}, high{};
    for (int axis = 0; axis < 3; ++axis) {
      low[std::size_t(axis)] = place(box.min[axis], axis);
      high[std::size_t(axis)] = place(box.max[axis], axis);
    }
    for (int k = low[2]; k <= high[2]; ++k)
      for (int j = low[1]; j <= high[1]; ++j)
        for (int i = low[0]; i <= high[0]; ++i) {
          const Point corner = leaf.min + Point{i * step.x, j * step.y, k * step.z};
          const Point center = corner + 0.5 * step;
          const Point q = closest_on_triangle(triangle.corners, center);
          if (!Box{corner, corner + step}.contains(q)) continue;
          const double d = squared_distance(q, center);
          Nearest& held = nearest[std::size_t((k * kParts + j) * kParts + i)];
          if (d < held.squared_distance) held = {q, d};
        }
  }
  part_ = std::max(part_, max_norm(step));
  Group group{.box = {}, .first = points_.size(), .end = 0};
  for (const auto& [point, squared] : nearest) {
    if (squared == kNone) continue;
    group.box = points_.size() == group.first ? Box::around(point) : group.box.joined(point);
    points_.push_back(point);
  }
  group.end = points_.size();
  if (group.first < group.end) groups_.push_back(group);
}

void FarSurface::finish() {
  std::vector<Box> boxes;
  for (const Group& group : groups_) boxes.push_back(group.box);
  tree_ = BoxTree(std::move(boxes));
}

double FarSurface::distance(const Point& p, double bound) const {
  double squared = bound * bound;
  tree_.for_each_within(p, squared, [&](std::uint32_t n) {
    for (std::size_t i = groups_[n].first; i < groups_[n].end; ++i)
      squared = std::min(squared, squared_distance(points_[i], p));
  });
  if (!(squared < bound * bound)) return bound;
  // The surface is closer than its points: a plane, by a third of a part's diagonal aside.
  const double distance = std::sqrt(squared);
  return distance - std::min(0.125 * part_ * part_ / distance, 0.5 * distance);
}

}  // namespace locvol
