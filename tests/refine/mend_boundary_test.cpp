// Mended boundaries: by hand where two cells touch, and by brute force on random parts of Delaunay
// triangulations.
#include "refine/mend_boundary.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <map>
#include <numeric>
#include <set>
#include <utility>
#include <vector>

#include "refine/delaunay.h"
#include "tests/refine/shapes.h"

namespace locvol {
namespace {

using Cell = std::array<std::uint32_t, 4>;
using Cells = std::vector<Cell>;

MendInput input_of(Cells cells) {
  MendInput input;
  for (const Cell& cell : cells)
    for (const std::uint32_t v : cell) input.num_own = std::max(input.num_own, v + 1);
  input.is_on_surface.assign(input.num_own, true);
  input.cells = std::move(cells);
  return input;
}

Cells left(const MendInput& input, const std::vector<std::uint32_t>& left_out) {
  Cells cells;
  for (std::uint32_t c = 0; c < input.cells.size(); ++c)
    if (!std::ranges::binary_search(left_out, c)) cells.push_back(input.cells[c]);
  return cells;
}

// Vertices below `num_own` whose boundary facets are neither none nor one cycle, by maps.
std::set<std::uint32_t> bad_vertices(const Cells& cells, std::uint32_t num_own) {
  std::map<std::array<std::uint32_t, 3>, int> facets;
  for (const Cell& cell : cells)
    for (std::size_t k = 0; k < 4; ++k) {
      std::array<std::uint32_t, 3> facet{cell[(k + 1) % 4], cell[(k + 2) % 4], cell[(k + 3) % 4]};
      std::ranges::sort(facet);
      ++facets[facet];
    }
  std::map<std::uint32_t, std::multimap<std::uint32_t, std::uint32_t>> links;
  for (const auto& [facet, count] : facets) {
    if (count != 1) continue;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto a = facet[(k + 1) % 3], b = facet[(k + 2) % 3];
      links[facet[k]].insert({a, b});
      links[facet[k]].insert({b, a});
    }
  }
  std::set<std::uint32_t> bad;
  for (const auto& [v, link] : links) {
    if (v >= num_own) continue;
    std::set<std::uint32_t> seen;
    std::vector<std::uint32_t> next{link.begin()->first};
    while (!next.empty()) {
      const auto at = next.back();
      next.pop_back();
      if (!seen.insert(at).second) continue;
      if (link.count(at) != 2) bad.insert(v);
      for (auto [e, end] = link.equal_range(at); e != end; ++e) next.push_back(e->second);
    }
    for (const auto& [end, other] : link)
      if (!seen.contains(end)) bad.insert(v);
  }
  return bad;
}

TEST(MendBoundary, LeavesAManifoldAsItIs) {
  EXPECT_TRUE(mend_boundary({}).empty());
  EXPECT_TRUE(mend_boundary(input_of({{0, 1, 2, 3}})).empty());
  EXPECT_TRUE(mend_boundary(input_of({{0, 1, 2, 3}, {1, 2, 3, 4}, {5, 6, 7, 8}})).empty());
}

TEST(MendBoundary, OfTwoPartsThatTouchInAVertexTheLargerStays) {
  const auto input = input_of({{0, 1, 2, 3}, {3, 4, 5, 6}, {3, 5, 6, 7}});
  EXPECT_EQ(mend_boundary(input), std::vector<std::uint32_t>{0});
}

TEST(MendBoundary, OfTwoPartsThatTouchInAnEdgeTheLargerStays) {
  const auto input = input_of({{0, 1, 2, 3}, {2, 3, 4, 5}, {2, 3, 5, 6}});
  EXPECT_EQ(mend_boundary(input), std::vector<std::uint32_t>{0});
}

TEST(MendBoundary, AVolumeVertexIsNotLaidBare) {
  auto input = input_of({{0, 1, 2, 3}, {3, 4, 5, 6}, {3, 5, 6, 7}});
  input.is_on_surface[0] = false;
  EXPECT_EQ(mend_boundary(input), (std::vector<std::uint32_t>{1, 2}));
}

TEST(MendBoundary, JudgesOwnVerticesOnly) {
  auto input = input_of({{0, 1, 2, 3}, {3, 4, 5, 6}});
  input.num_own = 3;
  EXPECT_TRUE(mend_boundary(input).empty());
}

// Cells around vertex 0 without those at the two ends of an axis through it: one part, no bad edge,
// but the boundary comes to the vertex from both ends.
TEST(MendBoundary, AStarWithTwoBoundaryCyclesGoes) {
  constexpr std::uint32_t n = 6;  // rings of n vertices above and below a ring of the same
  Cells cells;
  for (std::uint32_t i = 0; i < n; ++i) {
    const std::uint32_t j = (i + 1) % n, up = 1, down = 1 + n;
    cells.push_back({0, up + i, up + j, down + i});
    cells.push_back({0, up + j, down + i, down + j});
  }
  const MendInput input = input_of(cells);
  EXPECT_EQ(bad_vertices(cells, 1).size(), 1u);
  EXPECT_EQ(mend_boundary(input).size(), cells.size());
}

class RandomParts : public testing::TestWithParam<int> {};

// Of a triangulation's cells a random part, torn nearly everywhere.
TEST_P(RandomParts, EachOwnVertexEndsInADisk) {
  shapes::Random random(static_cast<unsigned>(80 + GetParam()));
  std::vector<Point> points;
  for (int n = 0; n < 400; ++n)
    points.push_back(shapes::uniform_in(random, {{0, 0, 0}, {1, 1, 1}}));
  Delaunay delaunay;
  ASSERT_TRUE(delaunay.build(points));
  Cells cells;
  for (Delaunay::Cell c = 0; c < delaunay.cell_bound(); ++c)
    if (delaunay.is_cell(c) && !delaunay.is_infinite(c) && int(random() % 10) < GetParam())
      cells.push_back(delaunay.vertices(c));
  MendInput input = input_of(cells);
  for (std::size_t v = 0; v < input.num_own; ++v) input.is_on_surface[v] = random() % 4 != 0;
  input.num_own = 300;
  std::erase_if(input.cells, [&](const Cell& c) {
    return std::ranges::all_of(c, [&](std::uint32_t v) { return v >= input.num_own; });
  });
  ASSERT_FALSE(bad_vertices(input.cells, input.num_own).empty());
  const auto left_out = mend_boundary(input);
  EXPECT_TRUE(std::ranges::is_sorted(left_out));
  MendInput mended = input;
  mended.cells = left(input, left_out);
  EXPECT_TRUE(bad_vertices(mended.cells, input.num_own).empty());
  EXPECT_GT(mended.cells.size(), 100u);
  EXPECT_TRUE(mend_boundary(mended).empty());
}

// Three bodies that fill all of it, torn as random parts are: each is mended as if it were alone.
TEST(MendBoundary, OfSeveralBodiesEachIsMendedByItself) {
  constexpr unsigned kSeed = 84;
  shapes::Random random(kSeed);
  std::vector<Point> points;
  for (int n = 0; n < 300; ++n) points.push_back(shapes::uniform_in(random, shapes::kCube));
  Delaunay delaunay;
  ASSERT_TRUE(delaunay.build(points));
  Cells cells;
  for (Delaunay::Cell c = 0; c < delaunay.cell_bound(); ++c)
    if (delaunay.is_cell(c) && !delaunay.is_infinite(c)) cells.push_back(delaunay.vertices(c));
  MendInput input = input_of(cells);
  std::map<BodyId, MendInput> alone;
  std::map<BodyId, std::vector<std::uint32_t>> places;
  for (std::uint32_t c = 0; c < cells.size(); ++c) {
    const auto body = static_cast<BodyId>(1 + random() % 3);
    input.bodies.push_back(body);
    MendInput& own = alone[body];
    own.num_own = input.num_own;
    own.is_on_surface = input.is_on_surface;
    own.cells.push_back(cells[c]);
    places[body].push_back(c);
  }
  std::vector<std::uint32_t> expected;
  for (const auto& [body, own] : alone)
    for (const std::uint32_t c : mend_boundary(own)) expected.push_back(places[body][c]);
  std::ranges::sort(expected);
  EXPECT_FALSE(expected.empty());
  EXPECT_EQ(mend_boundary(input), expected) << "seed " << kSeed;
}

INSTANTIATE_TEST_SUITE_P(OfTen, RandomParts, testing::Values(5, 7, 8, 9));

}  // namespace
}  // namespace locvol
