// Delaunay against CGAL's triangulation, which breaks ties in the same way: the same cells from the
// same points, however they came about.
#include "refine/delaunay.h"

#include <CGAL/Delaunay_triangulation_3.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numeric>
#include <ostream>
#include <span>
#include <string>
#include <vector>

#include "refine/cell_shape.h"
#include "refine/vertex_move.h"
#include "tests/refine/brute_force.h"
#include "tests/refine/shapes.h"

namespace locvol {
namespace {

using shapes::Random;
using shapes::uniform;
using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Reference = CGAL::Delaunay_triangulation_3<Kernel>;
using CellPoints = std::array<Point, 4>;  // sorted

Kernel::Point_3 cgal(const Point& p) { return {p.x, p.y, p.z}; }

std::vector<CellPoints> reference_cells(const std::vector<Point>& points) {
  Reference reference;
  for (const Point& p : points) reference.insert(cgal(p));
  std::vector<CellPoints> cells;
  for (const auto c : reference.finite_cell_handles()) {
    CellPoints cell;
    for (int i = 0; i < 4; ++i) {
      const auto& p = c->vertex(i)->point();
      cell[std::size_t(i)] = {p.x(), p.y(), p.z()};
    }
    std::ranges::sort(cell);
    cells.push_back(cell);
  }
  std::ranges::sort(cells);
  return cells;
}

std::vector<CellPoints> finite_cells(const Delaunay& delaunay) {
  std::vector<CellPoints> cells;
  for (Delaunay::Cell c = 0; c < delaunay.cell_bound(); ++c) {
    if (!delaunay.is_cell(c) || delaunay.is_infinite(c)) continue;
    CellPoints cell;
    for (int i = 0; i < 4; ++i) cell[std::size_t(i)] = delaunay.point(delaunay.vertex(c, i));
    std::ranges::sort(cell);
    cells.push_back(cell);
  }
  std::ranges::sort(cells);
  return cells;
}

// Orientation, neighbors, and a cell of each vertex.
void expect_sound(const Delaunay& delaunay) {
  for (Delaunay::Cell c = 0; c < delaunay.cell_bound(); ++c) {
    if (!delaunay.is_cell(c)) continue;
    const auto& v = delaunay.vertices(c);
    for (int i = 0; i < 3; ++i) ASSERT_NE(v[std::size_t(i)], Delaunay::kInfinite);
    if (!delaunay.is_infinite(c)) {
      ASSERT_EQ(brute_force::orientation(delaunay.point(v[0]), delaunay.point(v[1]),
                                         delaunay.point(v[2]), delaunay.point(v[3])),
                1);
    }
    for (int i = 0; i < 4; ++i) {
      const Delaunay::Cell next = delaunay.neighbor(c, i);
      ASSERT_TRUE(delaunay.is_cell(next));
      const int back = delaunay.index_of_neighbor(next, c);
      ASSERT_EQ(delaunay.neighbor(next, back), c);
      for (int k = 0; k < 4; ++k)
        ASSERT_TRUE(k == i || std::ranges::count(delaunay.vertices(next), v[std::size_t(k)]) == 1);
      ASSERT_NE(delaunay.vertex(next, back), v[std::size_t(i)]);
    }
  }
  for (Delaunay::Vertex v = 0; v < delaunay.num_vertices(); ++v) {
    const Delaunay::Cell c = delaunay.cell_of(v);
    if (c == Delaunay::kNone) continue;
    ASSERT_TRUE(delaunay.is_cell(c));
    ASSERT_EQ(delaunay.vertex(c, delaunay.index_of(c, v)), v);
  }
}

struct Cloud {
  std::string name;
  std::function<std::vector<Point>(Random&)> points;
  friend std::ostream& operator<<(std::ostream& out, const Cloud& c) { return out << c.name; }
};

std::vector<Point> random_points(Random& random, std::size_t num) {
  std::vector<Point> points;
  for (std::size_t n = 0; n < num; ++n)
    points.push_back({uniform(random, -1, 1), uniform(random, -1, 1), uniform(random, -1, 1)});
  return points;
}

std::vector<Point> cubic_grid(Random& random, double step) {
  std::vector<Point> points;
  for (int i = 0; i < 6; ++i)
    for (int j = 0; j < 6; ++j)
      for (int k = 0; k < 6; ++k) points.push_back(step * Point{double(i), double(j), double(k)});
  std::ranges::shuffle(points, random);
  return points;
}

std::vector<Point> bcc(Random& random, double half) {
  std::vector<Point> points;
  for (int i = 0; i < 9; ++i)
    for (int j = i % 2; j < 9; j += 2)
      for (int k = i % 2; k < 9; k += 2)
        points.push_back(half * Point{double(i), double(j), double(k)});
  std::ranges::shuffle(points, random);
  return points;
}

std::vector<Point> on_a_sphere(Random& random) {
  std::vector<Point> points = random_points(random, 300);
  for (Point& p : points) p = (1 / norm(p)) * p;
  return points;
}

// Many in one plane, and on its circles.
std::vector<Point> on_a_box(Random& random) {
  std::vector<Point> points;
  for (int i = 0; i <= 8; ++i)
    for (int j = 0; j <= 8; ++j)
      for (const double z : {0.0, 1.0}) points.push_back({i / 8.0, j / 8.0, z});
  for (int n = 0; n < 60; ++n)
    points.push_back({uniform(random, 0, 1), 0, uniform(random, 0.1, 0.9)});
  std::ranges::shuffle(points, random);
  return points;
}

// Two plane sheets at an angle to the axes, but for rounding; and on request far points around,
// which make long cells on sheets that are flat cells else.
std::vector<Point> tilted_sheets(Random& random, bool has_fence) {
  std::vector<Point> points;
  for (int n = 0; n < 400; ++n) {
    const double x = uniform(random, -1, 1), y = uniform(random, -1, 1);
    points.push_back(Point{5, -3, 2} + x * Point{0.8, 0.6, 0} + y * Point{-0.36, 0.48, 0.8} +
                     (n % 2 == 0 ? 0 : 0.05) * Point{0.48, -0.64, 0.6});
  }
  if (has_fence)
    for (int k = 0; k < 8; ++k)
      points.push_back({k & 1 ? 31.0 : -19, k & 2 ? 17.0 : -25, k & 4 ? 29.0 : -21});
  return points;
}

// Boxes that are long along one axis, side by side, with corners that rounding moved: nearly
// cospherical, eight at a time.
std::vector<Point> long_boxes(Random& random, int axis, double aspect) {
  std::vector<Point> points;
  for (int i = 0; i < 6; ++i)
    for (int j = 0; j < 6; ++j)
      for (int k = 0; k < 6; ++k) {
        std::array<double, 3> x{double(i), double(j), double(k)};
        x[std::size_t(axis)] *= aspect;
        for (double& c : x) c = (c + 1) * (1 + uniform(random, -1e-15, 1e-15));
        points.push_back({x[0], x[1], x[2]});
      }
  std::ranges::shuffle(points, random);
  return points;
}

// One vertex with hundreds of neighbors.
std::vector<Point> around_a_center(Random& random) {
  std::vector<Point> points = on_a_sphere(random);
  points.push_back({0.01, 0.02, -0.01});
  return points;
}

std::vector<Point> scaled(std::vector<Point> points, double factor) {
  for (Point& p : points) p = factor * p;
  return points;
}

const Cloud kClouds[] = {
    {"Random", [](Random& r) { return random_points(r, 600); }},
    {"CubicGrid", [](Random& r) { return cubic_grid(r, 0.125); }},
    {"Bcc", [](Random& r) { return bcc(r, 5 * 0x1p-10); }},
    {"BccNotOfSteps", [](Random& r) { return bcc(r, 0.1); }},
    {"Sphere", on_a_sphere},
    {"Box", on_a_box},
    {"AroundACenter", around_a_center},
    {"Tiny", [](Random& r) { return scaled(random_points(r, 100), 1e-55); }},
    {"Huge", [](Random& r) { return scaled(cubic_grid(r, 1), 1e57); }},
    {"TiltedSheets", [](Random& r) { return tilted_sheets(r, false); }},
    {"TiltedSheetsInAFence", [](Random& r) { return tilted_sheets(r, true); }},
    {"LongX", [](Random& r) { return long_boxes(r, 0, 40); }},
    {"LongY", [](Random& r) { return long_boxes(r, 1, 40); }},
    {"LongZ", [](Random& r) { return long_boxes(r, 2, 40); }},
    {"VeryLongX", [](Random& r) { return long_boxes(r, 0, 1e4); }},
};

class DelaunayOf : public testing::TestWithParam<Cloud> {
 protected:
  static constexpr unsigned kSeed = 71;
  Random random_{kSeed};
  std::vector<Point> points_ = GetParam().points(random_);
};

INSTANTIATE_TEST_SUITE_P(Clouds, DelaunayOf, testing::ValuesIn(kClouds),
                         [](const auto& cloud) { return cloud.param.name; });

// No ball of a cell has the vertex across one of its facets in it: then none has any vertex in it
// (Delaunay's lemma). Exact.
void expect_empty_balls(const Delaunay& delaunay) {
  for (Delaunay::Cell c = 0; c < delaunay.cell_bound(); ++c) {
    if (!delaunay.is_cell(c) || delaunay.is_infinite(c)) continue;
    std::array<Point, 4> corners;
    for (int i = 0; i < 4; ++i) corners[std::size_t(i)] = delaunay.point(delaunay.vertex(c, i));
    for (int i = 0; i < 4; ++i) {
      const Delaunay::Cell next = delaunay.neighbor(c, i);
      const auto across = delaunay.vertex(next, delaunay.index_of_neighbor(next, c));
      if (across != Delaunay::kInfinite) {
        ASSERT_LE(brute_force::side_of_sphere(corners, delaunay.point(across)), 0);
      }
    }
  }
}

void insert(Delaunay& delaunay, const Point& p, Delaunay::Cell hint) {
  Delaunay::Conflict conflict;
  delaunay.find_conflict(p, hint, conflict);
  ASSERT_EQ(conflict.coincident, Delaunay::kNone);
  delaunay.insert(p, conflict);
}

TEST_P(DelaunayOf, BuiltAtOnceIsThatOfCgal) {
  Delaunay delaunay;
  ASSERT_TRUE(delaunay.build(points_));
  expect_sound(delaunay);
  expect_empty_balls(delaunay);
  EXPECT_EQ(finite_cells(delaunay), reference_cells(points_));
}

TEST_P(DelaunayOf, BuiltPointByPointIsThatOfCgal) {
  Delaunay delaunay;
  const std::size_t half = points_.size() / 2;
  ASSERT_TRUE(delaunay.build({points_.data(), half}));
  for (std::size_t n = half; n < points_.size(); ++n)
    insert(delaunay, points_[n], delaunay.newest_cell());
  expect_sound(delaunay);
  expect_empty_balls(delaunay);
  EXPECT_EQ(finite_cells(delaunay), reference_cells(points_));
}

TEST_P(DelaunayOf, WithoutRemovedPointsIsThatOfCgal) {
  Delaunay delaunay;
  ASSERT_TRUE(delaunay.build(points_));
  std::vector<Point> left = points_;
  for (Delaunay::Vertex v = 0; v < points_.size(); v += 3) {
    delaunay.remove({&v, 1});
    std::erase(left, points_[v]);
  }
  expect_sound(delaunay);
  EXPECT_EQ(finite_cells(delaunay), reference_cells(left));
  for (Delaunay::Vertex v = 0; v < points_.size(); v += 3)
    insert(delaunay, points_[v], delaunay.newest_cell());
  expect_sound(delaunay);
  EXPECT_EQ(finite_cells(delaunay), reference_cells(points_));
}

// The nearest ones to a place and some that are all over, or nearly all of them.
TEST_P(DelaunayOf, WithoutPointsRemovedAtOnceIsThatOfCgal) {
  Delaunay delaunay;
  ASSERT_TRUE(delaunay.build(points_));
  std::vector<Delaunay::Vertex> vertices(points_.size());
  std::iota(vertices.begin(), vertices.end(), 0u);
  const std::size_t most = points_.size() - 12;
  for (const std::size_t num_near : {std::size_t{2}, std::size_t{5}, most / 8, most, most / 2}) {
    const Point center = points_[random_() % points_.size()];
    std::ranges::shuffle(vertices, random_);
    const std::size_t num_leaving = std::min(num_near + random_() % 10, most);
    const std::span may_leave = std::span(vertices).first(most);
    std::ranges::partial_sort(may_leave, may_leave.begin() + std::ptrdiff_t(num_near), {},
                              [&](auto v) { return squared_distance(delaunay.point(v), center); });
    const std::span leaving(vertices.data(), num_leaving);
    delaunay.remove(leaving);
    std::vector<Point> left;
    for (const auto v : std::span(vertices).subspan(num_leaving)) left.push_back(delaunay.point(v));
    SCOPED_TRACE(num_leaving);
    ASSERT_TRUE(delaunay.has_cells());
    expect_sound(delaunay);
    ASSERT_EQ(finite_cells(delaunay), reference_cells(left));
    for (Delaunay::Vertex& v : leaving) {
      insert(delaunay, delaunay.point(v), delaunay.newest_cell());
      v = static_cast<Delaunay::Vertex>(delaunay.num_vertices() - 1);
    }
  }
  expect_sound(delaunay);
  EXPECT_EQ(finite_cells(delaunay), reference_cells(points_));
}

// A bound just above the largest cosine at the vertex finds the same change, one below it none.
void expect_bound(const Delaunay& delaunay, VertexMove& move, const Delaunay::Change& change) {
  double largest = -1;
  for (const Delaunay::NewCell& cell : change.made) {
    if (cell.vertex[3] != change.vertex) continue;
    const auto& [a, b, c, d] = cell.vertex;
    largest = std::max(largest, largest_cosine({delaunay.point(a), delaunay.point(b),
                                                delaunay.point(c), change.place}));
  }
  if (!(largest < 0.999)) return;  // flat cells, which rounding would decide
  Delaunay::Change bounded;
  EXPECT_FALSE(move.find(change.place, {.cosine = largest - 1e-9}, bounded));
  ASSERT_TRUE(move.find(change.place, {.cosine = largest + 1e-9}, bounded));
  EXPECT_EQ(bounded.gone, change.gone);
  EXPECT_EQ(bounded.made.size(), change.made.size());
}

// To places near and far, some of them to where another vertex was (in grids: ties everywhere).
TEST_P(DelaunayOf, WithMovedPointsIsThatOfCgal) {
  Delaunay delaunay;
  ASSERT_TRUE(delaunay.build(points_));
  VertexMove move(delaunay);
  Delaunay::Change change;
  std::vector<Delaunay::Cell> around;
  std::size_t num_inside = 0, num_moves = 0;
  for (Delaunay::Vertex v = 0; v < points_.size(); v += 2) {
    if (!move.take_out(v)) continue;
    ++num_inside;
    delaunay.cells_around(v, around);
    double longest = 0;
    Point away;
    for (const auto w : delaunay.vertices(around[random_() % around.size()]))
      if (const Point way = delaunay.point(w) - points_[v]; norm(way) > longest)
        longest = norm(way), away = way;
    for (const double step : {1e-9, 0.05, 0.3, 0.5, 1.5}) {
      const Point shift{uniform(random_, -1, 1), uniform(random_, -1, 1), uniform(random_, -1, 1)};
      const Point q = step == 0.5 ? points_[v] + 0.5 * away : points_[v] + (step * longest) * shift;
      Delaunay::Conflict conflict;
      delaunay.find_conflict(q, around[0], conflict);
      const bool is_found = move.find(q, {}, change);
      EXPECT_FALSE(is_found && conflict.coincident != Delaunay::kNone);
      if (!is_found) continue;
      expect_bound(delaunay, move, change);
      delaunay.move(change);
      points_[v] = q;
      ++num_moves;
      break;
    }
  }
  expect_sound(delaunay);
  EXPECT_EQ(finite_cells(delaunay), reference_cells(points_));
  EXPECT_GE(num_moves, num_inside * 9 / 10);
}

TEST_P(DelaunayOf, WithPointsPutInIsThatOfCgal) {
  Delaunay delaunay;
  ASSERT_TRUE(delaunay.build(std::span(points_).first(points_.size() / 2)));
  VertexMove move(delaunay);
  Delaunay::Change change;
  Delaunay::Conflict conflict;
  for (std::size_t n = points_.size() / 2; n < points_.size(); ++n) {
    delaunay.find_conflict(points_[n], delaunay.newest_cell(), conflict);
    move.put_in_new();
    const Delaunay::Cell start = conflict.cells[0];
    for (const Delaunay::Vertex v : delaunay.vertices(start)) {  // no place for another
      if (v == Delaunay::kInfinite) continue;
      EXPECT_FALSE(move.find_insertion(delaunay.point(v), start, {}, change));
    }
    for (const auto& facet : conflict.border)
      EXPECT_FALSE(move.find_insertion(points_[n], facet.cell, {}, change));
    if (move.find_insertion(points_[n], start, {}, change)) {
      std::ranges::sort(conflict.cells);
      std::ranges::sort(change.gone);
      ASSERT_EQ(change.gone, conflict.cells);
      ASSERT_EQ(change.made.size(), conflict.border.size());
    }
    delaunay.insert(points_[n], conflict);
  }
}

TEST_P(DelaunayOf, FindsCoincidentPoints) {
  Delaunay delaunay;
  ASSERT_TRUE(delaunay.build(points_));
  for (Delaunay::Vertex v = 0; v < points_.size(); ++v) {
    Delaunay::Conflict conflict;
    delaunay.find_conflict(points_[v], delaunay.newest_cell(), conflict);
    ASSERT_EQ(conflict.coincident, v);
  }
  points_.push_back(points_[points_.size() / 2]);
  EXPECT_FALSE(Delaunay().build(points_));
}

TEST_P(DelaunayOf, KnowsWhatIsAroundAVertex) {
  Delaunay delaunay;
  ASSERT_TRUE(delaunay.build(points_));
  std::vector<std::vector<Delaunay::Cell>> cells(points_.size());
  for (Delaunay::Cell c = 0; c < delaunay.cell_bound(); ++c)
    if (delaunay.is_cell(c))
      for (const auto v : delaunay.vertices(c))
        if (v != Delaunay::kInfinite) cells[v].push_back(c);
  std::vector<Delaunay::Cell> around;
  std::vector<Delaunay::Vertex> neighbors;
  for (Delaunay::Vertex v = 0; v < points_.size(); ++v) {
    delaunay.cells_around(v, around);
    std::ranges::sort(around);
    ASSERT_EQ(around, cells[v]);
    delaunay.neighbors_of(v, neighbors);
    std::vector<Delaunay::Vertex> expected;
    for (const auto c : cells[v])
      for (const auto w : delaunay.vertices(c))
        if (w != v && w != Delaunay::kInfinite) expected.push_back(w);
    std::ranges::sort(expected);
    expected.erase(std::ranges::unique(expected).begin(), expected.end());
    ASSERT_EQ(neighbors, expected);
  }
}

// The last point's has 2 n - 4 facets: small ones are filled in one way, large ones in another.
TEST(Delaunay, FillsCavitiesOfAnySize) {
  Random random(73);
  for (std::size_t n = 4; n < 90; ++n) {
    std::vector<Point> points = random_points(random, n);
    for (Point& p : points) p = (1 / norm(p)) * p;
    Delaunay delaunay;
    ASSERT_TRUE(delaunay.build(points));
    points.push_back({0.01, 0.02, -0.01});
    insert(delaunay, points.back(), delaunay.newest_cell());
    expect_sound(delaunay);
    ASSERT_EQ(finite_cells(delaunay), reference_cells(points)) << n;
  }
}

// CGAL 5.5.1's CGAL_USE_SSE2_MAX leaves the x extent out of the error bound of this predicate:
// rounding then counts as a sign, walks go in circles, and cavities are no balls.
TEST(Predicates, AreCertainOfSpheresOfLongCells) {
  Random random(72);
  for (int axis = 0; axis < 3; ++axis)
    for (const double aspect : {1.0, 10.0, 40.0, 1e3, 1e6})
      for (int n = 0; n < 2000; ++n) {
        std::array<Point, 5> corners;  // of a box
        for (int i = 0; i < 5; ++i) {
          constexpr std::array<int, 5> kCorner{0, 1, 2, 4, 7};
          std::array<double, 3> x;
          for (int k = 0; k < 3; ++k)
            x[std::size_t(k)] = (kCorner[std::size_t(i)] >> k & 1) * (k == axis ? aspect : 1.0) +
                                uniform(random, -1e-16, 1e-16);
          corners[std::size_t(i)] = {x[0], x[1], x[2]};
        }
        const auto& [a, b, c, d, e] = corners;
        ASSERT_EQ(CGAL::side_of_oriented_sphere(cgal(a), cgal(b), cgal(c), cgal(d), cgal(e)),
                  brute_force::side_of_sphere({a, b, c, d}, e))
            << "axis " << axis << ", aspect " << aspect;
      }
}

TEST(Delaunay, HasNoCellsUntilThePointsSpanSpace) {
  Delaunay delaunay;
  EXPECT_TRUE(delaunay.build({}));
  for (const Point& p :
       {Point{0, 0, 0}, Point{1, 0, 0}, Point{2, 0, 0}, Point{0, 1, 0}, Point{3, 3, 0}}) {
    EXPECT_TRUE(delaunay.build({&p, 1}));
    EXPECT_FALSE(delaunay.has_cells());
  }
  const Point top{0, 0, 1};
  EXPECT_TRUE(delaunay.build({&top, 1}));
  EXPECT_EQ(finite_cells(delaunay).size(), 3u);
  expect_sound(delaunay);
  EXPECT_FALSE(delaunay.remove(std::array{5u}));
  EXPECT_FALSE(delaunay.has_cells());
}

// Cells that stay have other vertices then.
TEST(Delaunay, GrowsAgainFromAPlane) {
  Random random(74);
  std::vector<Point> points = random_points(random, 40);
  for (Point& p : points) p.z = 0;
  points.push_back({0.1, 0, 0.3});
  points.push_back({0, 0.1, -0.2});
  Delaunay delaunay;
  ASSERT_TRUE(delaunay.build(points));
  EXPECT_TRUE(delaunay.remove(std::array{41u}));
  EXPECT_FALSE(delaunay.remove(std::array{40u}));
  points.resize(40);
  const std::vector<Point> others = random_points(random, 60);
  ASSERT_TRUE(delaunay.build(others));
  points.insert(points.end(), others.begin(), others.end());
  expect_sound(delaunay);
  EXPECT_EQ(finite_cells(delaunay), reference_cells(points));
}

TEST(Delaunay, FindsCoincidentPointsInAPlane) {
  const std::vector<Point> points{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 0, 0}};
  EXPECT_FALSE(Delaunay().build(points));
}

// Equal calls give equal numbers.
// Without the nearest cell of the cavity, its border is still closed, but not a sphere around the
// point: two cells that only share an edge.
TEST(Delaunay, RefusesACavityThatIsNoBall) {
  Random random(73);
  Delaunay delaunay;
  ASSERT_TRUE(delaunay.build(random_points(random, 300)));
  Delaunay::Conflict conflict;
  delaunay.find_conflict({0.1, 0.2, 0.3}, delaunay.newest_cell(), conflict);
  const Delaunay::Vertex v = delaunay.vertex(conflict.cells[0], 0);
  std::vector<Delaunay::Cell> around;
  delaunay.cells_around(v, around);
  // Two of the cells at a vertex that share no other one.
  const auto shares_one = [&](Delaunay::Cell c) {
    const auto& of_first = delaunay.vertices(around[0]);
    return std::ranges::count_if(delaunay.vertices(c),
                                 [&](auto w) { return std::ranges::count(of_first, w) > 0; }) == 1;
  };
  const auto other = std::ranges::find_if(around, shares_one);
  ASSERT_NE(other, around.end());
  Delaunay::Conflict pinched;
  for (const Delaunay::Cell c : {around[0], *other}) {
    pinched.cells.push_back(c);
    for (int i = 0; i < 4; ++i) {
      const Delaunay::Cell next = delaunay.neighbor(c, i);
      pinched.border.push_back({next, delaunay.index_of_neighbor(next, c)});
    }
  }
  EXPECT_THROW(delaunay.insert({0.1, 0.2, 0.3}, pinched), DelaunayError);
}

TEST(Delaunay, NumbersAreAFunctionOfTheCalls) {
  Random random(72);
  const auto points = random_points(random, 400);
  const auto make = [&](Delaunay& delaunay) {
    ASSERT_TRUE(delaunay.build({points.data(), 300}));
    for (std::size_t n = 300; n < 400; ++n) insert(delaunay, points[n], delaunay.newest_cell());
    for (Delaunay::Vertex v = 0; v < 400; v += 7) delaunay.remove({&v, 1});
    std::vector<Delaunay::Vertex> more;
    for (Delaunay::Vertex v = 1; v < 400; v += 7) more.push_back(v);
    delaunay.remove(more);
  };
  Delaunay a, b;
  make(a);
  make(b);
  ASSERT_EQ(a.cell_bound(), b.cell_bound());
  for (Delaunay::Cell c = 0; c < a.cell_bound(); ++c) ASSERT_EQ(a.vertices(c), b.vertices(c));
}

}  // namespace
}  // namespace locvol
