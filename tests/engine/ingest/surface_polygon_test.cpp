#include <gtest/gtest.h>

#include <cmath>
#include <ctime>
#include <random>
#include <vector>

#include "engine/ingest/polygon_triangulation.h"

namespace locvol {
namespace {

using Triangles = std::vector<std::array<std::uint32_t, 3>>;

// n - 2 triangles, all turned like the polygon, whose areas sum up to its area: a triangulation.
void expect_triangulated(const std::vector<Point>& polygon, const Point& normal) {
  Triangles triangles;
  ASSERT_TRUE(triangulate_polygon(polygon, triangles));
  EXPECT_EQ(triangles.size(), polygon.size() - 2);
  double expected = 0, area = 0;
  for (std::size_t i = 1; i + 1 < polygon.size(); ++i)
    expected += dot(normal, cross(polygon[i] - polygon[0], polygon[i + 1] - polygon[0]));
  for (const auto& [a, b, c] : triangles) {
    const double part = dot(normal, cross(polygon[b] - polygon[a], polygon[c] - polygon[a]));
    EXPECT_GT(part, 0);
    area += part;
  }
  EXPECT_NEAR(area, expected, 1e-12 * expected);
}

TEST(PolygonTriangulation, CutsNonconvexPolygonsWithStraightCorners) {
  const Point up{0, 0, 1};
  expect_triangulated({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {0, 2, 0}}, up);
  expect_triangulated({{0, 0, 0}, {2, 0, 0}, {2, 1, 0}, {1, 1, 0}, {1, 2, 0}, {0, 2, 0}}, up);
  expect_triangulated({{0, 0, 0}, {4, 0, 0}, {4, 2, 0}, {3, 1, 0}, {2, 2, 0}, {1, 1, 0}, {0, 2, 0}},
                      up);
  // A square with a square hole, joined by a bridge that runs there and back.
  expect_triangulated({{0, 0, 0},
                       {4, 0, 0},
                       {4, 4, 0},
                       {0, 4, 0},
                       {0, 0, 0},
                       {1, 1, 0},
                       {1, 3, 0},
                       {3, 3, 0},
                       {3, 1, 0},
                       {1, 1, 0}},
                      up);
}

// A band folded to and fro: its convex corners are many, and all but a few have a corner in the
// way.
TEST(PolygonTriangulation, CutsTenThousandCornersWithFewEarsInSeconds) {
  std::vector<Point> band;
  constexpr int kHalf = kMaxPolygonCorners / 2;
  for (int i = 0; i < kHalf; ++i) band.push_back({double(i), i % 2 == 0 ? 0.0 : 10.0, 0});
  for (int i = kHalf - 1; i >= 0; --i) band.push_back({double(i), i % 2 == 0 ? 0.5 : 10.5, 0});
  const auto started = std::clock();  // counts no time of other processes
  expect_triangulated(band, {0, 0, 1});
  // Less than a second; minutes if every search for an ear begins anew.
  EXPECT_LT(static_cast<double>(std::clock() - started) / CLOCKS_PER_SEC, 20);
}

TEST(PolygonTriangulation, CutsStarsInAnyPlane) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (int round = 0; round < 300; ++round) {
    Point u{uniform(random), uniform(random), uniform(random)};
    Point v{uniform(random), uniform(random), uniform(random)};
    const Point normal = cross(u, v);
    if (norm(normal) < 0.05) continue;
    const std::size_t n = 3 + random() % 60;
    std::vector<Point> star;
    for (std::size_t i = 0; i < n; ++i) {
      const double angle = 6.283185307179586 * static_cast<double>(i) / static_cast<double>(n);
      const double radius = 1.2 + uniform(random);
      star.push_back(radius * std::cos(angle) * u + radius * std::sin(angle) * v);
    }
    expect_triangulated(star, normal);
  }
}

TEST(PolygonTriangulation, LargeCombTakesNoTime) {
  std::vector<Point> comb{{0, -1, 0}};
  for (std::size_t i = 0; comb.size() < kMaxPolygonCorners; ++i)
    comb.push_back({5000.0 - 0.5 * static_cast<double>(i), i % 2 ? 100.0 : 1.0, 0});
  std::vector<Point> turned(comb.rbegin(), comb.rend());
  Triangles triangles;
  EXPECT_TRUE(triangulate_polygon(turned, triangles));
  EXPECT_EQ(triangles.size(), kMaxPolygonCorners - 2);
}

TEST(PolygonTriangulation, RefusesToCutWhatCrossesItself) {
  Triangles triangles;
  const std::vector<Point> bow{{0, 0, 0}, {1, 1, 0}, {1, 0, 0}, {0, 1, 0}};
  EXPECT_FALSE(triangulate_polygon(bow, triangles));
  const std::vector<Point> collinear{{0, 0, 0}, {1, 1, 1}, {2, 2, 2}, {3, 3, 3}};
  EXPECT_TRUE(triangulate_polygon(collinear, triangles));
  EXPECT_EQ(triangles.size(), 2u);
}

}  // namespace
}  // namespace locvol
