// Triangles that are cut along others: alone, they agree with each other.
#include "refine/domain/cut_triangle.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <random>
#include <set>
#include <vector>

namespace locvol {
namespace {

using Corners = std::array<Point, 3>;

Corners sorted(Corners corners) {
  std::ranges::sort(corners);
  return corners;
}

double area_of(const Corners& t) { return 0.5 * norm(cross(t[1] - t[0], t[2] - t[0])); }

std::set<Corners> pieces_of(const Corners& triangle, const std::vector<Corners>& others) {
  std::set<Corners> pieces;
  double area = 0;
  const TrianglePieces cut = cut_triangle(triangle, others);
  EXPECT_EQ(cut.num_collapsed, 0U);
  const Point normal = cross(triangle[1] - triangle[0], triangle[2] - triangle[0]);
  for (const Corners& piece : cut.corners) {
    pieces.insert(sorted(piece));
    area += area_of(piece);
    EXPECT_GT(dot(normal, cross(piece[1] - piece[0], piece[2] - piece[0])), 0);  // turned alike
  }
  EXPECT_NEAR(area, area_of(triangle), 1e-12 * area);
  return pieces;
}

// The edges of pieces that lie on an edge of the triangle.
std::set<std::array<Point, 2>> on_edge(const std::set<Corners>& pieces, const Point& a,
                                       const Point& b) {
  std::set<std::array<Point, 2>> edges;
  const auto is_on = [&](const Point& p) {
    return norm(cross(p - a, b - a)) < 1e-12 * norm(b - a);
  };
  for (const Corners& t : pieces)
    for (std::size_t k = 0; k < 3; ++k)
      if (Point p = t[k], q = t[(k + 1) % 3]; is_on(p) && is_on(q))
        edges.insert({std::min(p, q), std::max(p, q)});
  return edges;
}

TEST(CutTriangle, StaysWhereOthersHaveItsVerticesAndEdges) {
  const Corners t{{{0, 0, 0}, {2, 0, 0}, {0, 2, 0}}};
  EXPECT_EQ(pieces_of(t, {}).size(), 1U);
  EXPECT_EQ(pieces_of(t, {{{{0, 0, 0}, {2, 0, 0}, {0, 0, 5}}}}).size(), 1U);   // an edge
  EXPECT_EQ(pieces_of(t, {{{{0, 2, 0}, {3, 3, 4}, {-1, 0, 5}}}}).size(), 1U);  // a vertex
  EXPECT_EQ(pieces_of(t, {{{{5, 5, 0}, {7, 5, 0}, {5, 7, 0}}}}).size(), 1U);   // apart
  EXPECT_EQ(pieces_of(t, {{{{0, 2, 0}, {0, 0, 0}, {2, 0, 0}}}}).size(), 1U);   // itself
}

TEST(CutTriangle, HasTheSegmentInWhichAnotherCrosses) {
  const Corners t{{{0, 0, 0}, {4, 0, 0}, {0, 4, 0}}}, s{{{1, 1, -1}, {1, 1, 1}, {9, 9, 1}}};
  // From (1, 1) to the edge at (2, 2).
  const std::set<Corners> pieces = pieces_of(t, {s});
  bool has_segment = false;
  for (const Corners& piece : pieces)
    has_segment |= std::ranges::count(piece, Point{1, 1, 0}) == 1 &&
                   std::ranges::count(piece, Point{2, 2, 0}) == 1;
  EXPECT_TRUE(has_segment);
  EXPECT_EQ(pieces.size(), 4U);
}

TEST(CutTriangle, TheOtherDiagonalsMeetInAVertex) {
  // A square in a tilted plane, by both of its diagonals.
  const Point a{0, 0, 1}, b{2, 0, 3}, c{2, 2, 7}, d{0, 2, 5};
  const std::vector<Corners> one = {{{a, b, c}}, {{a, c, d}}}, other = {{{a, b, d}}, {{b, c, d}}};
  std::set<Corners> of_one, of_other;
  for (const Corners& t : one) of_one.merge(pieces_of(t, other));
  for (const Corners& t : other) of_other.merge(pieces_of(t, one));
  EXPECT_EQ(of_one, of_other);
  EXPECT_EQ(of_one.size(), 4U);
}

TEST(CutTriangle, PointsOnOneCircleMakeTheSamePiecesInAnyOrder) {
  // The corners of a regular pattern are on circles together: each plane is cut by the same rule.
  std::vector<Corners> squares;
  for (int i = 1; i < 6; ++i)
    for (int j = 1; j < 6; ++j) {
      const Point low{double(i), double(j), 0};
      squares.push_back({{low, low + Point{1, 0, 0}, low + Point{1, 1, 0}}});
    }
  const Corners large{{{-1, -1, 0}, {20, -1, 0}, {-1, 20, 0}}};
  const std::set<Corners> pieces = pieces_of(large, squares);
  for (const Corners& t : squares) {
    std::vector<Corners> others = squares;
    std::erase(others, t);
    others.push_back(large);
    for (const Corners& piece : pieces_of(t, others)) EXPECT_TRUE(pieces.contains(piece));
  }
  std::mt19937_64 random(3);
  std::ranges::shuffle(squares, random);
  EXPECT_EQ(pieces_of(large, squares), pieces);
}

// Random triangles of small integers: many are in one plane, share edges or cross.
TEST(CutTriangle, AgreesWithWhatItMeets) {
  constexpr unsigned kSeed = 17;
  SCOPED_TRACE(kSeed);
  std::mt19937_64 random(kSeed);
  const auto pick = [&] { return double(random() % 7); };
  int num_common = 0, num_edges = 0;
  for (int trial = 0; trial < 300; ++trial) {
    const bool is_plane = trial % 2 == 0;
    const auto point = [&] {
      const double x = pick(), y = pick();
      return Point{x, y, is_plane ? x + 2 * y : pick()};
    };
    const auto triangle = [&](const Point& a, const Point& b) {
      Corners t{a, b, point()};
      while (norm(cross(t[1] - t[0], t[2] - t[0])) == 0) t[2] = point();
      return t;
    };
    const auto other_than = [&](const Point& a) {
      Point b = point();
      while (b == a) b = point();
      return b;
    };
    const Point a = point(), b = other_than(a), p = point(), q = other_than(p);
    // Of one body two with a common edge; the others of another one, likewise.
    const Corners s = triangle(a, b), next = triangle(a, b), t = triangle(p, q),
                  beyond = triangle(p, q);
    const std::vector<Corners> ours = {s, next}, theirs = {t, beyond};
    const std::set<Corners> of_s = pieces_of(s, theirs), of_t = pieces_of(t, ours);
    const auto common_edges = on_edge(of_s, a, b);
    EXPECT_EQ(common_edges, on_edge(pieces_of(next, theirs), a, b));
    num_edges += common_edges.size() > 1;
    // Of the same plane, what lies in both is the same. Two of a body that lie on each other are
    // none of a valid one, and the arrangement knows only one of them.
    const TrianglePieces alone = cut_triangle(s, std::vector{t}), likewise = cut_triangle(t, {{s}});
    std::set<Corners> of_likewise;
    for (const Corners& piece : likewise.corners) of_likewise.insert(sorted(piece));
    const auto lies_in = [](const Point& x, const Corners& in) {
      const Point n = cross(in[1] - in[0], in[2] - in[0]);
      for (std::size_t k = 0; k < 3; ++k)
        if (dot(cross(in[(k + 1) % 3] - in[k], x - in[k]), n) < 1e-9) return false;
      return std::abs(dot(n, x - in[0])) < 1e-9;
    };
    for (const Corners& piece : alone.corners)
      if (lies_in(1.0 / 3 * (piece[0] + piece[1] + piece[2]), t)) {
        EXPECT_TRUE(of_likewise.contains(sorted(piece)));
        ++num_common;
      }
  }
  EXPECT_GT(num_common, 100);
  EXPECT_GT(num_edges, 50);
}

TEST(ImprintedTriangle, TakesOverWhatIsNearAndNothingElse) {
  constexpr double kNear = 1e-9, kOff = 1e-12;
  const Corners t{{{0, 0, 0}, {4, 0, 0}, {0, 4, 0}}};
  const auto imprinted = [&](const Corners& other) {
    EXPECT_TRUE(leaves_print(t, other, kNear));
    return imprinted_triangle(t, std::vector{other}, kNear).corners;
  };
  // A vertex near the face, one near an edge, an edge that passes an edge.
  EXPECT_EQ(imprinted({{{1, 1, kOff}, {1, 1, 2}, {2, 1, 2}}}).size(), 3U);
  EXPECT_EQ(imprinted({{{1, -kOff, kOff}, {1, 1, 2}, {2, 1, 2}}}).size(), 2U);
  EXPECT_EQ(imprinted({{{2, -3, -3}, {2, 3 + kOff, 3}, {2, 9, -9}}}).size(), 2U);
  // Its plane, by another triangle: what they share has the same pieces.
  const Corners s{{{1, 1, kOff}, {9, 1, -kOff}, {1, 9, kOff}}};
  const auto of_t = imprinted(s);
  const auto of_s = imprinted_triangle(s, std::vector{t}, kNear).corners;
  std::set<Corners> pieces;
  for (const Corners& piece : of_s) pieces.insert(sorted(piece));
  EXPECT_EQ(std::ranges::count_if(
                of_t, [&](const Corners& piece) { return pieces.contains(sorted(piece)); }),
            1);
  // One that is not near.
  EXPECT_FALSE(leaves_print(t, {{{1, 1, 1e-6}, {1, 1, 2}, {2, 1, 2}}}, kNear));
  EXPECT_FALSE(leaves_print(t, {{{0, 0, 0}, {4, 0, 0}, {2, -3, 0}}}, kNear));
  // One without width goes.
  EXPECT_TRUE(
      imprinted_triangle({{{0, 0, 0}, {2, kOff, 0}, {4, 0, 0}}}, {}, kNear).corners.empty());
}

}  // namespace
}  // namespace locvol
