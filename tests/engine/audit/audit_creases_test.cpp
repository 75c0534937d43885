// The audit of creases, on blocks of unit cubes and thin plates made by hand.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "tests/engine/audit/audit_of.h"
#include "tests/engine/described.h"

namespace locvol {
namespace {

// A crease in so many edges of the surface. Points of the mesh on it are points on a crease.
void add_crease(HandMadeMesh& mesh, const Point& from, const Point& to, int num_edges,
                bool has_corners = true) {
  const auto at = [&](int k) { return from + (double(k) / num_edges) * (to - from); };
  for (int k = 0; k < num_edges; ++k) {
    CreaseEdge edge{.ends = {at(k), at(k + 1)},
                    .is_corner = {has_corners && k == 0, has_corners && k + 1 == num_edges}};
    if (edge.ends[1] < edge.ends[0]) {
      std::swap(edge.ends[0], edge.ends[1]);
      std::swap(edge.is_corner[0], edge.is_corner[1]);
    }
    mesh.creases.push_back(edge);
  }
  std::ranges::sort(mesh.creases, {}, &CreaseEdge::ends);
  const double length = norm(to - from);
  for (MeshPoint& p : mesh.points)
    if (norm(p.position - from) + norm(to - p.position) < (1 + 1e-12) * length)
      p.kind = PointKind::kCrease;
}

// The twelve edges of the box between the origin and `to`, along x, y and z in so many edges of the
// surface; and their corners.
void add_edges_of_box(HandMadeMesh& mesh, const Point& to, const std::array<int, 3>& num_edges) {
  for (int axis = 0; axis < 3; ++axis)
    for (int k = 0; k < 4; ++k) {
      Point a;
      a[(axis + 1) % 3] = k & 1 ? to[(axis + 1) % 3] : 0;
      a[(axis + 2) % 3] = k & 2 ? to[(axis + 2) % 3] : 0;
      Point b = a;
      b[axis] = to[axis];
      add_crease(mesh, a, b, num_edges[std::size_t(axis)]);
    }
  for (std::uint32_t k = 0; k < 8; ++k)
    mesh.crease_corners.push_back({{k & 1 ? to.x : 0, k & 2 ? to.y : 0, k & 4 ? to.z : 0}, k + 1});
}

// Of 27 unit cubes; all of its edges are creases. Their ends are no points of the mesh, or some
// are, or some edges have points inside.
HandMadeMesh block(const std::array<int, 3>& num_edges = {1, 3, 7}) {
  HandMadeMesh mesh = cubes(3, [](int, int, int) { return true; });
  add_edges_of_box(mesh, {3, 3, 3}, num_edges);
  return mesh;
}

MeshPoint& point_at(HandMadeMesh& mesh, const Point& p) {
  return *std::ranges::find(mesh.points, p, &MeshPoint::position);
}

std::uint64_t erase_cells(HandMadeMesh& mesh, const std::vector<Point>& with) {
  return std::erase_if(mesh.cells, [&](const CellIds& cell) {
    return std::ranges::all_of(
        with, [&](const Point& p) { return std::ranges::count(cell, point_at(mesh, p).id) > 0; });
  });
}

TEST(AuditCreases, AreKept) {
  for (const auto& num_edges : {std::array{1, 1, 1}, {3, 3, 3}, {1, 3, 7}, {40, 5, 2}})
    for (const LinearOctree& octree : octrees()) {
      SCOPED_TRACE(octree.size());
      const AuditReport report = audit_of(block(num_edges), octree);
      EXPECT_TRUE(report.is_valid()) << described(report);
      EXPECT_NEAR(report.crease_length, 36, 1e-12);
      EXPECT_EQ(report.lost_crease_length, 0);
      EXPECT_EQ(report.num_open, 0U);
    }
}

TEST(AuditCreases, ComeBackToWhereTheyBegin) {
  HandMadeMesh mesh = block();
  const std::array<Point, 4> loop{{{1, 1, 3}, {2, 1, 3}, {2, 2, 3}, {1, 2, 3}}};
  for (std::size_t k = 0; k < 4; ++k) add_crease(mesh, loop[k], loop[(k + 1) % 4], 3, false);
  for (const LinearOctree& octree : octrees()) {
    const AuditReport report = audit_of(mesh, octree);
    EXPECT_TRUE(report.is_valid()) << described(report);
    EXPECT_NEAR(report.crease_length, 40, 1e-12);
  }
  // With two points left it goes from one to the other, twice; with less, to nowhere.
  double lost = 0;
  for (const Point& p : loop) {
    point_at(mesh, p).kind = PointKind::kSurface;
    const AuditReport report = audit_of(mesh);
    EXPECT_NEAR(report.crease_length, 40, 1e-12);
    EXPECT_GE(report.lost_crease_length, std::max(2.0, lost));
    lost = report.lost_crease_length;
  }
  EXPECT_NEAR(lost, 4, 1e-12);
}

TEST(AuditCreases, AreAskedForWhereTheRunKeepsThem) {
  HandMadeMesh mesh = block();
  for (MeshPoint& p : mesh.points) p.kind = PointKind::kSurface;
  HandMadeStore store(mesh, mixed_octree());
  EXPECT_FALSE(audit_of(store).is_valid());
  store.init = Initialization::kPaper;
  const AuditReport report = audit_of(store);
  EXPECT_TRUE(report.is_valid()) << described(report);
  EXPECT_EQ(report.crease_length, 0);
}

TEST(AuditCreases, AreLostWhereThereIsNoEdge) {
  for (const auto& [a, b] : {std::pair(Point{1, 0, 0}, Point{2, 0, 0}),
                             {{0, 3, 0}, {0, 3, 1}},
                             {{3, 2, 3}, {3, 3, 3}}}) {
    HandMadeMesh mesh = block();
    EXPECT_GT(erase_cells(mesh, {a, b}), 0U);
    for (const LinearOctree& octree : octrees()) {
      SCOPED_TRACE(octree.size());
      const AuditReport report = audit_of(mesh, octree);
      EXPECT_EQ(report.num_lost_creases, 1U) << described(report);
      EXPECT_EQ(report.num_lost_corners, 0U) << described(report);
      EXPECT_NEAR(report.lost_crease_length, 1, 1e-12);
      EXPECT_NEAR(report.crease_length, 36, 1e-12);
      EXPECT_FALSE(report.is_valid());
    }
  }
}

// Where a point is missing, or is none of the crease, it goes on to the next, too far away.
TEST(AuditCreases, AreLostBetweenPointsTooFarApart) {
  HandMadeMesh mesh = block({7, 7, 7});
  for (const double x : {1.0, 2.0}) {
    point_at(mesh, {x, 0, 3}).kind = PointKind::kSurface;
    for (const LinearOctree& octree : octrees()) {
      SCOPED_TRACE(octree.size());
      const AuditReport report = audit_of(mesh, octree);
      EXPECT_EQ(report.num_violations(), report.num_lost_creases) << described(report);
      EXPECT_GE(report.num_lost_creases, 1U);
      EXPECT_NEAR(report.lost_crease_length, x + 1, 1e-12);
      EXPECT_NEAR(report.crease_length, 36, 1e-12);
    }
  }
}

// Long or short, in leaves with points or without.
TEST(AuditCreases, AreLostWhereThereAreNoPoints) {
  for (const auto& [a, b] : {std::pair(Point{0.5, 1.5, 3}, Point{2.5, 1.5, 3}),
                             {{1.4, 1.4, 0}, {1.6, 1.4, 0}},
                             {{3, 0.2, 0.3}, {3, 2.8, 2.6}},
                             {{4.1, 4.1, 4.1}, {5.9, 5.9, 5.9}}})
    for (const int num_edges : {1, 4})
      for (const LinearOctree& octree : octrees()) {
        SCOPED_TRACE(octree.size());
        HandMadeMesh mesh = block();
        add_crease(mesh, a, b, num_edges, false);
        const AuditReport report = audit_of(mesh, octree);
        EXPECT_EQ(report.num_violations(), report.num_lost_creases) << described(report);
        EXPECT_GE(report.num_lost_creases, 1U);
        EXPECT_NEAR(report.lost_crease_length, norm(b - a), 1e-12);
        EXPECT_NEAR(report.crease_length, 36 + norm(b - a), 1e-12);
      }
}

TEST(AuditCreases, AreOpenNearUnresolvedSites) {
  HandMadeMesh mesh = block();
  point_at(mesh, {3, 1, 3}).kind = PointKind::kSurface;
  HandMadeStore store(mesh, LinearOctree::uniform(0));
  store.leaves.begin()->second.unresolved.sites = {{3, {3, 1, 2}, 0.5}};
  const AuditReport report = audit_of(store);
  EXPECT_TRUE(report.is_valid()) << described(report);
  EXPECT_EQ(report.num_open, 1U);
  EXPECT_NEAR(report.lost_crease_length, 2, 1e-12);
}

// A little off the edge by rounding, a point is on it; by more it is not.
TEST(AuditCreases, HaveRoundedPoints) {
  for (const double off : {0.0, 1e-15, 1e-7, 1e-5}) {
    HandMadeMesh mesh = block({1, 1, 1});
    mesh.creases.clear();
    add_crease(mesh, {off, 0, 0}, {off, 0, 3}, 1, false);
    const AuditReport report = audit_of(mesh);
    EXPECT_EQ(report.num_lost_creases > 0, off > 1e-6) << described(report);
  }
}

TEST(AuditCorners, AreLostWhereThereIsNoPoint) {
  for (const LinearOctree& octree : octrees()) {
    HandMadeMesh mesh = block();
    mesh.crease_corners.push_back({{1.5, 1.25, 3}, 9});
    mesh.crease_corners.push_back({{5, 5, 5}, 10});
    const AuditReport report = audit_of(mesh, octree);
    EXPECT_EQ(report.num_lost_corners, 2U) << described(report);
    EXPECT_EQ(report.num_violations(), 2U) << described(report);
    EXPECT_EQ(report.lost_crease_length, 0);
  }
}

TEST(AuditCorners, AreLostWhereNoCellHasThem) {
  HandMadeMesh mesh = block();
  erase_cells(mesh, {{3, 0, 0}});
  for (const LinearOctree& octree : octrees()) {
    SCOPED_TRACE(octree.size());
    const AuditReport report = audit_of(mesh, octree);
    EXPECT_EQ(report.num_lost_corners, 1U) << described(report);
    EXPECT_EQ(report.num_lost_creases, 3U) << described(report);
    EXPECT_NEAR(report.lost_crease_length, 3, 1e-12);
  }
}

// A plate of three by three bricks, a fifth as high as they are wide. All cells are badly shaped,
// and have one upright edge, which is the shortest.
class AuditSheets : public testing::Test {
 protected:
  static constexpr double kHeight = 0.2;

  AuditSheets() : mesh_(cubes(3, [](int, int, int z) { return z == 0; })) {
    for (MeshPoint& p : mesh_.points) p = {p.id, flat(p.position), PointKind::kSurface};
    for (Triangle& t : mesh_.surface) {
      for (Point& corner : t.corners) corner = flat(corner);
      turn_outwards(t);
      t.sheet = sheet_of(t.corners);
    }
    add_edges_of_box(mesh_, {3, 3, kHeight}, {2, 2, 1});
  }

  static void turn_outwards(Triangle& t) {
    auto& [a, b, c] = t.corners;
    if (dot(cross(b - a, c - a), a - Point{1.5, 1.5, 0.5 * kHeight}) < 0) std::swap(b, c);
  }
  static Point flat(const Point& p) { return {p.x, p.y, kHeight * p.z}; }
  // Of the side of the box that it lies on.
  static SheetId sheet_of(const std::array<Point, 3>& corners) {
    for (const int axis : {0, 1, 2})
      for (const double at : {0.0, axis == 2 ? kHeight : 3})
        if (std::ranges::all_of(corners, [&](const Point& p) { return p[axis] == at; }))
          return static_cast<SheetId>(2 * axis + (at > 0) + 1);
    return 0;
  }

  // Where do the ends of the upright edge lie, as seen from above?
  std::uint64_t num_cells_with_upright(const std::function<bool(double x, double y)>& is_at) const {
    return static_cast<std::uint64_t>(std::ranges::count_if(mesh_.cells, [&](const CellIds& cell) {
      const auto p = mesh_.corners(cell);
      for (std::size_t i = 0; i < 4; ++i)
        for (std::size_t j = i + 1; j < 4; ++j)
          if (p[i].x == p[j].x && p[i].y == p[j].y) return is_at(p[i].x, p[i].y);
      return false;
    }));
  }

  AuditReport report(const LinearOctree& octree) const {
    HandMadeStore store(mesh_, octree);
    store.sheets.sheets.resize(6);
    store.sheet_of = sheet_of;
    return audit_of(store);
  }

  void expect_badly_shaped(std::uint64_t expected) const {
    for (const LinearOctree& octree : octrees()) {
      SCOPED_TRACE(octree.size());
      const AuditReport report = this->report(octree);
      EXPECT_EQ(report.num_badly_shaped_cells, expected) << described(report);
      EXPECT_EQ(report.num_violations(), expected) << described(report);
      EXPECT_NEAR(report.max_radius_edge_ratio, 0.5 * std::sqrt(2.04) / kHeight, 1e-9);
    }
  }

  HandMadeMesh mesh_;
};

bool is_on_rim(double x) { return x == 0 || x == 3; }

// Upright edges lead from the lower sheet to the upper one; at the rim, where the sides of the
// plate have both of their ends, from crease to crease; but at the corners of the plate, along a
// crease.
TEST_F(AuditSheets, LeaveCellsBetweenThemAsTheyAre) {
  const std::uint64_t num_at_corners =
      num_cells_with_upright([](double x, double y) { return is_on_rim(x) && is_on_rim(y); });
  EXPECT_GT(num_at_corners, 0U);
  EXPECT_LT(num_at_corners, mesh_.cells.size());
  expect_badly_shaped(num_at_corners);
}

TEST_F(AuditSheets, AskForTheShapeOfCellsWithinOne) {
  for (MeshPoint& p : mesh_.points)
    if (p.kind == PointKind::kCrease && p.position.x == 0 && !is_on_rim(p.position.y))
      p.kind = PointKind::kSurface;
  mesh_.creases = {};  // the points have no crease, and follow none
  const std::uint64_t num_within =
      num_cells_with_upright([](double x, double y) { return x == 0 && !is_on_rim(y); });
  EXPECT_GT(num_within, 0U);
  expect_badly_shaped(num_within);
}

// Its upper side and its lower one face each other.
TEST_F(AuditSheets, LeaveCellsAcrossAThinPartOfOneAsTheyAre) {
  for (Triangle& t : mesh_.surface) t.sheet = 1;
  for (MeshPoint& p : mesh_.points) p.kind = PointKind::kSurface;
  mesh_.creases = {};
  HandMadeStore store(mesh_, mixed_octree());
  EXPECT_EQ(audit_of(store).num_badly_shaped_cells, 0U);
}

TEST_F(AuditSheets, AskForTheShapeOfAllCellsInARunWithoutCreases) {
  mesh_.creases = {};
  mesh_.crease_corners = {};
  expect_badly_shaped(mesh_.cells.size());
}

// Points inside the mesh lie on no sheet.
TEST_F(AuditSheets, AskForTheShapeOfCellsAtPointsInside) {
  for (MeshPoint& p : mesh_.points)
    if (p.position == Point{1, 1, 0}) p.kind = PointKind::kVolume;
  const std::uint64_t expected = num_cells_with_upright(
      [](double x, double y) { return (is_on_rim(x) && is_on_rim(y)) || (x == 1 && y == 1); });
  expect_badly_shaped(expected);
}

}  // namespace
}  // namespace locvol
