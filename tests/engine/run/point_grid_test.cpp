#include "engine/run/point_grid.h"

#include <gtest/gtest.h>

#include <random>
#include <tuple>

namespace locvol {
namespace {

const auto kNone = [](std::uint64_t) { return false; };

std::optional<MeshPoint> nearest_of_all(const std::vector<MeshPoint>& points, const Point& q,
                                        double radius) {
  std::optional<MeshPoint> best;
  for (const MeshPoint& p : points) {
    if (squared_distance(p.position, q) > radius * radius) continue;
    const auto rank = [&](const MeshPoint& m) {
      return std::tuple(squared_distance(m.position, q), m.position);
    };
    if (!best || rank(p) < rank(*best)) best = p;
  }
  return best;
}

TEST(PointGrid, FindsTheNearestOfAllPointsWhileTheyComeAndGo) {
  const std::uint64_t seed = std::random_device{}();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937_64 random(seed);
  // Few distinct coordinates make ties common.
  std::uniform_int_distribution<int> coordinate(-12, 12);
  const auto random_point = [&] {
    return Point{0.25 * coordinate(random), 0.25 * coordinate(random), 0.25 * coordinate(random)};
  };
  PointGrid grid(0.7);
  std::vector<MeshPoint> points;
  for (std::uint64_t id = 0; id < 2000; ++id) {
    if (random() % 4 == 0 && !points.empty()) {
      const auto gone = points.begin() + static_cast<std::ptrdiff_t>(random() % points.size());
      grid.erase(*gone);
      points.erase(gone);
    } else {
      const MeshPoint point{id, random_point(), PointKind::kVolume};
      if (nearest_of_all(points, point.position, 0)) continue;
      grid.insert(point);
      points.push_back(point);
    }
    const Point q = random_point();
    const double radius = 0.25 * static_cast<double>(random() % 8);
    EXPECT_EQ(grid.nearest(q, radius, kNone), nearest_of_all(points, q, radius));
  }
}

TEST(PointGrid, BreaksTiesLexicographicallyAndLeavesOutTheDeleted) {
  PointGrid grid(1);
  grid.insert({7, {1, 0, 0}, PointKind::kVolume});
  grid.insert({8, {-1, 0, 0}, PointKind::kVolume});
  EXPECT_EQ(grid.nearest({0, 0, 0}, 1, kNone)->id, 8U);
  EXPECT_EQ(grid.nearest({0, 0, 0}, 1, [](std::uint64_t id) { return id == 8; })->id, 7U);
  EXPECT_FALSE(grid.nearest({0, 0, 0}, 0.999, kNone));
}

}  // namespace
}  // namespace locvol
