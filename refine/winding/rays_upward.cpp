#include "refine/winding/rays_upward.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <utility>

#include "refine/domain/exact_predicates.h"

namespace locvol {

RaysUpward::RaysUpward(std::vector<Point> places)
    : places_(std::move(places)), sums_(places_.size()) {
  if (places_.empty()) return;
  constexpr double kMostAlong = 4096;
  side_ = static_cast<std::uint32_t>(
      std::clamp(std::sqrt(static_cast<double>(places_.size())), 1.0, kMostAlong));
  Box box = Box::around(places_[0]);
  for (const Point& p : places_) box = box.joined(p);
  for (const int axis : {0, 1}) {
    const double extent = box.max[axis] - box.min[axis];
    low_[static_cast<std::size_t>(axis)] = box.min[axis];
    inverse_[static_cast<std::size_t>(axis)] = extent > 0 ? side_ / extent : 0;
  }
  const auto square = [&](const Point& p) {
    return std::size_t{along(p.x, 0)} * side_ + along(p.y, 1);
  };
  first_.resize(std::size_t{side_} * side_ + 1);
  for (const Point& p : places_) ++first_[square(p) + 1];
  std::partial_sum(first_.begin(), first_.end(), first_.begin());
  std::vector<std::uint32_t> next = first_;
  listed_.resize(places_.size());
  for (std::uint32_t n = 0; n < places_.size(); ++n) listed_[next[square(places_[n])]++] = n;
}

std::uint32_t RaysUpward::along(double x, int axis) const {
  const auto i = static_cast<std::size_t>(axis);
  return static_cast<std::uint32_t>(
      std::clamp((x - low_[i]) * inverse_[i], 0.0, static_cast<double>(side_ - 1)));
}

void RaysUpward::add(const std::array<Point, 3>& corners) {
  if (places_.empty()) return;
  const Triangle triangle{.corners = corners};
  const Box box = triangle.box();
  const std::uint32_t j = along(box.min.y, 1), l = along(box.max.y, 1);
  for (std::uint32_t i = along(box.min.x, 0), k = along(box.max.x, 0); i <= k; ++i)
    for (std::size_t n = first_[std::size_t{i} * side_ + j],
                     end = first_[std::size_t{i} * side_ + l + 1];
         n < end; ++n) {
      const Point& p = places_[listed_[n]];
      if (p.x < box.min.x || p.x > box.max.x || p.y < box.min.y || p.y > box.max.y ||
          p.z > box.max.z || orientation_along(2, corners[0], corners[1], corners[2]) == 0)
        continue;
      sums_[listed_[n]] += ray_crosses(p, triangle);
    }
}

}  // namespace locvol
