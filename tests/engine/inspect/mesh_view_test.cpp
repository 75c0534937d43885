#include "engine/inspect/mesh_view.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "engine/engine.h"
#include "engine/inspect/leaf_report.h"
#include "engine/inspect/mesh_statistics.h"
#include "tests/engine/closed_shapes.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

using namespace testing_shapes;

using CellPoints = std::array<Point, 4>;  // in order of the points
using FacetPoints = std::array<Point, 3>;

CellPoints sorted(CellPoints corners) {
  std::ranges::sort(corners);
  return corners;
}

// All cells of a finished store, leaf by leaf, by the code that `inspect` uses.
std::multiset<CellPoints> cells_of(const Store& store) {
  std::multiset<CellPoints> cells;
  const Snapshot snapshot = store.snapshot();
  for (const MortonKey key : snapshot.leaf_keys()) {
    const LeafReport report = *report_leaf(snapshot, *snapshot.run(), key);
    for (std::size_t i = 0; i < report.mesh.cells.size(); ++i)
      cells.insert(sorted(report.mesh.corners(i)));
  }
  return cells;
}

CellPoints corners_of(const ViewCells& set, std::size_t cell) {
  CellPoints corners;
  for (std::size_t i = 0; i < 4; ++i) corners[i] = set.vertices[set.cells[cell][i]];
  return corners;
}

std::multiset<CellPoints> cells_of(const ViewCells& set) {
  std::multiset<CellPoints> cells;
  for (std::size_t i = 0; i < set.cells.size(); ++i) cells.insert(sorted(corners_of(set, i)));
  return cells;
}

// Facets in one cell only.
std::set<FacetPoints> boundary_of(const std::multiset<CellPoints>& cells) {
  std::map<FacetPoints, int> num_cells;
  for (const auto& [a, b, c, d] : cells)
    for (const FacetPoints& facet : {FacetPoints{b, c, d}, {a, c, d}, {a, b, d}, {a, b, c}})
      ++num_cells[facet];
  std::set<FacetPoints> boundary;
  for (const auto& [facet, num] : num_cells)
    if (num == 1) boundary.insert(facet);
  return boundary;
}

// Those that meet the plane of the set.
std::multiset<CellPoints> cells_meeting(const std::multiset<CellPoints>& all,
                                        const ViewCells& set) {
  std::multiset<CellPoints> met;
  for (const CellPoints& cell : all) {
    const auto [low, high] =
        std::ranges::minmax(cell, {}, [&](const Point& p) { return p[set.axis]; });
    if (low[set.axis] <= set.position && set.position <= high[set.axis]) met.insert(cell);
  }
  return met;
}

class MeshViewTest : public testing::Test {
 protected:
  Store meshed(const Shape& shape, double size, std::uint64_t leaf_capacity,
               const RunControl& control = {}, double growth = 0) {
    write_off(shape, input_);
    MeshOptions options;
    options.input = input_;
    options.store = scratch_ / "store";
    options.size = {size, false};
    options.leaf_capacity = leaf_capacity;
    options.growth = growth;
    mesh(options, control);
    return Store::open(options.store, {.read_only = true});
  }

  TempDir scratch_;
  std::filesystem::path input_ = scratch_ / "input.off";
};

// With parts of the lattice core in both, and what lies between them on the boundary of each.
TEST_F(MeshViewTest, KnowsTheBodyOfEachCell) {
  const Shape inner = sphere(0.5, 16, 32);
  write_off(inner, scratch_ / "core.off");
  write_off(sphere(1, 31, 64), input_);
  MeshOptions options;
  options.input = input_;
  options.more_inputs = {scratch_ / "core.off"};
  options.store = scratch_ / "store";
  options.size = {0.06, false};
  options.leaf_capacity = 2000;
  mesh(options, {});
  const Store store = Store::open(options.store, {.read_only = true});
  const MeshView view = mesh_view(store);
  ASSERT_TRUE(view.has_all_cells());
  const ViewCells& set = view.cells[0];
  std::vector<BodyId> body_of;
  for (const auto& [body, num] : set.bodies) body_of.insert(body_of.end(), num, body);
  ASSERT_EQ(body_of.size(), set.cells.size());
  std::array<std::uint64_t, 2> num_cells{}, num_between{}, num_outside{};
  for (std::size_t i = 0; i < set.cells.size(); ++i) {
    ++num_cells.at(body_of[i] - 1);
    for (int f = 0; f < 4; ++f) {
      if ((set.boundary[i] >> f & 1) == 0) continue;
      ++(set.boundary[i] >> f & 16 ? num_between : num_outside).at(body_of[i] - 1);
    }
  }
  const MeshStatistics statistics = mesh_statistics(store);
  EXPECT_GT(statistics.num_core_cells, 0U);
  for (std::size_t b = 0; b < 2; ++b) EXPECT_EQ(num_cells[b], statistics.bodies.at(b).num_cells);
  EXPECT_GT(num_between[0], 100U);
  EXPECT_EQ(num_between[0], num_between[1]);
  EXPECT_GT(num_outside[0], 100U);
  EXPECT_EQ(num_outside[1], 0U);
  EXPECT_EQ(set.sheets.size(), num_between[0] + num_between[1] + num_outside[0]);
}

// κ such that several leaves have part of the lattice core.
class MeshViewOf : public MeshViewTest, public testing::WithParamInterface<std::uint64_t> {};

TEST_P(MeshViewOf, HasAllCellsOfASmallMeshAndItsBoundary) {
  const Store store = meshed(sphere(1, 31, 64), 0.13, GetParam());
  const MeshView view = mesh_view(store);
  ASSERT_TRUE(view.has_all_cells());
  const ViewCells& set = view.cells[0];
  const auto expected = cells_of(store);
  EXPECT_EQ(set.cells.size(), store.snapshot().run()->counts.num_cells);
  EXPECT_EQ(cells_of(set), expected);
  EXPECT_TRUE(view.surface.triangles.empty());

  std::set<FacetPoints> boundary;
  ASSERT_EQ(set.boundary.size(), set.cells.size());
  for (std::size_t i = 0; i < set.cells.size(); ++i)
    for (std::size_t opposite = 0; opposite < 4; ++opposite) {
      if ((set.boundary[i] >> opposite & 1) == 0) continue;
      const CellPoints corners = corners_of(set, i);
      FacetPoints facet;
      for (std::size_t k = 0, n = 0; k < 4; ++k)
        if (k != opposite) facet[n++] = corners[k];
      std::ranges::sort(facet);
      EXPECT_TRUE(boundary.insert(facet).second);
    }
  EXPECT_GT(boundary.size(), 500U);
  EXPECT_EQ(boundary, boundary_of(expected));

  // Each cell is counted to one leaf, and measured.
  std::uint64_t num_cells = 0, num_in_leaves = 0;
  for (const auto& [leaf, count] : set.leaves) {
    ASSERT_LT(leaf, view.leaves.size());
    EXPECT_EQ(view.leaves[leaf].num_cells, count);
    num_cells += count;
  }
  EXPECT_EQ(num_cells, set.cells.size());
  for (const ViewLeaf& leaf : view.leaves) num_in_leaves += leaf.num_cells;
  EXPECT_EQ(num_in_leaves, num_cells);
  for (std::size_t i = 0; i < set.cells.size(); i += 17) {
    const CellQuality quality = quality_of(corners_of(set, i));
    EXPECT_FLOAT_EQ(set.min_dihedral_degrees[i], static_cast<float>(quality.min_dihedral_degrees));
    EXPECT_FLOAT_EQ(set.radius_edge_ratios[i], static_cast<float>(quality.radius_edge_ratio));
  }

  // Vertices are in the order of their first naming, as the page's encoding wants.
  std::uint32_t num_known = 0;
  for (const auto& cell : set.cells)
    for (const std::uint32_t vertex : cell) {
      ASSERT_LE(vertex, num_known);
      if (vertex == num_known) ++num_known;
    }
  EXPECT_EQ(num_known, set.vertices.size());
}

INSTANTIATE_TEST_SUITE_P(Capacity, MeshViewOf, testing::Values(20000, 1000, 120));

// Where sizes vary, cells reach farther out of their leaves than 2 λ.
TEST_F(MeshViewTest, HasTheCellsThatMeetAPlaneWhereSizesVary) {
  const Store store = meshed(sphere(1, 61, 128), 0.05, 300, {}, 0.3);
  const auto all = cells_of(store);
  ViewLimits limits;
  limits.max_cells = all.size() * 3 / 5;
  const MeshView view = mesh_view(store, limits);
  ASSERT_GE(view.cells.size(), 3U);
  for (const ViewCells& set : view.cells) {
    EXPECT_EQ(cells_of(set), cells_meeting(all, set));
  }
}

TEST_F(MeshViewTest, HasTheCellsThatMeetSomePlanesOfALargeMesh) {
  const Store store = meshed(sphere(1, 31, 64), 0.1, 1000);
  const auto all = cells_of(store);
  ViewLimits limits;
  limits.max_cells = all.size() * 3 / 5;
  const MeshView view = mesh_view(store, limits);
  ASSERT_GE(view.cells.size(), 3U);
  EXPECT_FALSE(view.has_all_cells());
  std::uint64_t num_cells = 0;
  std::array<int, 3> num_planes{};
  for (const ViewCells& set : view.cells) {
    ++num_planes.at(static_cast<std::size_t>(set.axis));
    const std::multiset<CellPoints> expected = cells_meeting(all, set);
    EXPECT_GT(expected.size(), 100U);
    EXPECT_EQ(cells_of(set), expected);
    EXPECT_TRUE(set.boundary.empty());
    num_cells += set.cells.size();
  }
  EXPECT_LE(num_cells, limits.max_cells);
  EXPECT_EQ(num_planes[0], num_planes[1]);
  EXPECT_EQ(num_planes[0], num_planes[2]);
  EXPECT_EQ(view.surface.triangles.size(), store.snapshot().run()->surface.num_triangles);

  limits.max_cells = 50;  // less than any plane meets
  EXPECT_TRUE(mesh_view(store, limits).cells.empty());
}

// A ring leaves most of its leaves empty: its planes meet more cells than was estimated, and now
// and then more than there is room for.
TEST_F(MeshViewTest, HasFewerPlanesWhereThoseChosenMeetTooManyCells) {
  const Store store = meshed(torus(1, 0.15, 96, 16), 0.08, 1000);
  const std::uint64_t num_cells = store.snapshot().run()->counts.num_cells;
  std::size_t num_planes = 0;
  for (std::uint64_t part = 40; part < 200; ++part) {
    ViewLimits limits;
    limits.max_cells = num_cells * part / 200;
    const MeshView view = mesh_view(store, limits);
    std::uint64_t num_shown = 0;
    for (const ViewCells& set : view.cells) num_shown += set.cells.size();
    EXPECT_LE(num_shown, limits.max_cells) << part;
    EXPECT_GE(view.cells.size(), num_planes) << "fewer than with less room, " << part;
    num_planes = view.cells.size();
  }
  EXPECT_GE(num_planes, 6U);
}

TEST_F(MeshViewTest, JoinsSmallLeaves) {
  const Store store = meshed(sphere(1, 31, 64), 0.1, 60);
  const MeshView whole = mesh_view(store);
  ViewLimits limits;
  limits.max_leaves = 20;
  const MeshView view = mesh_view(store, limits);
  EXPECT_GT(whole.leaves.size(), 100U);
  EXPECT_LE(view.leaves.size(), limits.max_leaves);
  std::uint64_t num_leaves = 0, num_cells = 0;
  for (std::size_t i = 0; i < view.leaves.size(); ++i) {
    num_leaves += view.leaves[i].num_leaves;
    num_cells += view.leaves[i].num_cells;
  }
  EXPECT_TRUE(std::ranges::is_sorted(view.leaves, {}, &ViewLeaf::key));
  EXPECT_EQ(num_leaves, whole.leaves.size());
  EXPECT_EQ(num_cells, store.snapshot().run()->counts.num_cells);
  std::map<std::uint32_t, std::uint64_t> cells_of_leaf;
  for (const auto& [leaf, count] : view.cells[0].leaves) cells_of_leaf[leaf] += count;
  for (const auto& [leaf, count] : cells_of_leaf) EXPECT_EQ(view.leaves[leaf].num_cells, count);
}

TEST_F(MeshViewTest, ShowsTheSurfaceOfARunThatIsNotDone) {
  RunControl control;
  control.is_stopped = [left = 12]() mutable { return left-- == 0; };
  const Shape shape = torus(1, 0.4, 32, 16);
  const Store store = meshed(shape, 0.2, 60, control);
  ASSERT_NE(store.snapshot().run()->phase, Phase::kDone);
  const MeshView view = mesh_view(store);
  EXPECT_TRUE(view.cells.empty());
  EXPECT_EQ(view.surface.triangles.size(), shape.triangles.size());
  EXPECT_GT(view.leaves.size(), 8U);
}

// -- A surface made of fewer triangles ----------------------------------------------------------

double volume_of(const ViewSurface& surface) {
  double volume = 0;
  for (const auto& [a, b, c] : surface.triangles)
    volume += dot(cross(surface.vertices[a], surface.vertices[b]), surface.vertices[c]) / 6;
  return volume;
}

// For each edge, triangles that turn one way less those that turn the other way.
void expect_closed(const ViewSurface& surface) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> turns;
  for (const auto& t : surface.triangles)
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t a = t[i], b = t[(i + 1) % 3];
      ASSERT_NE(a, b);
      turns[std::minmax(a, b)] += a < b ? 1 : -1;
    }
  for (const auto& [edge, sum] : turns) EXPECT_EQ(sum, 0);
}

TEST(SurfaceThinner, KeepsASurfaceClosedAndNearItsVolume) {
  const Shape shape = torus(1, 0.4, 120, 60);
  for (const double grid : {0.03, 0.1, 0.25}) {
    SurfaceThinner thinner({-2, -2, -2}, grid);
    for (const Triangle& triangle : shape.soup()) thinner.add(triangle);
    const ViewSurface surface = thinner.take();
    EXPECT_GT(surface.triangles.size(), 50U);
    EXPECT_LT(surface.triangles.size(), shape.triangles.size());
    expect_closed(surface);
    const double volume = 2 * std::numbers::pi * std::numbers::pi * 0.4 * 0.4;
    EXPECT_NEAR(volume_of(surface), volume, (0.03 + grid) * volume) << grid;
  }
}

// A plate thinner than the grid has no volume left, and no triangles.
TEST(SurfaceThinner, CancelsSheetsThatFallTogether) {
  const Point a{0, 0, 0}, b{1, 0, 0}, c{0, 1, 0}, up{0, 0, 1e-3};
  SurfaceThinner thinner({-1, -1, -1}, 0.1);
  thinner.add({0, {a, b, c}});
  thinner.add({1, {a + up, c + up, b + up}});
  EXPECT_EQ(thinner.num_triangles(), 0U);
}

TEST(SurfaceThinner, PutsPartsTogether) {
  const auto soup = torus(1, 0.05, 120, 60).soup();
  for (const double grid : {0.03, 0.2}) {  // the latter joins sheets across
    SurfaceThinner whole({-2, -2, -2}, grid), together({-2, -2, -2}, grid);
    for (const Triangle& triangle : soup) whole.add(triangle);
    std::size_t next = 0;
    for (const std::size_t end : {soup.size() / 3, soup.size() / 2, soup.size()}) {
      SurfaceThinner some({-2, -2, -2}, grid);
      for (; next < end; ++next) some.add(soup[next]);
      together.add(some.take_part());
      EXPECT_EQ(some.num_vertices() + some.num_triangles(), 0U);
    }
    const ViewSurface expected = whole.take(), surface = together.take();
    EXPECT_TRUE(surface.triangles == expected.triangles);
    ASSERT_EQ(surface.vertices.size(), expected.vertices.size());
    for (std::size_t i = 0; i < surface.vertices.size(); ++i)  // near 0 few digits are left
      EXPECT_LT(max_norm(surface.vertices[i] - expected.vertices[i]), 1e-30);
  }
}

TEST_F(MeshViewTest, ThinsALargeSurface) {
  const Store store = meshed(sphere(1, 59, 120), 0.4, 1000);
  ViewLimits limits;
  limits.max_triangles = 3000;
  limits.max_cells = 10;
  const MeshView view = mesh_view(store, limits);
  EXPECT_GT(view.surface.grid, 0);
  EXPECT_LE(view.surface.triangles.size(), limits.max_triangles);
  EXPECT_GT(view.surface.triangles.size(), limits.max_triangles / 3);
  expect_closed(view.surface);
}

TEST(ViewPlanes, AreAsManyAsThereIsRoomFor) {
  const Box box{{0, 0, 0}, {4, 2, 1}};
  const auto hundred = [](std::span<const ViewPlane> planes) {
    return 100.0 * static_cast<double>(planes.size());
  };
  EXPECT_TRUE(view_planes(box, 299, hundred).empty());
  EXPECT_EQ(view_planes(box, 300, hundred).size(), 3U);
  EXPECT_EQ(view_planes(box, 1000, hundred).size(), 9U);
  EXPECT_EQ(view_planes(box, 1'000'000, hundred).size(), 45U);
  const auto planes = view_planes(box, 300, hundred);
  EXPECT_EQ(planes[0].position, 2);
  EXPECT_EQ(planes[2].position, 0.5);
}

}  // namespace
}  // namespace locvol
