#include "engine/run/point_grid.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <tuple>

namespace locvol {

PointGrid::CellIndex PointGrid::cell_of(const Point& p) const {
  const auto index = [&](double v) {
    return static_cast<std::int64_t>(std::floor(v / cell_side_));
  };
  return {index(p.x), index(p.y), index(p.z)};
}

void PointGrid::insert(const MeshPoint& point) { cells_[cell_of(point.position)].push_back(point); }

void PointGrid::erase(const MeshPoint& point) {
  const auto cell = cells_.find(cell_of(point.position));
  assert(cell != cells_.end());
  [[maybe_unused]] const auto num_erased =
      std::erase_if(cell->second, [&](const MeshPoint& p) { return p.id == point.id; });
  assert(num_erased == 1);
  if (cell->second.empty()) cells_.erase(cell);
}

std::optional<MeshPoint> PointGrid::nearest(
    const Point& q, double radius, const std::function<bool(std::uint64_t)>& is_deleted) const {
  const Box ball = Box::around(q).expanded(radius);
  const CellIndex low = cell_of(ball.min), high = cell_of(ball.max);
  const MeshPoint* best = nullptr;
  double best_distance2 = radius * radius;
  const auto consider = [&](const MeshPoint& p) {
    const double distance2 = squared_distance(p.position, q);
    const bool is_better = best == nullptr ? distance2 <= best_distance2
                                           : std::tie(distance2, p.position) <
                                                 std::tie(best_distance2, best->position);
    if (!is_better || is_deleted(p.id)) return;
    best = &p;
    best_distance2 = distance2;
  };
  for (std::int64_t i = low[0]; i <= high[0]; ++i)
    for (std::int64_t j = low[1]; j <= high[1]; ++j)
      for (std::int64_t k = low[2]; k <= high[2]; ++k)
        if (const auto cell = cells_.find({i, j, k}); cell != cells_.end())
          std::ranges::for_each(cell->second, consider);
  return best == nullptr ? std::nullopt : std::optional(*best);
}

}  // namespace locvol
