#include "engine/audit/audit.h"

#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <numbers>
#include <string>

#include "engine/shared/cell_quality.h"
#include "tests/engine/audit/audit_of.h"
#include "tests/engine/described.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

constexpr Point kCenter = {2, 2, 2};

HandMadeMesh ball() { return lattice_ball(kCenter, 2.6); }

double volume_of(const HandMadeMesh& mesh) {
  double volume = 0;
  for (const CellIds& cell : mesh.cells) {
    const auto p = mesh.corners(cell);
    volume += dot(p[1] - p[0], cross(p[2] - p[0], p[3] - p[0])) / 6;
  }
  return volume;
}

// A cell with no vertex on the boundary.
std::size_t deep_cell(const HandMadeMesh& mesh) {
  std::set<std::uint64_t> boundary;
  for (const auto& facet : boundary_of(mesh)) boundary.insert(facet.begin(), facet.end());
  const auto deep = std::ranges::find_if(mesh.cells, [&](const CellIds& cell) {
    return std::ranges::none_of(cell, [&](std::uint64_t id) { return boundary.contains(id); });
  });
  EXPECT_NE(deep, mesh.cells.end());
  return static_cast<std::size_t>(deep - mesh.cells.begin());
}

std::uint64_t num_balls_around(const HandMadeMesh& mesh, const Point& q) {
  return static_cast<std::uint64_t>(std::ranges::count_if(mesh.cells, [&](const CellIds& cell) {
    const auto p = mesh.corners(cell);
    return exact_side_of_circumsphere(p[0], p[1], p[2], p[3], q) > 0;
  }));
}

// That kind of violation is found, so often, and no other.
void expect_only(const AuditReport& report, std::uint64_t AuditReport::*count,
                 std::uint64_t expected) {
  EXPECT_EQ(report.*count, expected) << described(report);
  EXPECT_EQ(report.num_violations(), expected) << described(report);
  EXPECT_FALSE(report.is_valid());
  EXPECT_EQ(report.violations.size(), std::min<std::uint64_t>(expected, 3));
}

struct AuditedShape {
  std::string name;
  std::function<bool(int, int, int)> has;
  std::int64_t euler_characteristic;
  std::uint64_t num_components;
};

class ShapeAudit : public testing::TestWithParam<AuditedShape> {};

TEST_P(ShapeAudit, CountsAndTopology) {
  const HandMadeMesh mesh = cubes(3, GetParam().has);
  for (const LinearOctree& octree : octrees()) {
    SCOPED_TRACE(octree.size());
    const AuditReport report = audit_of(mesh, octree);
    EXPECT_TRUE(report.is_valid()) << described(report);
    EXPECT_EQ(report.euler_characteristic, GetParam().euler_characteristic);
    EXPECT_EQ(report.num_components, GetParam().num_components);
    EXPECT_EQ(report.num_cells, mesh.cells.size());
    EXPECT_EQ(report.num_vertices, mesh.used_ids().size());
    EXPECT_EQ(report.num_boundary_facets, mesh.surface.size());
    EXPECT_NEAR(report.volume, static_cast<double>(mesh.cells.size()) / 6, 1e-12);
    EXPECT_NEAR(report.max_circumradius, std::sqrt(3) / 2, 1e-12);
    EXPECT_NEAR(report.max_radius_edge_ratio, std::sqrt(3) / 2, 1e-12);
    EXPECT_NEAR(report.min_dihedral_degrees, 45, 1e-9);
    EXPECT_NEAR(report.max_dihedral_degrees, 90, 1e-9);
    EXPECT_EQ(report.max_surface_distance, 0);
    EXPECT_EQ(report.surface_volume, 1.5);
    EXPECT_EQ(report.surface_euler_characteristic, 2);
    EXPECT_EQ(report.surface_num_components, 1u);
  }
}

INSTANTIATE_TEST_SUITE_P(
    Cubes, ShapeAudit,
    testing::Values(
        AuditedShape{"Block", [](int, int, int) { return true; }, 2, 1},
        AuditedShape{"Tunnel", [](int x, int y, int) { return x != 1 || y != 1; }, 0, 1},
        AuditedShape{"Cavity", [](int x, int y, int z) { return x != 1 || y != 1 || z != 1; }, 4,
                     2},
        AuditedShape{"TwoPlates", [](int x, int, int) { return x != 1; }, 4, 2},
        AuditedShape{"ThreeTunnels",
                     [](int x, int y, int z) { return (x != 1) + (y != 1) + (z != 1) > 1; }, -8,
                     1}),
    [](const auto& shape) { return shape.param.name; });

TEST(Audit, LatticeBallHasItsClosedForms) {
  const HandMadeMesh mesh = ball();
  ASSERT_GT(mesh.cells.size(), 80u);
  for (const LinearOctree& octree : octrees()) {
    SCOPED_TRACE(octree.size());
    const AuditReport report = audit_of(mesh, octree);
    EXPECT_TRUE(report.is_valid()) << described(report);
    EXPECT_NEAR(report.max_circumradius, std::sqrt(5) / 4 * 1.75, 1e-12);
    EXPECT_NEAR(report.max_radius_edge_ratio, std::sqrt(15) / 6, 1e-12);
    EXPECT_NEAR(report.min_dihedral_degrees, 60, 1e-9);
    EXPECT_NEAR(report.max_dihedral_degrees, 90, 1e-9);
    EXPECT_NEAR(report.volume, volume_of(mesh), 1e-10);
    EXPECT_EQ(report.num_components, 1u);
    EXPECT_EQ(report.euler_characteristic, 2);
  }
}

TEST(Audit, CountsCellsBelowTheBoundOnAnglesAndFindsThemNoViolation) {
  const HandMadeMesh mesh = random_delaunay(3, 24);
  double smallest = 180;
  Point place;
  std::uint64_t num_below = 0;
  for (const CellIds& cell : mesh.cells) {
    const auto p = mesh.corners(cell);
    const double angle = quality_of(p).min_dihedral_degrees;
    num_below += angle < 20;
    if (angle >= smallest) continue;
    smallest = angle;
    place = circumsphere_of(p[0], p[1], p[2], p[3]).center;
  }
  ASSERT_GT(num_below, 0u);
  for (const LinearOctree& octree : octrees()) {
    SCOPED_TRACE(octree.size());
    HandMadeStore store(mesh, octree);
    AuditReport report = audit_of(store);
    EXPECT_EQ(report.min_dihedral_bound, 0);
    EXPECT_EQ(report.num_poor_cells, 0u);
    store.min_dihedral = 20;
    report = audit_of(store);
    EXPECT_TRUE(report.is_valid()) << described(report);
    EXPECT_EQ(report.min_dihedral_bound, 20);
    EXPECT_EQ(report.num_poor_cells, num_below);
    EXPECT_NEAR(report.min_dihedral_degrees, smallest, 1e-6);
    EXPECT_LT(norm(report.worst_place - place), 1e-6 * mesh.size);
    EXPECT_TRUE(report.worst_leaf.is_valid());
  }
}

TEST(Audit, DoesNotTakeRoundingForAPoorCell) {
  HandMadeStore store(ball(), mixed_octree());  // of cells with 60 degrees
  store.min_dihedral = 60;
  EXPECT_EQ(audit_of(store).num_poor_cells, 0u);
  store.min_dihedral = 60.001;
  EXPECT_EQ(audit_of(store).num_poor_cells, ball().cells.size());
}

TEST(Audit, AcceptsTheDelaunayTriangulationOfRandomPoints) {
  for (unsigned seed = 1; seed <= 6; ++seed) {
    const HandMadeMesh mesh = random_delaunay(seed, 24);
    for (const LinearOctree& octree : octrees()) {
      SCOPED_TRACE("seed " + std::to_string(seed) + ", leaves " + std::to_string(octree.size()));
      const AuditReport report = audit_of(mesh, octree);
      EXPECT_TRUE(report.is_valid()) << described(report);
      EXPECT_EQ(report.num_cells, mesh.cells.size());
      EXPECT_EQ(report.num_vertices, 24u);
      EXPECT_EQ(report.euler_characteristic, 2);
      EXPECT_EQ(report.num_boundary_facets, 2 * report.num_boundary_vertices - 4);
      EXPECT_NEAR(report.volume, volume_of(mesh), 1e-9);
      EXPECT_LT(report.max_circumradius, 1);
    }
  }
}

TEST(Audit, ScalingByTwoScalesTheVolumeAlone) {
  HandMadeMesh mesh = lattice_ball({0, 0, 0}, 2);
  const AuditReport once = audit_of(mesh, LinearOctree::uniform(2));
  for (MeshPoint& p : mesh.points) p.position = 2 * p.position;
  for (Triangle& t : mesh.surface) {
    for (Point& corner : t.corners) corner = 2 * corner;
  }
  mesh.size *= 2;
  // The ball reaches to -4 and 4 now, so the root is moved along by as much.
  for (MeshPoint& p : mesh.points) p.position = p.position + kCenter;
  for (Triangle& t : mesh.surface) {
    for (Point& corner : t.corners) corner = corner + kCenter;
  }
  const AuditReport twice = audit_of(mesh, LinearOctree::uniform(2));
  EXPECT_TRUE(twice.is_valid()) << described(twice);
  EXPECT_NEAR(twice.volume, 8 * once.volume, 1e-9);
  EXPECT_NEAR(twice.max_circumradius, once.max_circumradius, 1e-12);
  EXPECT_EQ(twice.num_boundary_facets, once.num_boundary_facets);
}

TEST(Audit, AnEmptyMeshIsNotValid) {
  const AuditReport report = audit_of(HandMadeMesh{}, LinearOctree::uniform(1));
  EXPECT_EQ(report.num_violations(), 0u) << described(report);
  EXPECT_EQ(report.num_cells, 0u);
  EXPECT_FALSE(report.is_valid());
}

TEST(Audit, ListsUnresolvedSitesWithoutCallingThemViolations) {
  HandMadeStore store(ball(), mixed_octree());
  store.leaves.begin()->second.unresolved.sites = {{3, kCenter, 0.5}, {4, kCenter, 0.1}};
  const AuditReport report = audit_of(store);
  EXPECT_EQ(report.num_unresolved, 2u);
  EXPECT_TRUE(report.is_valid()) << described(report);
}

TEST(AuditDamage, SwappedVertices) {
  HandMadeMesh mesh = ball();
  for (const std::size_t i : {0u, 11u, 40u}) std::swap(mesh.cells[i][1], mesh.cells[i][2]);
  expect_only(audit_of(mesh), &AuditReport::num_misoriented_cells, 3);
}

TEST(AuditDamage, FlatCell) {
  HandMadeMesh mesh = cubes(2, [](int, int, int) { return true; });
  const auto id = [&](const Point& p) {
    return std::ranges::find(mesh.points, p, &MeshPoint::position)->id;
  };
  mesh.cells.push_back({id({0, 0, 0}), id({1, 0, 0}), id({1, 1, 0}), id({0, 1, 0})});
  expect_only(audit_of(mesh), &AuditReport::num_misoriented_cells, 1);
}

TEST(AuditDamage, LostCellLeavesAHoleOffTheSurface) {
  HandMadeMesh mesh = lattice_ball(kCenter, 3.2);
  mesh.cells.erase(mesh.cells.begin() + static_cast<std::ptrdiff_t>(deep_cell(mesh)));
  for (const LinearOctree& octree : octrees()) {
    const AuditReport report = audit_of(mesh, octree);
    expect_only(report, &AuditReport::num_off_surface_vertices, 4);
    EXPECT_EQ(report.num_components, 2u);
    EXPECT_EQ(report.euler_characteristic, 4);
    EXPECT_GT(report.max_surface_distance, 0.1);
  }
}

TEST(AuditDamage, RepeatedCell) {
  HandMadeMesh mesh = lattice_ball(kCenter, 3.2);
  mesh.cells.push_back(mesh.cells[deep_cell(mesh)]);
  for (const LinearOctree& octree : octrees()) {
    const AuditReport report = audit_of(mesh, octree);
    EXPECT_EQ(report.num_repeated_cells, 1u) << described(report);
    EXPECT_EQ(report.num_overused_facets, 4u) << described(report);
    EXPECT_EQ(report.num_violations(), 5u) << described(report);
  }
}

TEST(AuditDamage, OverlappingCell) {
  HandMadeMesh mesh = lattice_ball(kCenter, 3.2);
  const CellIds cell = mesh.cells[deep_cell(mesh)];
  // Another apex above the same facet.
  const auto p = mesh.corners(cell);
  for (const std::uint64_t id : mesh.used_ids()) {
    const Point q = mesh.point(id).position;
    if (id == cell[3] || exact_orientation(p[0], p[1], p[2], q) <= 0) continue;
    if (squared_distance(q, p[0]) > 4) continue;
    mesh.cells.push_back({cell[0], cell[1], cell[2], id});
    break;
  }
  for (const LinearOctree& octree : octrees()) {
    const AuditReport report = audit_of(mesh, octree);
    EXPECT_GE(report.num_overused_facets, 1u) << described(report);
    EXPECT_EQ(report.num_repeated_cells, 0u);
  }
}

TEST(AuditDamage, TwoCellsOnOneSideOfABoundaryFacet) {
  MeshBuilder builder;
  builder.add_cell({Point{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0.2, 0.2, 0.9}});
  builder.add_cell({Point{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0.6, 0.6, 0.8}});
  const AuditReport report = audit_of(builder.finish(1));
  EXPECT_EQ(report.num_overused_facets, 1u) << described(report);
}

TEST(AuditDamage, VertexMovedOffTheSurface) {
  HandMadeMesh mesh = ball();
  const std::uint64_t id = boundary_of(mesh).front()[0];
  Point& position = mesh.point(id).position;
  position = position + 1e-6 * (position - kCenter);
  for (const LinearOctree& octree : octrees()) {
    const AuditReport report = audit_of(mesh, octree);
    expect_only(report, &AuditReport::num_off_surface_vertices, 1);
    EXPECT_GT(report.max_surface_distance, 1e-7);
    EXPECT_LT(report.max_surface_distance, 1e-5);
  }
}

TEST(AuditDamage, VertexMovedByARoundingErrorIsOnTheSurface) {
  HandMadeMesh mesh = ball();
  Point& position = mesh.point(boundary_of(mesh).front()[0]).position;
  position.x = std::nextafter(position.x, 10);
  EXPECT_TRUE(audit_of(mesh).is_valid());
}

TEST(AuditDamage, PointInsideCircumballs) {
  for (unsigned seed = 1; seed <= 8; ++seed) {
    HandMadeMesh mesh = ball();
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> offset(-1.5, 1.5);
    const Point q = kCenter + Point{offset(random), offset(random), offset(random)};
    mesh.points.push_back({mesh.next_id(), q, PointKind::kVolume});
    for (const LinearOctree& octree : octrees()) {
      SCOPED_TRACE("seed " + std::to_string(seed));
      expect_only(audit_of(mesh, octree), &AuditReport::num_nonempty_circumballs,
                  num_balls_around(mesh, q));
    }
  }
}

TEST(AuditDamage, PointAHairInsideOrOutsideACircumball) {
  const HandMadeMesh block = cubes(2, [](int, int, int) { return true; });
  // The ball of each outer cube reaches (√3 - 1)/2 beyond its facets.
  const double beyond = (std::sqrt(3) - 1) / 2;
  for (const double hair : {-1e-13, 1e-13}) {
    HandMadeMesh mesh = block;
    const Point q = {0.5, 0.5, 2 + beyond + hair};
    mesh.points.push_back({mesh.next_id(), q, PointKind::kVolume});
    const std::uint64_t expected = num_balls_around(mesh, q);
    EXPECT_EQ(expected, hair < 0 ? 6u : 0u);
    EXPECT_EQ(audit_of(mesh).num_nonempty_circumballs, expected);
  }
}

TEST(AuditDamage, UnusedPointOutsideAllCircumballsIsNone) {
  HandMadeMesh mesh = ball();
  mesh.points.push_back({mesh.next_id(), {5.9, 5.9, 5.9}, PointKind::kVolume});
  const AuditReport report = audit_of(mesh);
  EXPECT_TRUE(report.is_valid()) << described(report);
  EXPECT_EQ(report.num_vertices, mesh.points.size() - 1);
}

TEST(AuditDamage, FacetsThatAreListedWrong) {
  using Facets = std::map<MortonKey, LeafFacets>;
  for (const LinearOctree& octree : octrees()) {
    const HandMadeStore records(ball(), octree);
    const auto first_of = [](Facets& facets) -> std::vector<MeshFacet>& {
      return std::ranges::find_if(facets, [](const auto& f) { return !f.second.facets.empty(); })
          ->second.facets;
    };
    const auto num_wrong = [&](const auto& damage) {
      Facets facets = records.boundary_facets();
      damage(facets);
      const TempDir dir;
      const AuditReport report = audit(records.write(dir / "store", facets));
      EXPECT_EQ(report.num_violations(), report.num_wrong_facets) << described(report);
      return report.num_wrong_facets;
    };
    EXPECT_EQ(num_wrong([](Facets&) {}), 0U);
    EXPECT_EQ(num_wrong([&](Facets& facets) { first_of(facets).pop_back(); }), 1U);
    EXPECT_EQ(num_wrong([&](Facets& facets) {
                std::swap(first_of(facets)[0].vertices[1], first_of(facets)[0].vertices[2]);
              }),
              2U);
    EXPECT_EQ(num_wrong([&](Facets& facets) { first_of(facets)[0].labels.before = 1; }), 2U);
    EXPECT_EQ(
        num_wrong([&](Facets& facets) { first_of(facets).push_back(first_of(facets).front()); }),
        1U);
    EXPECT_EQ(num_wrong([&](Facets& facets) {
                const auto& [leaf, list] = *facets.begin();
                const MortonKey other = octree.leaves().back() == leaf ? octree.leaves().front()
                                                                       : octree.leaves().back();
                if (other != leaf) std::swap(facets[leaf], facets[other]);
              }) > 0,
              octree.size() > 1);
  }
}

TEST(AuditDamage, PinchedVertex) {
  const HandMadeMesh mesh = cubes(2, [](int x, int y, int z) { return x == y && y == z; });
  for (const LinearOctree& octree : octrees()) {
    const AuditReport report = audit_of(mesh, octree);
    expect_only(report, &AuditReport::num_bad_boundary_vertices, 1);
    EXPECT_EQ(report.num_components, 1u);
    EXPECT_EQ(report.euler_characteristic, 3);
  }
}

TEST(AuditDamage, PinchedEdge) {
  const HandMadeMesh mesh = cubes(2, [](int x, int y, int z) { return x == y && z == 0; });
  for (const LinearOctree& octree : octrees()) {
    const AuditReport report = audit_of(mesh, octree);
    EXPECT_EQ(report.num_bad_boundary_edges, 1u) << described(report);
    EXPECT_EQ(report.num_bad_boundary_vertices, 2u) << described(report);
    EXPECT_EQ(report.num_violations(), 3u) << described(report);
  }
}

TEST(AuditDamage, LargeCells) {
  HandMadeMesh mesh = ball();
  mesh.size = 0.97;
  expect_only(audit_of(mesh), &AuditReport::num_large_cells, mesh.cells.size());
}

TEST(AuditDamage, BadlyShapedCells) {
  HandMadeMesh mesh = ball();
  mesh.radius_edge_bound = 0.64;
  expect_only(audit_of(mesh), &AuditReport::num_badly_shaped_cells, mesh.cells.size());
}

TEST(AuditDamage, UnknownVertex) {
  HandMadeMesh mesh = ball();
  CellIds& cell = mesh.cells.front();
  const auto other =
      std::ranges::find_if(cell, [&](std::uint64_t id) { return id != mesh.smallest(cell); });
  *other = 1000000;
  const AuditReport report = audit_of(mesh);
  EXPECT_EQ(report.num_unknown_vertices, 1u) << described(report);
  EXPECT_EQ(report.num_cells, mesh.cells.size());
}

TEST(AuditDamage, PointInTheWrongLeaf) {
  HandMadeStore store(ball(), LinearOctree::uniform(2));
  std::vector<LeafPoints*> filled;
  for (auto& [key, leaf] : store.leaves) {
    if (!leaf.points.points.empty()) filled.push_back(&leaf.points);
  }
  ASSERT_GE(filled.size(), 2u);
  filled[1]->points.push_back(filled[0]->points.back());
  filled[0]->points.pop_back();
  std::ranges::sort(filled[1]->points, {}, &MeshPoint::id);
  EXPECT_EQ(audit_of(store).num_misplaced_points, 1u);
}

TEST(AuditDamage, PointThatIsNoNumber) {
  HandMadeStore store(ball(), mixed_octree());
  for (auto& [key, leaf] : store.leaves) {
    if (leaf.points.points.empty()) continue;
    leaf.points.points[0].position.y = std::numeric_limits<double>::quiet_NaN();
    break;
  }
  const AuditReport report = audit_of(store);
  EXPECT_EQ(report.num_misplaced_points, 1u);
  EXPECT_GE(report.num_unknown_vertices, 1u);
}

TEST(AuditDamage, CellInTheWrongLeaf) {
  const HandMadeMesh mesh = ball();
  HandMadeStore store(mesh, LinearOctree::uniform(1));
  auto& first = store.leaves.begin()->second.cells;
  auto& second = std::next(store.leaves.begin())->second.cells;
  ASSERT_FALSE(first.cells.empty());
  const auto ids_of = [](const LeafCells& cells) {
    std::vector<CellIds> ids;
    for (const auto& c : cells.cells) {
      ids.push_back(
          {cells.vertices[c[0]], cells.vertices[c[1]], cells.vertices[c[2]], cells.vertices[c[3]]});
    }
    return ids;
  };
  std::vector<CellIds> left = ids_of(first), moved = ids_of(second);
  moved.push_back(left.back());
  left.pop_back();
  first = HandMadeStore::indexed(left);
  second = HandMadeStore::indexed(moved);
  expect_only(audit_of(store), &AuditReport::num_misplaced_cells, 1);
}

TEST(AuditDamage, RepeatedIdAndRepeatedPosition) {
  const HandMadeMesh mesh = ball();
  const MeshPoint used = mesh.point(mesh.cells[0][0]);
  HandMadeMesh same_position = mesh;
  same_position.points.push_back({mesh.next_id(), used.position, PointKind::kVolume});
  for (const LinearOctree& octree : octrees()) {
    expect_only(audit_of(same_position, octree), &AuditReport::num_repeated_points, 1);
  }
  HandMadeMesh same_id = mesh;
  same_id.points.push_back({mesh.next_id(), {5.9, 5.9, 5.9}, PointKind::kVolume});
  same_id.points.push_back({mesh.next_id(), {5.8, 5.9, 5.9}, PointKind::kVolume});
  for (const LinearOctree& octree : octrees()) {
    expect_only(audit_of(same_id, octree), &AuditReport::num_repeated_points, 1);
  }
}

TEST(AuditDamage, UnfinishedRun) {
  HandMadeStore store(ball(), mixed_octree());
  store.phase = Phase::kRefine;
  expect_only(audit_of(store), &AuditReport::num_run_faults, 1);
  store.phase = Phase::kDone;
  store.queue.push_back({{3, 1}, store.leaves.begin()->first});
  expect_only(audit_of(store), &AuditReport::num_run_faults, 1);
}

TEST(AuditDamage, LeavesThatDoNotTileTheRoot) {
  const HandMadeStore whole(ball(), mixed_octree());
  for (std::size_t gap = 0; gap < whole.leaves.size(); ++gap) {
    HandMadeStore store = whole;
    store.leaves.erase(std::next(store.leaves.begin(), static_cast<std::ptrdiff_t>(gap)));
    expect_only(audit_of(store), &AuditReport::num_run_faults, 1);
  }
  HandMadeStore overlapping = whole;
  overlapping.leaves[MortonKey::root()] = {};
  expect_only(audit_of(overlapping), &AuditReport::num_run_faults, 1);
}

TEST(AuditDamage, EmptyStore) {
  const TempDir dir;
  const Store store = Store::open(dir / "store", {.create = true, .is_durable = false});
  expect_only(audit(store), &AuditReport::num_run_faults, 1);
}

TEST(Predicates, CircumsphereOfNearlyFlatCells) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> coordinate(-1, 1);
  for (int i = 0; i < 2000; ++i) {
    // Four points on a sphere of radius 1 around a known center, ever closer to one plane.
    const Point center = {coordinate(random), coordinate(random), coordinate(random)};
    const double height = std::ldexp(0.5, -(i % 20));
    std::array<Point, 4> p;
    for (std::size_t k = 0; k < 4; ++k) {
      const double angle =
          std::numbers::pi * (0.5 * static_cast<double>(k) + 0.3 * coordinate(random));
      const double z = 0.3 + (k % 2 == 0 ? height : 0.0) * 0.1;
      const double r = std::sqrt(1 - z * z);
      p[k] = center + Point{r * std::cos(angle), r * std::sin(angle), z};
    }
    const Circumsphere ball = circumsphere_of(p[0], p[1], p[2], p[3]);
    // The input is rounded to 1e-16, which a flat cell magnifies.
    EXPECT_NEAR(ball.radius, 1, 1e-13 / height) << i;
    for (const Point& corner : p) {
      EXPECT_NEAR(norm(corner - ball.center), ball.radius, 1e-9 * ball.radius) << i;
    }
  }
  EXPECT_EQ(circumsphere_of({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}).radius,
            std::numeric_limits<double>::infinity());
}

// Of a sample only faults in its leaves are seen.
TEST(Audit, ChecksASample) {
  const TempDir dir;
  const AuditReport all = audit_of(ball());
  EXPECT_FALSE(all.is_sample());
  const Store store = HandMadeStore(ball(), mixed_octree()).write(dir / "store");
  const AuditReport some = audit(store, {}, 2);
  EXPECT_TRUE(some.is_sample());
  EXPECT_EQ(some.num_leaves, all.num_checked_leaves);
  EXPECT_GT(some.num_checked_leaves, 0U);
  EXPECT_TRUE(some.is_valid()) << described(some);
  EXPECT_LT(some.num_cells, all.num_cells);
  EXPECT_GT(some.num_cells, 0U);

  int num_seen = 0, num_unseen = 0;
  const std::size_t num_cells = ball().cells.size();
  for (std::size_t i = 0; i < num_cells; i += num_cells / 20) {
    HandMadeMesh mesh = ball();
    std::swap(mesh.cells[i][0], mesh.cells[i][1]);
    const std::string name = "store" + std::to_string(i);
    const Store damaged = HandMadeStore(mesh, mixed_octree()).write(dir / name);
    EXPECT_EQ(audit(damaged).num_misoriented_cells, 1U);
    const AuditReport found = audit(damaged, {}, 2);
    EXPECT_EQ(found.is_valid(), found.num_violations() == 0);
    ++(found.num_misoriented_cells == 1 ? num_seen : num_unseen);
  }
  EXPECT_GT(num_seen, 0);
  EXPECT_GT(num_unseen, 0);
}

TEST(Predicates, DistancesToATriangle) {
  const Triangle t = {0, {Point{0, 0, 0}, {4, 0, 0}, {0, 4, 0}}};
  const std::vector<std::pair<Point, double>> known = {{{1, 1, 2}, 2},
                                                       {{1, 1, 0}, 0},
                                                       {{-3, -4, 0}, 5},
                                                       {{2, -1, 0}, 1},
                                                       {{4, 4, 0}, 2 * std::sqrt(2)},
                                                       {{7, 0, 4}, 5},
                                                       {{-1, 2, 1}, std::sqrt(2)}};
  for (const auto& [p, distance] : known) {
    EXPECT_NEAR(distance_to_triangle(p, t), distance, 1e-15);
    EXPECT_NEAR(exact_distance_to_triangle(p, t), distance, 1e-15);
  }
  std::mt19937_64 random(9);
  std::uniform_real_distribution<double> coordinate(-1, 1);
  const auto any = [&] {
    return Point{coordinate(random), coordinate(random), coordinate(random)};
  };
  for (int i = 0; i < 3000; ++i) {
    const Triangle triangle = {0, {any(), any(), any()}};
    const Point p = any();
    EXPECT_NEAR(distance_to_triangle(p, triangle), exact_distance_to_triangle(p, triangle), 1e-12);
  }
}

}  // namespace
}  // namespace locvol
