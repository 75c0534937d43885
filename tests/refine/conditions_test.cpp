#include "refine/conditions.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

#include "refine/leaf_mesh.h"
#include "refine/vertex_move.h"
#include "tests/refine/shapes.h"

namespace locvol {
namespace {

using shapes::Random;
using shapes::uniform_in;
using Link = std::vector<LinkEdge>;
using Vertices = std::vector<Delaunay::Vertex>;

// h = 1 + g d, where d is the distance from the plane x = 0 of a cube of side 8 around the origin.
SizeCubes sizes_beside_a_plane(double growth) {
  SizeCubes sizes{
      .law = {.surface = 1, .growth = growth}, .frame = Frame({-4, -4, -4}, 0x1p-18), .cubes = {}};
  SizeCube cube{.key = MortonKey::root()};
  for (std::size_t k = 0; k < 8; ++k) cube.distance[k] = k & 1 ? 4.f : -4.f;
  sizes.cubes.push_back(cube);
  return sizes;
}

// ---- Cells

// Of edge 1: the circumradius is √6/4, and so is its ratio.
TEST(Conditions, OfTheRegularCell) {
  const double s = std::sqrt(0.125), radius = std::sqrt(6.) / 4;
  const CellView cell{.center = {0, 0, 0},
                      .squared_radius = radius * radius,
                      .corners = {Point{s, s, s}, {s, -s, -s}, {-s, s, -s}, {-s, -s, s}}};
  const SizeField smaller(0.99 * radius), larger(1.01 * radius);
  EXPECT_EQ(judge(cell, {larger, 1.01 * radius}), std::nullopt);
  EXPECT_EQ(judge(cell, {larger, 0.99 * radius}), kC6);
  EXPECT_EQ(judge(cell, {smaller, 1.01 * radius}), kC5);
  EXPECT_EQ(judge(cell, {smaller, 0.99 * radius}), kC5);
}

// Radii are to be below λ, ratios at most the bound.
TEST(Conditions, OfCellsAreTightAtTheirBounds) {
  CellView cell{.center = {1, 1, 1},
                .squared_radius = 4,
                .corners = {Point{0, 0, 0}, {1, 0, 0}, {0, 3, 0}, {0, 0, 3}}};
  EXPECT_EQ(judge(cell, {SizeField(3), 2}), std::nullopt);
  EXPECT_EQ(judge(cell, {SizeField(2), 2}), kC5);
  cell.squared_radius = std::nextafter(4., 5.);
  EXPECT_EQ(judge(cell, {SizeField(3), 2}), kC6);
  cell.squared_radius = std::nextafter(4., 3.);
  EXPECT_EQ(judge(cell, {SizeField(2), 2}), std::nullopt);
}

// C5 asks for h at the circumcenter; C1 for λ, wherever the ball is.
TEST(Conditions, AskForTheSizeAtTheCenter) {
  const SizeField sizes(sizes_beside_a_plane(0.25));
  const Bounds bounds{sizes, std::numeric_limits<double>::infinity()};
  for (const double x : {-3., 0., 1., 2., 3.5}) {
    const double size = 1 + 0.25 * std::max(x, 0.);
    for (const double radius : {0.99 * size, 1.01 * size}) {
      const CellView cell{.center = {x, 1, 2}, .squared_radius = radius * radius, .corners = {}};
      EXPECT_EQ(judge(cell, bounds) == kC5, radius > size) << x;
      const FacetView facet{
          {.count = 1, .ball_center = {x, 1, 2}, .squared_radius = radius * radius, .open_end = {}},
          true};
      EXPECT_EQ(judge(facet, bounds) == kC1, radius > 1) << x;
    }
  }
}

// ---- Facets

TEST(Conditions, OfFacetsTellTheFirstThatIsBroken) {
  const SizeField sizes(1);
  for (const int count : {0, 1, 2, 3})
    for (const double squared_radius : {0.5, 1., 2.})
      for (const bool is_on_surface : {false, true})
        for (const bool is_open : {false, true}) {
          const FacetView facet{{.count = count,
                                 .ball_center = {3, 1, 4},
                                 .squared_radius = squared_radius,
                                 .open_end = is_open ? std::optional(Point{1, 2, 3}) : std::nullopt,
                                 .open_radius = 1},
                                is_on_surface};
          std::vector<Condition> broken;
          if (count > 0 && squared_radius >= 1) broken.push_back(kC1);
          if (count > 0 && !is_on_surface) broken.push_back(kC2);
          if (count > 1) broken.push_back(kC4);
          const auto first = broken.empty() ? std::nullopt : std::optional(broken.front());
          EXPECT_EQ(judge(facet, {sizes, 2}), first);
          EXPECT_EQ(judge_end(facet), is_open ? std::optional(kC5) : std::nullopt);
        }
}

// ---- Stars

Link shuffled(Link link, Random& random) {
  std::ranges::shuffle(link, random);
  for (auto& [a, b] : link)
    if (random() % 2 == 0) std::swap(a, b);
  return link;
}

// Different vertices in any order.
Vertices some_vertices(std::size_t num, Random& random) {
  Vertices vertices(3 * num);
  std::iota(vertices.begin(), vertices.end(), Delaunay::Vertex{0});
  std::ranges::shuffle(vertices, random);
  vertices.resize(num);
  return vertices;
}

Link path_along(std::span<const Delaunay::Vertex> vertices) {
  Link link;
  for (std::size_t i = 1; i < vertices.size(); ++i) link.push_back({vertices[i - 1], vertices[i]});
  return link;
}

Link cycle_along(const Vertices& vertices) {
  Link link = path_along(vertices);
  link.push_back({vertices.back(), vertices.front()});
  return link;
}

std::optional<Condition> judge_link(Link link) { return judge(StarView{link}); }

TEST(Conditions, OfStarsHoldOfOneCycleOnly) {
  EXPECT_EQ(judge_link({}), std::nullopt);
  constexpr unsigned kSeed = 6;
  Random random(kSeed);
  for (std::size_t n = 3; n < 40; ++n) {
    Vertices vertices = some_vertices(2 * n, random);
    const Vertices others(vertices.begin() + std::ptrdiff_t(n), vertices.end());
    vertices.resize(n);
    const Link cycle = cycle_along(vertices);
    EXPECT_EQ(judge_link(shuffled(cycle, random)), std::nullopt);
    Link open = shuffled(cycle, random);
    open.pop_back();
    EXPECT_EQ(judge_link(open), kC3) << "a facet is missing";
    const auto with = [&](const Link& more) {
      Link link = cycle;
      link.insert(link.end(), more.begin(), more.end());
      return shuffled(link, random);
    };
    EXPECT_EQ(judge_link(with(cycle_along(others))), kC3) << "two disks";
    EXPECT_EQ(judge_link(with({{vertices[0], others[0]}})), kC3) << "a fin";
    Vertices touching = others;
    touching[0] = vertices[random() % n];
    EXPECT_EQ(judge_link(with(cycle_along(touching))), kC3) << "two disks that touch";
    if (n > 3) {
      EXPECT_EQ(judge_link(with({{vertices[0], vertices[2]}})), kC3) << "three at an edge";
    }
  }
}

// As around a point of a crease with several wedges: each pair of neighbors has a path from one end
// of the crease to the other, and the two paths of a wedge are its disk.
TEST(Conditions, OfStarsOfSeveralBodiesHoldOfOneCycleOfEach) {
  constexpr unsigned kSeed = 7;
  Random random(kSeed);
  for (BodyId num = 2; num < 13; ++num) {
    const std::size_t between = 1 + random() % 5;
    const Vertices vertices = some_vertices(2 + num * between, random);
    std::vector<BodyLinkEdge> link;
    for (BodyId sheet = 0; sheet < num; ++sheet) {
      Vertices way = {vertices[0]};
      for (std::size_t k = 0; k < between; ++k) way.push_back(vertices[2 + sheet * between + k]);
      way.push_back(vertices[1]);
      const BodyId one = sheet, other = (sheet + 1) % num;  // the first wedge is outside of all
      for (const LinkEdge& edge : path_along(way))
        link.push_back({edge, {std::max(one, other), std::min(one, other)}});
    }
    std::ranges::shuffle(link, random);
    EXPECT_EQ(judge(BodyStarView{link}), std::nullopt) << num;
    std::vector<BodyLinkEdge> open = link;
    open.pop_back();
    EXPECT_EQ(judge(BodyStarView{open}), kC3) << "a facet is missing";
    // Outside is not asked: another body may touch there.
    const Vertices others = {1000, 1001, 1002};
    std::vector<BodyLinkEdge> touched = link;
    for (const LinkEdge& edge : cycle_along(others)) touched.push_back({edge, {num, kNoBody}});
    EXPECT_EQ(judge(BodyStarView{touched}), std::nullopt);
    for (BodyLinkEdge& edge : touched)
      if (edge.bodies[0] == num) edge.bodies[0] = 1;
    EXPECT_EQ(judge(BodyStarView{touched}), kC3) << "two disks of a body";
  }
}

// Of a part of a cycle that gives way to another path; where that comes by the rest of the cycle,
// or ends elsewhere, the disk is none.
TEST(Conditions, OfAStarThatIsKnownInPartAreThoseOfTheWhole) {
  constexpr unsigned kSeed = 6;
  Random random(kSeed);
  int num_kept = 0, num_broken = 0;
  for (int n = 0; n < 2000; ++n) {
    const std::size_t size = 4 + random() % 12, num_edges = 1 + random() % (size - 2);
    const Vertices all = some_vertices(2 * size, random);
    const Vertices before(all.begin(), all.begin() + std::ptrdiff_t(size));
    const Link cycle = cycle_along(before);
    const auto cut = cycle.begin() + std::ptrdiff_t(num_edges);
    const Link gone(cycle.begin(), cut), kept(cut, cycle.end());
    // From one end to the other, through vertices that were in the link, or were not.
    Vertices way{before[0]};
    for (std::size_t k = random() % 4; k > 0; --k) {
      const auto next = all[random() % all.size()];
      if (std::ranges::find(way, next) == way.end()) way.push_back(next);
    }
    if (n % 5 != 0) std::erase(way, before[num_edges]), way.push_back(before[num_edges]);
    const Link made = path_along(way);

    Link after = kept;
    after.insert(after.end(), made.begin(), made.end());
    const auto is_off = [&](Delaunay::Vertex w) {
      return std::ranges::find(before, w) == before.end();
    };
    const auto told = judge(StarChange{shuffled(gone, random), shuffled(made, random)}, is_off);
    EXPECT_EQ(told, judge_link(after)) << "seed " << kSeed << ", case " << n;
    ++(told ? num_broken : num_kept);
  }
  EXPECT_GT(num_kept, 300);
  EXPECT_GT(num_broken, 300);
  EXPECT_EQ(judge(StarChange{}, [](Delaunay::Vertex) { return false; }), std::nullopt);
}

// ---- A mesh and a change

// What a change would make is seen as it is once it is made. In a hollow ball with few points.
TEST(Conditions, AskTheSameOfAChangeAndOfWhatItMakes) {
  constexpr unsigned kSeed = 6;
  Random random(kSeed);
  const shapes::Mesh surface = shapes::nested_shells(1, 0.8, 2);
  LeafInput input;
  input.criteria = Criteria::of_paper(0.5, 2, 1e-3);
  input.box = shapes::kCube.expanded(0.3);
  const auto add = [&](const Point& p, PointKind kind) {
    input.own.push_back({input.own.size(), p, kind});
  };
  for (const Point& p : shapes::random_points_on(surface, 200, random)) add(p, PointKind::kSurface);
  for (int n = 0; n < 50; ++n) add(uniform_in(random, shapes::kCube), PointKind::kVolume);
  const LeafDomain domain({surface, input.box, input.box.min, {}});
  const SizeField sizes(0.5), smaller(0.2);
  const Surroundings around{domain, sizes, nullptr, nullptr, nullptr};
  LeafMesh mesh(input, around, LeafMesh::OwnPoints::kInBox);

  VertexMove move(mesh.delaunay());
  Delaunay::Change change;
  std::vector<LeafMesh::Prospect> prospects;
  std::map<int, int> num_told;  // by condition; 0: none
  const auto judge_both = [&](const auto& view) {
    for (const SizeField* size : {&sizes, &smaller})
      ++num_told[judge(view, {*size, input.criteria.radius_edge_bound}).value_or(Condition())];
  };
  const auto sorted = [](auto vertices) {
    std::ranges::sort(vertices);
    return vertices;
  };
  for (LocalIndex v = 0; v < mesh.num_locals(); ++v) {
    const Point q = mesh.local(v).point.position + 0.1 * uniform_in(random, shapes::kCube);
    if (!move.take_out(v) || !move.find(q, {}, change)) continue;
    const PointKind kind = mesh.local(v).point.kind;
    prospects.clear();
    for (std::size_t n = 0; n < change.made.size(); ++n)
      prospects.push_back(mesh.appraise(change, n, kind));
    std::map<std::array<LocalIndex, 4>, CellView> cells;  // inside
    std::map<std::array<LocalIndex, 3>, FacetView> facets;
    for (std::size_t n = 0; n < prospects.size(); ++n) {
      const auto& vertices = change.made[n].vertex;
      if (prospects[n].state.is_member()) cells[sorted(vertices)] = mesh.view(change, prospects, n);
      for (int i = 0; i < 4; ++i)
        facets[sorted(facet_of(vertices, i))] = mesh.view(change, prospects, n, i);
    }
    mesh.move(change, kind, kNewPoint | v);
    std::size_t num_inside = 0;
    for (const LeafMesh::Cell c : mesh.delaunay().new_cells()) {
      const auto& vertices = mesh.delaunay().vertices(c);
      if (mesh.is_member(c)) {
        ++num_inside;
        const auto told = cells.find(sorted(vertices));
        ASSERT_NE(told, cells.end());
        const CellView view = mesh.view(c);
        EXPECT_EQ(view.center, told->second.center);
        EXPECT_EQ(view.squared_radius, told->second.squared_radius);
        judge_both(view);
      }
      for (int i = 0; i < 4; ++i) {
        const auto told = facets.find(sorted(facet_of(vertices, i)));
        ASSERT_NE(told, facets.end());
        const FacetView view = mesh.view(LeafMesh::Facet{c, i});
        EXPECT_EQ(view.dual.count, told->second.dual.count);
        EXPECT_EQ(view.dual.ball_center, told->second.dual.ball_center);
        EXPECT_EQ(view.dual.squared_radius, told->second.dual.squared_radius);
        EXPECT_EQ(view.dual.open_end, told->second.dual.open_end);
        EXPECT_EQ(view.is_on_surface, told->second.is_on_surface);
        judge_both(view);
      }
    }
    EXPECT_EQ(num_inside, cells.size());
  }
  for (const int condition : {0, +kC1, +kC2, +kC4, +kC5, +kC6})
    EXPECT_GT(num_told[condition], 10) << condition;
}

}  // namespace
}  // namespace locvol
