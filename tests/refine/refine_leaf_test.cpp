#include "refine/refine_leaf.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <numbers>
#include <numeric>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "refine/cover_leaf.h"
#include "tests/refine/brute_force.h"
#include "tests/refine/domain_pieces.h"
#include "tests/refine/lattice_points.h"
#include "tests/refine/mesh_checker.h"
#include "tests/refine/shapes.h"

namespace locvol {
namespace {

using shapes::Mesh;
using shapes::Random;
using shapes::uniform;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// A surface in one leaf that holds it all.
struct World {
  World(Mesh m, double lambda) : mesh(std::move(m)), size(lambda) {}

  Box region() const { return shapes::bounding_box(mesh).expanded(0.31); }
  DomainPiece domain() const { return whole_piece(region(), mesh); }

  LeafInput leaf(std::vector<MeshPoint> own) const {
    LeafInput input;
    input.criteria = Criteria::of_paper(size, 2, 1e-3);
    input.box = region();
    input.own = std::move(own);
    input.domain = domain();
    input.max_insertions = 20000;
    return input;
  }

  Mesh mesh;
  double size;
};

void append(std::vector<MeshPoint>& points, const Point& p, PointKind kind) {
  points.push_back({points.size(), p, kind});
}

void append(std::vector<MeshPoint>& points, const std::vector<Point>& some, PointKind kind) {
  for (const Point& p : some) append(points, p, kind);
}

std::vector<MeshPoint> random_surface_points(const World& world, std::size_t num, unsigned seed) {
  Random random(seed);
  std::vector<MeshPoint> points;
  append(points, shapes::random_points_on(world.mesh, num, random), PointKind::kSurface);
  return points;
}

// The surface, and on request the interior, as cover mode fills them.
std::vector<MeshPoint> covering_points(const World& world, bool with_lattice) {
  const Box region = world.region();
  const Lattice lattice = lattice_around(region, world.size);
  const CoverPoints cover = cover_leaf({world.size, 7, lattice, region, world.domain(), {}});
  std::vector<MeshPoint> points;
  append(points, cover.samples, PointKind::kSurface);
  if (with_lattice)
    append(points, positions(lattice, lattice_sites(cover, lattice.sites_in(region))),
           PointKind::kLattice);
  return points;
}

// P after the visit, and the cells as indices into it.
struct Refined {
  LeafDelta delta;
  std::vector<MeshPoint> points;
  std::vector<IndexedCell> cells;

  std::vector<CellKey> keys() const {
    std::vector<CellKey> keys;
    for (const auto& [a, b, c, d] : cells)
      keys.push_back(
          key_of({points[a].position, points[b].position, points[c].position, points[d].position}));
    std::ranges::sort(keys);
    return keys;
  }
  std::uint64_t num_insertions() const {
    const auto& counts = delta.stats.insertions;
    return std::accumulate(counts.begin(), counts.end(), std::uint64_t{0});
  }
};

Refined refined(const LeafInput& input, const std::vector<MeshPoint>& unloaded = {},
                const PointIndex* all_points = nullptr) {
  Refined result{refine_leaf(input, {}, {.points = all_points}), {}, {}};
  std::set<std::uint64_t> deleted;
  for (const MeshPoint& p : result.delta.deleted) deleted.insert(p.id);
  std::map<VertexRef, std::size_t> index;
  const auto keep = [&](VertexRef ref, const MeshPoint& p) {
    index[ref] = result.points.size();
    result.points.push_back(p);
  };
  for (const auto& some : {input.own, input.ghosts, unloaded})
    for (const MeshPoint& p : some)
      if (!deleted.contains(p.id)) keep(p.id, p);
  for (std::size_t i = 0; i < result.delta.inserted.size(); ++i) {
    const InsertedPoint& p = result.delta.inserted[i];
    if (!p.is_deleted) keep(kNewPoint | i, {1000000 + i, p.position, p.kind});
  }
  const CellList& cells = result.delta.cells;
  std::set<VertexRef> used;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const auto& [a, b, c, d] = cells.refs(i);
    result.cells.push_back({index.at(a), index.at(b), index.at(c), index.at(d)});
    used.insert({a, b, c, d});
  }
  EXPECT_TRUE(std::ranges::equal(cells.vertices, used)) << "all that are used, in order";
  EXPECT_TRUE(std::ranges::is_sorted(cells.cells));
  return result;
}

int count(const std::vector<BrokenCondition>& broken, int condition) {
  return int(std::ranges::count(broken, condition, &BrokenCondition::condition));
}

int num_broken(const World& world, const std::vector<MeshPoint>& points, int condition) {
  const MeshChecker checker(points, world.mesh);
  return count(checker.broken_conditions(world.size, 2), condition);
}

// The result is the restricted Delaunay triangulation, in the very terms of
// refine/ALGORITHM.md, "Conditions".
void expect_good(const World& world, const Refined& result, long euler_characteristic) {
  EXPECT_FALSE(result.delta.is_overfull);
  EXPECT_TRUE(result.delta.unresolved.empty()) << result.delta.unresolved.size();
  const MeshChecker checker(result.points, world.mesh);
  EXPECT_EQ(result.keys(), checker.inside_cells());
  for (const auto& [a, b, c, d] : result.cells)
    ASSERT_EQ(brute_force::orientation(result.points[a].position, result.points[b].position,
                                       result.points[c].position, result.points[d].position),
              1);
  for (const auto& [condition, position, radius] : checker.broken_conditions(world.size, 2))
    ADD_FAILURE() << "C" << condition << " at " << position.x << ' ' << position.y << ' '
                  << position.z << ", radius " << radius;
  EXPECT_EQ(manifold_fault(result.cells, result.points), "");
  EXPECT_EQ(boundary_euler_characteristic(result.cells), euler_characteristic);
}

void expect_same(const LeafDelta& a, const LeafDelta& b) {
  ASSERT_EQ(a.inserted.size(), b.inserted.size());
  for (std::size_t i = 0; i < a.inserted.size(); ++i) {
    EXPECT_EQ(a.inserted[i].position, b.inserted[i].position);
    EXPECT_EQ(a.inserted[i].kind, b.inserted[i].kind);
    EXPECT_EQ(a.inserted[i].is_deleted, b.inserted[i].is_deleted);
  }
  EXPECT_EQ(a.deleted, b.deleted);
  EXPECT_EQ(a.cells, b.cells);
  ASSERT_EQ(a.unresolved.size(), b.unresolved.size());
  for (std::size_t i = 0; i < a.unresolved.size(); ++i) {
    EXPECT_EQ(a.unresolved[i].condition, b.unresolved[i].condition);
    EXPECT_EQ(a.unresolved[i].position, b.unresolved[i].position);
    EXPECT_EQ(a.unresolved[i].radius, b.unresolved[i].radius);
  }
  EXPECT_EQ(a.stats.insertions, b.stats.insertions);
  EXPECT_EQ(a.stats.deletions, b.stats.deletions);
  EXPECT_EQ(a.stats.points_added, b.stats.points_added);
  EXPECT_EQ(a.stats.cells_made, b.stats.cells_made);
  EXPECT_EQ(a.is_overfull, b.is_overfull);
}

World sphere(double size) { return {shapes::icosphere({0.03, -0.02, 0.05}, 1, 3), size}; }

// ---- Each condition, violated on purpose

TEST(RefineLeaf, RestoresC1OnASparselySampledSphere) {
  const World world = sphere(0.4);
  const auto points = random_surface_points(world, 20, 41);
  ASSERT_GT(num_broken(world, points, 1), 0);
  const Refined result = refined(world.leaf(points));
  EXPECT_GT(result.delta.stats.insertions[0], 0u);
  expect_good(world, result, 2);
}

TEST(RefineLeaf, RestoresC2AndDeletesVolumePointsBesideTheSurface) {
  const World world = sphere(0.4);
  auto points = covering_points(world, true);
  Random random(42);
  for (const Point& p : shapes::random_points_on(world.mesh, 40, random))
    append(points, Point{0.03, -0.02, 0.05} + 0.95 * (p - Point{0.03, -0.02, 0.05}),
           PointKind::kVolume);
  ASSERT_GT(num_broken(world, points, 2), 0);
  const Refined result = refined(world.leaf(points));
  EXPECT_GT(result.delta.stats.insertions[1], 0u);
  EXPECT_GT(result.delta.stats.deletions, 0u);
  EXPECT_FALSE(result.delta.deleted.empty());
  for (const MeshPoint& p : result.delta.deleted) EXPECT_EQ(p.kind, PointKind::kVolume);
  expect_good(world, result, 2);
}

TEST(RefineLeaf, DeletesItsOwnInsertionsToo) {
  const World world{shapes::torus(1, 0.42, 48, 24), 0.4};
  bool is_any_deleted = false;
  for (unsigned seed = 0; seed < 6; ++seed) {
    const Refined result = refined(world.leaf(random_surface_points(world, 25, seed)));
    is_any_deleted |= std::ranges::any_of(result.delta.inserted, &InsertedPoint::is_deleted);
    expect_good(world, result, 0);
  }
  EXPECT_TRUE(is_any_deleted);
}

// A tube thinner than λ: few points keep C1, but their facets pinch it or miss a sheet.
World thin_torus() { return {shapes::torus(1, 0.3, 48, 16), 0.65}; }

TEST(RefineLeaf, RestoresC3AndC4OnAThinTorus) {
  const World world = thin_torus();
  std::array<std::uint64_t, 7> insertions{};
  std::array<int, 2> num_broken_before{};
  for (unsigned seed = 0; seed < 10; ++seed) {
    const auto points = random_surface_points(world, 12 + 3 * seed, seed);
    num_broken_before[0] += num_broken(world, points, 3);
    num_broken_before[1] += num_broken(world, points, 4);
    const Refined result = refined(world.leaf(points));
    for (std::size_t i = 0; i < 6; ++i) insertions[i] += result.delta.stats.insertions[i];
    SCOPED_TRACE(seed);
    expect_good(world, result, 0);
  }
  EXPECT_GT(std::min(num_broken_before[0], num_broken_before[1]), 0);
  EXPECT_GT(insertions[2], 0u);
  EXPECT_GT(insertions[3], 0u);
}

// Both sheets of a hollow ball are nearer to each other than λ.
TEST(RefineLeaf, RestoresC4BetweenCloseSheets) {
  const World world{shapes::nested_shells(1, 0.85, 3), 0.3};
  const auto points = covering_points(world, false);
  ASSERT_GT(num_broken(world, points, 4), 0);
  const Refined result = refined(world.leaf(points));
  EXPECT_GT(result.delta.stats.insertions[3], 0u);
  expect_good(world, result, 4);
}

TEST(RefineLeaf, RestoresC3AndC4InAThinPlate) {
  const World world{shapes::thin_plate(1, 0.2), 0.45};
  const auto points = covering_points(world, false);
  const Refined result = refined(world.leaf(points));
  EXPECT_GT(result.delta.stats.insertions[2] + result.delta.stats.insertions[3], 0u);
  expect_good(world, result, 2);
}

TEST(RefineLeaf, RestoresC5WhereTheInteriorIsEmpty) {
  const World world = sphere(0.3);
  const auto points = covering_points(world, false);
  ASSERT_GT(num_broken(world, points, 5), 0);
  const Refined result = refined(world.leaf(points));
  EXPECT_GT(result.delta.stats.insertions[4], 0u);
  expect_good(world, result, 2);
}

TEST(RefineLeaf, RestoresC6AroundTwoClosePoints) {
  const World world = sphere(0.3);
  auto points = covering_points(world, true);
  append(points, {0.1, 0.2, 0.1}, PointKind::kLattice);
  append(points, {0.1 + 0.05 * world.size, 0.2, 0.1}, PointKind::kLattice);
  ASSERT_GT(num_broken(world, points, 6), 0);
  const Refined result = refined(world.leaf(points));
  EXPECT_GT(result.delta.stats.insertions[5], 0u);
  expect_good(world, result, 2);
}

// Circumcenters close to the surface give way to surface balls' centers, and that may leave the
// cell as it was: it is still to be restored.
TEST(RefineLeaf, RestoresC6WhoseCureFirstGoesToASurfaceBall) {
  const World world{shapes::torus(1, 0.42, 48, 24), 0.4};
  for (unsigned seed = 0; seed < 4; ++seed) {
    auto with_close_points = covering_points(world, true);
    Random random(seed);
    append(with_close_points, shapes::random_points_on(world.mesh, 30, random),
           PointKind::kSurface);
    ASSERT_GT(num_broken(world, with_close_points, 6), 0);
    const Refined result = refined(world.leaf(with_close_points));
    SCOPED_TRACE(seed);
    expect_good(world, result, 0);
  }
}

TEST(RefineLeaf, LeavesAGoodPointSetAlone) {
  const World world = sphere(0.3);
  const Refined first = refined(world.leaf(covering_points(world, true)));
  std::vector<MeshPoint> points = first.points;
  for (std::size_t i = 0; i < points.size(); ++i) points[i].id = i;
  const Refined second = refined(world.leaf(points));
  EXPECT_EQ(second.num_insertions(), 0u);
  EXPECT_TRUE(second.delta.deleted.empty());
  EXPECT_EQ(second.keys(), first.keys());
}

// Right angles are within what C1 to C6 can do.
TEST(RefineLeaf, MeshesABox) {
  const World world{shapes::box({{-0.5, -0.4, -0.3}, {0.5, 0.4, 0.3}}), 0.15};
  const Refined result = refined(world.leaf(covering_points(world, true)));
  expect_good(world, result, 2);
}

TEST(RefineLeaf, CountsWhatItDoes) {
  const World world = sphere(0.4);
  const Refined result = refined(world.leaf(random_surface_points(world, 20, 43)));
  EXPECT_EQ(result.num_insertions(), result.delta.inserted.size());
  const auto num_gone = std::ranges::count_if(result.delta.inserted, &InsertedPoint::is_deleted);
  EXPECT_EQ(result.delta.stats.deletions, result.delta.deleted.size() + std::size_t(num_gone));
  EXPECT_EQ(result.delta.stats.points_added, 0u);
  EXPECT_GE(result.delta.stats.cells_made, result.delta.cells.size());
}

// ---- The trace

using Action = RefineStep::Action;

std::vector<RefineStep> traced(const LeafInput& input, LeafDelta& delta,
                               const PointIndex* all_points = nullptr) {
  std::vector<RefineStep> steps;
  const auto note = [&](const RefineStep& step) { steps.push_back(step); };
  delta = refine_leaf(input, {.on_step = note}, {.points = all_points});
  return steps;
}

std::uint64_t count(const std::vector<RefineStep>& steps, Action action) {
  return static_cast<std::uint64_t>(std::ranges::count(steps, action, &RefineStep::action));
}

TEST(RefineLeafTrace, TellsEachInsertionAndDeletionInOrder) {
  const World world{shapes::torus(1, 0.42, 48, 24), 0.4};
  std::uint64_t num_deleted = 0;
  for (unsigned seed = 0; seed < 6; ++seed) {
    const LeafInput input = world.leaf(random_surface_points(world, 25, seed));
    LeafDelta delta;
    const auto steps = traced(input, delta);
    EXPECT_EQ(delta.cells, refine_leaf(input).cells);
    std::array<std::uint64_t, 7> insertions{};
    std::size_t next = 0;
    for (const RefineStep& step : steps) {
      ASSERT_TRUE(1 <= step.condition && step.condition <= 6);
      if (step.action == Action::kDelete) {
        ++num_deleted;
        EXPECT_TRUE(is_deletable(step.kind));
        if (step.point & kNewPoint) {
          EXPECT_EQ(step.position, delta.inserted.at(step.point & ~kNewPoint).position);
        }
        continue;
      }
      ASSERT_EQ(step.action, Action::kInsert);
      ASSERT_EQ(step.point, kNewPoint | next);
      EXPECT_EQ(step.position, delta.inserted.at(next).position);
      EXPECT_EQ(step.kind, delta.inserted.at(next).kind);
      EXPECT_TRUE(step.condition > 1 || step.radius >= world.size);
      ++insertions[static_cast<std::size_t>(step.condition - 1)];
      ++next;
    }
    EXPECT_EQ(next, delta.inserted.size());
    EXPECT_EQ(insertions, delta.stats.insertions);
    EXPECT_EQ(count(steps, Action::kDelete), delta.stats.deletions);
  }
  EXPECT_GT(num_deleted, 0u);
}

TEST(RefineLeafTrace, TellsWhatTheFloorForbids) {
  const World world = sphere(0.3);
  auto points = covering_points(world, true);
  append(points, {0.1, 0.2, 0.1}, PointKind::kLattice);
  append(points, {0.1 + 0.05 * world.size, 0.2, 0.1}, PointKind::kLattice);
  LeafInput input = world.leaf(points);
  input.criteria.spacing_floor = 0.7 * world.size;
  LeafDelta delta;
  const auto steps = traced(input, delta);
  EXPECT_FALSE(delta.unresolved.empty());
  for (const Violation& site : delta.unresolved)
    EXPECT_TRUE(std::ranges::any_of(steps, [&](const RefineStep& step) {
      return step.action == Action::kBlocked && step.condition == site.condition &&
             step.position == site.position && step.radius == site.radius;
    }));
}

// ---- Guards

double least_distance_of_inserted(const Refined& result) {
  double least = kInfinity;
  for (const MeshPoint& p : result.points)
    for (const MeshPoint& q : result.points)
      if (p.id != q.id && std::max(p.id, q.id) >= 1000000)
        least = std::min(least, norm(p.position - q.position));
  return least;
}

void expect_reported(const Refined& result, const std::vector<BrokenCondition>& broken,
                     int condition) {
  int num_reported = 0;
  for (const Violation& v : result.delta.unresolved) {
    if (v.condition != condition) continue;
    ++num_reported;
    const bool is_true = std::ranges::any_of(broken, [&](const BrokenCondition& b) {
      return b.condition == condition && norm(b.position - v.position) < 1e-9 &&
             std::abs(b.radius - v.radius) < 1e-9;
    });
    EXPECT_TRUE(is_true) << "C" << condition << " at " << v.position.x << ' ' << v.position.y << ' '
                         << v.position.z << ", radius " << v.radius;
  }
  EXPECT_EQ(num_reported, count(broken, condition)) << "C" << condition;
}

// Lattice points are not deleted, so they can keep surface points away.
TEST(RefineLeafFloor, LeavesC2UnresolvedBesideLatticePoints) {
  const World world = sphere(0.4);
  auto points = covering_points(world, true);
  Random random(44);
  for (const Point& p : shapes::random_points_on(world.mesh, 6, random))
    append(points, 0.95 * p, PointKind::kLattice);
  LeafInput input = world.leaf(points);
  input.criteria.spacing_floor = 0.5 * world.size;
  const Refined result = refined(input);
  EXPECT_GE(least_distance_of_inserted(result), input.criteria.spacing_floor);
  const MeshChecker checker(result.points, world.mesh);
  const auto broken = checker.broken_conditions(world.size, 2);
  EXPECT_GT(count(broken, 2), 0);
  expect_reported(result, broken, 2);
  EXPECT_EQ(result.keys(), checker.inside_cells());
}

TEST(RefineLeafFloor, LeavesC6UnresolvedBetweenClosePoints) {
  const World world = sphere(0.3);
  auto points = covering_points(world, true);
  append(points, {0.1, 0.2, 0.1}, PointKind::kLattice);
  append(points, {0.1 + 0.05 * world.size, 0.2, 0.1}, PointKind::kLattice);
  LeafInput input = world.leaf(points);
  input.criteria.spacing_floor = 0.7 * world.size;
  const Refined result = refined(input);
  EXPECT_GE(least_distance_of_inserted(result), input.criteria.spacing_floor);
  const MeshChecker checker(result.points, world.mesh);
  const auto broken = checker.broken_conditions(world.size, 2);
  EXPECT_GT(count(broken, 6), 0);
  expect_reported(result, broken, 6);
  EXPECT_EQ(result.keys(), checker.inside_cells());
}

TEST(RefineLeafFloor, LeavesC3AndC4UnresolvedOnAThinTorus) {
  const World world = thin_torus();
  std::array<int, 7> num_unresolved{};
  for (unsigned seed = 0; seed < 10; ++seed) {
    LeafInput input = world.leaf(random_surface_points(world, 12 + 3 * seed, seed));
    input.criteria.spacing_floor = 0.8 * world.size;
    const Refined result = refined(input);
    EXPECT_GE(least_distance_of_inserted(result), input.criteria.spacing_floor);
    const MeshChecker checker(result.points, world.mesh);
    const auto broken = checker.broken_conditions(world.size, 2);
    expect_reported(result, broken, 4);
    for (const Violation& v : result.delta.unresolved) {
      ++num_unresolved[std::size_t(v.condition)];
      EXPECT_TRUE(v.condition != 3 ||
                  std::ranges::any_of(broken,
                                      [&](const BrokenCondition& b) {
                                        return b.condition == 3 &&
                                               std::abs(norm(b.position - v.position) - v.radius) <
                                                   1e-9;
                                      }))
          << "C3 of a surface ball around a vertex without a disk";
    }
    EXPECT_EQ(result.keys(), checker.inside_cells());
  }
  EXPECT_GT(num_unresolved[3], 0);
  EXPECT_GT(num_unresolved[4], 0);
}

// Where no surface can be, none is missed.
TEST(RefineLeaf, KnowingHowTheSurfaceIsCoveredChangesNothing) {
  for (const double size : {0.3, 0.2, 0.12}) {
    const World world = sphere(size);
    LeafInput input = world.leaf(covering_points(world, true));
    const LeafDelta asked_everywhere = refine_leaf(input);
    input.criteria.cover_radius = Criteria::of_cover(size, 2, 0).cover_radius;
    const LeafDelta spared = refine_leaf(input);
    EXPECT_GT(spared.inserted.size(), 0u);
    EXPECT_EQ(spared.cells, asked_everywhere.cells);
    ASSERT_EQ(spared.inserted.size(), asked_everywhere.inserted.size());
    for (std::size_t i = 0; i < spared.inserted.size(); ++i)
      EXPECT_EQ(spared.inserted[i].position, asked_everywhere.inserted[i].position);
  }
}

TEST(RefineLeafGuards, StopsWhenOverfull) {
  const World world = sphere(0.3);
  LeafInput input = world.leaf(random_surface_points(world, 20, 45));
  input.max_own_points = 50;
  const Refined result = refined(input);
  EXPECT_TRUE(result.delta.is_overfull);
  EXPECT_EQ(result.delta.cells, CellList());
  EXPECT_EQ(result.points.size(), 51u) << "stops with the first point too many";
  input.max_own_points = 19;
  const Refined untouched = refined(input);
  EXPECT_TRUE(untouched.delta.is_overfull);
  EXPECT_TRUE(untouched.delta.inserted.empty());
  input.max_own_points = 100000;
  EXPECT_FALSE(refined(input).delta.is_overfull);
}

TEST(RefineLeafGuards, GhostsDoNotFillALeaf) {
  const World world = sphere(0.3);
  const Refined whole = refined(world.leaf(covering_points(world, true)));
  LeafInput input = world.leaf({});
  input.box.max.x = 0;
  for (MeshPoint p : whole.points) {
    const bool is_own = p.position.x < 0;
    (is_own ? input.own : input.ghosts).push_back(p);
  }
  input.max_own_points = input.own.size();
  const Refined half = refined(input);
  EXPECT_FALSE(half.delta.is_overfull);
  std::vector<CellKey> expected;
  for (const CellKey& key : whole.keys())
    if (key[0].x < 0) expected.push_back(key);
  EXPECT_EQ(half.keys(), expected) << "the cells with their smallest vertex in the box";
}

TEST(RefineLeafGuards, ThrowsBeyondMaxInsertionsWithThePlace) {
  const World world = sphere(0.3);
  LeafInput input = world.leaf(random_surface_points(world, 20, 46));
  input.box = {{-4.5, -4, -4}, {4, 4, 4}};
  input.max_insertions = 10;
  try {
    refine_leaf(input);
    FAIL() << "no error";
  } catch (const RefineError& error) {
    EXPECT_NE(std::string(error.what()).find("-4.5"), std::string::npos) << error.what();
  }
}

TEST(RefineLeafGuards, ThrowsForTwoPointsInOnePlace) {
  const World world = sphere(0.3);
  auto points = random_surface_points(world, 20, 47);
  append(points, points[3].position, PointKind::kSurface);
  EXPECT_THROW(refine_leaf(world.leaf(points)), RefineError);
}

TEST(RefineLeafGuards, NoPointsGiveNothing) {
  const LeafDelta delta = refine_leaf(sphere(0.3).leaf({}));
  EXPECT_EQ(delta.cells, CellList());
  EXPECT_TRUE(delta.inserted.empty());
}

TEST(RefineLeaf, StartsFromCornersWithTooFewPointsForACell) {
  const World world = sphere(0.3);
  for (std::size_t num = 1; num < 4; ++num)
    expect_good(world, refined(world.leaf(random_surface_points(world, num, 48))), 2);
}

// A part far smaller than λ, which gets one sample: without a cure it would not be in the mesh, and
// no condition would say so.
TEST(RefineLeaf, UnfoldsPartsSmallerThanSize) {
  const World world{
      shapes::together(shapes::icosphere({0, 0, 0}, 1, 3), shapes::icosphere({2, 0, 0}, 0.02, 2)),
      0.4};
  const Refined result = refined(world.leaf(covering_points(world, true)));
  EXPECT_GT(result.delta.stats.insertions[2], 0);
  expect_good(world, result, 4);
}

TEST(RefineLeaf, UnfoldsCavitiesSmallerThanSize) {
  const World world{shapes::nested_shells(1, 0.02, 2), 0.4};
  const Refined result = refined(world.leaf(covering_points(world, true)));
  expect_good(world, result, 4);
}

TEST(RefineLeafGuards, WithoutOwnPointsNothingIsDone) {
  const World world = sphere(0.3);
  LeafInput input = world.leaf({});
  input.ghosts = random_surface_points(world, 30, 49);
  input.box = {{-0.2, -0.2, -0.2}, {0.2, 0.2, 0.2}};
  const LeafDelta delta = refine_leaf(input);
  EXPECT_EQ(delta.cells, CellList());
  EXPECT_TRUE(delta.inserted.empty());
}

// ---- A pure function

TEST(RefineLeafIsPure, EqualInputGivesAnEqualDelta) {
  const World world{shapes::torus(1, 0.3, 48, 16), 0.38};
  const LeafInput input = world.leaf(random_surface_points(world, 25, 50));
  const World copy{world.mesh, world.size};
  expect_same(refine_leaf(input), refine_leaf(copy.leaf(input.own)));
}

TEST(RefineLeafIsPure, OrderOfAGoodPointSetDoesNotMatter) {
  const World world = sphere(0.3);
  const Refined first = refined(world.leaf(covering_points(world, true)));
  std::vector<MeshPoint> points = first.points;
  constexpr unsigned kSeed = 51;
  Random random(kSeed);
  for (int n = 0; n < 4; ++n) {
    std::ranges::shuffle(points, random);
    for (std::size_t i = 0; i < points.size(); ++i) points[i].id = i;
    LeafInput input = world.leaf({points.begin() + 100, points.end()});
    input.ghosts.assign(points.begin(), points.begin() + 100);
    const Refined again = refined(input);
    EXPECT_EQ(again.num_insertions(), 0u) << "seed " << kSeed;
    EXPECT_EQ(again.keys(), first.keys()) << "seed " << kSeed;
  }
}

// Lattice points and box corners: many cospherical points, whose ties are broken by coordinates.
TEST(RefineLeafIsPure, OrderOfCosphericalPointsDoesNotMatter) {
  const World world{shapes::box({{-0.01, -0.01, -0.01}, {4.01, 4.01, 4.01}}), 10};
  std::vector<MeshPoint> points;
  for (int x = 0; x <= 4; ++x)
    for (int y = 0; y <= 4; ++y)
      for (int z = 0; z <= 4; ++z)
        append(points, {double(x), double(y), double(z)}, PointKind::kSurface);
  LeafInput input = world.leaf(points);
  input.criteria.spacing_floor = 100;  // nothing may be inserted
  const Refined first = refined(input);
  EXPECT_GT(first.cells.size(), 4u * 4 * 4 * 5 - 1);
  constexpr unsigned kSeed = 52;
  Random random(kSeed);
  for (int n = 0; n < 4; ++n) {
    std::ranges::shuffle(input.own, random);
    EXPECT_EQ(refined(input).keys(), first.keys()) << "seed " << kSeed;
  }
}

// ---- Points of P that were not loaded

class BruteForceIndex : public PointIndex {
 public:
  explicit BruteForceIndex(std::vector<MeshPoint> points) : points_(std::move(points)) {}
  std::optional<MeshPoint> nearest(
      const Point& q, double radius,
      const std::function<bool(std::uint64_t)>& is_deleted) const override {
    std::optional<MeshPoint> best;
    for (const MeshPoint& p : points_) {
      const double d = squared_distance(p.position, q);
      if (d > radius * radius || is_deleted(p.id)) continue;
      const double least = best ? squared_distance(best->position, q) : kInfinity;
      if (d < least || (d == least && p.position < best->position)) best = p;
    }
    return best;
  }

 private:
  std::vector<MeshPoint> points_;
};

// A visit of one leaf of a finished mesh, with what is within `margin` λ of it loaded.
struct FinishedLeaf {
  explicit FinishedLeaf(double margin) {
    all = refined(world.leaf(covering_points(world, true))).points;
    for (std::size_t i = 0; i < all.size(); ++i) all[i].id = i;
    index = std::make_unique<BruteForceIndex>(all);
    input = world.leaf({});
    input.box = {{-2, -2, -2}, {-0.2, 0.1, 0.1}};
    for (const MeshPoint& p : all) {
      const double d = std::sqrt(input.box.squared_distance(p.position));
      (d == 0 ? input.own : d <= margin * world.size ? input.ghosts : unloaded).push_back(p);
    }
  }

  const World world = sphere(0.25);
  std::vector<MeshPoint> all, unloaded;
  std::unique_ptr<BruteForceIndex> index;
  LeafInput input;
};

// In what the paper loads nothing is missing: a cell with a circumradius below λ is one of Del P.
TEST(RefineLeafWithIndex, FindsTheCellsOfTheWholeWithin2Sizes) {
  const FinishedLeaf leaf(2);
  ASSERT_GT(leaf.unloaded.size(), 50u);
  const Refined result = refined(leaf.input, leaf.unloaded, leaf.index.get());
  EXPECT_EQ(result.num_insertions(), 0u);
  std::vector<CellKey> expected;
  for (const CellKey& key : refined(leaf.world.leaf(leaf.all)).keys())
    if (leaf.input.box.contains(key[0])) expected.push_back(key);
  EXPECT_EQ(result.keys(), expected);
}

TEST(RefineLeafWithIndex, TakesInWhatIsThereInsteadOfInserting) {
  const FinishedLeaf leaf(0);
  const Refined result = refined(leaf.input, leaf.unloaded, leaf.index.get());
  EXPECT_EQ(result.num_insertions(), 0u);
  EXPECT_GT(result.delta.stats.points_added, 0u);
  EXPECT_LE(result.delta.stats.points_added, leaf.unloaded.size());
  LeafDelta delta;
  const auto steps = traced(leaf.input, delta, leaf.index.get());
  EXPECT_EQ(count(steps, Action::kTakeIn), result.delta.stats.points_added);
  for (const RefineStep& step : steps) {
    const auto taken = std::ranges::find(leaf.unloaded, step.point, &MeshPoint::id);
    EXPECT_TRUE(taken != leaf.unloaded.end() && taken->position == step.position);
  }
  const bool is_any_used = std::ranges::any_of(result.delta.cells.vertices, [&](VertexRef ref) {
    return std::ranges::find(leaf.unloaded, ref, &MeshPoint::id) != leaf.unloaded.end();
  });
  EXPECT_TRUE(is_any_used);
}

// Where nothing is near enough, the point is inserted.
TEST(RefineLeafWithIndex, InsertsWhereThePointsAreFar) {
  const World world = sphere(0.4);
  const auto points = random_surface_points(world, 20, 53);
  const BruteForceIndex index(points);
  const Refined result = refined(world.leaf(points), {}, &index);
  EXPECT_EQ(result.delta.stats.points_added, 0u);
  EXPECT_GT(result.num_insertions(), 0u);
  expect_good(world, result, 2);
}

}  // namespace
}  // namespace locvol
