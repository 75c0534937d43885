#include "engine/engine.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <map>
#include <random>
#include <set>

#include "engine/audit/audit.h"
#include "engine/inspect/replay.h"
#include "engine/plan/phases.h"
#include "engine/plan/same_run.h"
#include "refine/predicates.h"
#include "tests/directories.h"
#include "tests/engine/closed_shapes.h"
#include "tests/engine/core_brute_force.h"
#include "tests/engine/store_contents.h"
#include "tests/refine/shapes.h"
#include "tests/skip_reasons.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

using namespace testing_shapes;

CoreByBruteForce core_of(const Contents& contents) {
  std::vector<MortonKey> leaves;
  for (const auto& [key, leaf] : contents.leaves) leaves.push_back(key);
  return {contents.run, leaves,
          [&](MortonKey leaf) { return contents.leaves.at(leaf).points.core; }};
}

using CellIds = std::array<std::uint64_t, 4>;

// Those of the lattice core too.
std::vector<CellIds> cells_of(const Contents& contents) {
  std::vector<CellIds> cells;
  for (const auto& [key, leaf] : contents.leaves) {
    const auto& vertices = leaf.cells.vertices;
    for (const auto& [a, b, c, d] : leaf.cells.cells)
      cells.push_back({vertices[a], vertices[b], vertices[c], vertices[d]});
  }
  for (const auto& [a, b, c, d] : core_of(contents).cells)
    cells.push_back({site_id(a), site_id(b), site_id(c), site_id(d)});
  return cells;
}

using Facet = std::array<std::uint64_t, 3>;

// The boundary of the union of all cells: facets of one cell only.
struct Boundary {
  std::vector<Facet> facets;
  std::uint64_t num_overused_facets = 0;  // in more than two cells
  std::uint64_t num_open_edges = 0;       // not in two facets of the boundary
  std::int64_t euler_characteristic = 0;
};

Boundary boundary_of(const Contents& contents) {
  std::map<Facet, int> cells_of_facet;
  for (const CellIds& cell : cells_of(contents))
    for (std::size_t opposite = 0; opposite < 4; ++opposite) {
      Facet facet{};
      for (std::size_t i = 0; i < 3; ++i) facet[i] = cell[(opposite + 1 + i) % 4];
      std::ranges::sort(facet);
      ++cells_of_facet[facet];
    }
  Boundary boundary;
  std::map<std::pair<std::uint64_t, std::uint64_t>, int> facets_of_edge;
  std::set<std::uint64_t> vertices;
  for (const auto& [facet, num_cells] : cells_of_facet) {
    boundary.num_overused_facets += num_cells > 2;
    if (num_cells != 1) continue;
    boundary.facets.push_back(facet);
    vertices.insert(facet.begin(), facet.end());
    for (const auto& [i, j] : {std::pair(0, 1), std::pair(0, 2), std::pair(1, 2)})
      ++facets_of_edge[{facet[static_cast<std::size_t>(i)], facet[static_cast<std::size_t>(j)]}];
  }
  for (const auto& [edge, num_facets] : facets_of_edge) boundary.num_open_edges += num_facets != 2;
  boundary.euler_characteristic = static_cast<std::int64_t>(vertices.size()) -
                                  static_cast<std::int64_t>(facets_of_edge.size()) +
                                  static_cast<std::int64_t>(boundary.facets.size());
  return boundary;
}

std::map<std::uint64_t, MeshPoint> points_of(const Contents& contents) {
  std::map<std::uint64_t, MeshPoint> points;
  for (const auto& [key, leaf] : contents.leaves)
    for (const MeshPoint& point : leaf.points.points) points[point.id] = point;
  const Lattice lattice = lattice_of(contents.run);
  for (const LatticeSite& site : core_of(contents).sites)
    points[site_id(site)] = {site_id(site), lattice.position(site), PointKind::kLattice};
  return points;
}

double volume_of(const Contents& contents) {
  const auto points = points_of(contents);
  double volume = 0;
  for (const CellIds& cell : cells_of(contents)) {
    std::array<Point, 4> p;
    for (std::size_t i = 0; i < 4; ++i) p[i] = points.at(cell[i]).position;
    volume += dot(cross(p[1] - p[0], p[2] - p[0]), p[3] - p[0]) / 6;
  }
  return volume;
}

// The store's own laws, which hold after every commit.
void expect_consistent(const Contents& contents) {
  std::uint64_t num_points = 0, num_cells = 0, num_unresolved = 0, num_queued = 0;
  std::set<std::uint64_t> ids;
  const CoreByBruteForce core = core_of(contents);
  const Lattice lattice = lattice_of(contents.run);
  const bool is_cover = contents.run.parameters.init == Initialization::kCover;
  const bool is_core_counted = are_first_points_known(contents.run.phase);
  for (const auto& [key, leaf] : contents.leaves) {
    EXPECT_EQ(leaf.info.num_points, leaf.points.points.size());
    EXPECT_EQ(leaf.info.num_cells, leaf.cells.cells.size());
    EXPECT_EQ(leaf.info.num_triangles, leaf.surface.triangles.size());
    EXPECT_EQ(leaf.info.num_unresolved, leaf.unresolved.sites.size());
    EXPECT_TRUE(std::ranges::is_sorted(leaf.points.points, {}, &MeshPoint::id));
    for (const MeshPoint& point : leaf.points.points) {
      EXPECT_EQ(contents.run.frame.key_of(point.position, key.level()), key);
      EXPECT_TRUE(ids.insert(point.id).second);
      EXPECT_LT(point.id, contents.run.next_point_id);
      const bool is_site = is_cover && point.id < kFirstOtherId;
      EXPECT_EQ(is_site, point.kind == PointKind::kLattice);
      if (!is_site) continue;
      EXPECT_EQ(point.position, lattice.position_of(point.id));
      EXPECT_FALSE(core.sites.contains(site_of(point.id)));
    }
    const auto count = [&](const auto& counts) {
      return counts.contains(key) ? counts.at(key) : std::uint64_t{0};
    };
    EXPECT_EQ(leaf.info.num_core_points, count(core.num_points));
    EXPECT_EQ(leaf.info.num_core_cells, is_core_counted ? count(core.num_cells) : 0);
    num_points += leaf.info.num_points + leaf.info.num_core_points;
    num_cells += leaf.info.num_cells + leaf.info.num_core_cells;
    num_unresolved += leaf.info.num_unresolved;
    num_queued += leaf.info.queued.has_value();
  }
  EXPECT_EQ(contents.run.counts.num_points, num_points);
  EXPECT_EQ(contents.run.counts.num_cells, num_cells);
  EXPECT_EQ(contents.run.counts.num_unresolved, num_unresolved);
  EXPECT_EQ(contents.queue.size(), num_queued);
  for (const QueueEntry& entry : contents.queue)
    EXPECT_EQ(contents.leaves.at(entry.leaf).info.queued, entry.position);
}

class EngineTest : public testing::Test {
 protected:
  MeshOptions options(const std::string& store, double size, std::uint64_t leaf_capacity) const {
    MeshOptions options;
    options.input = input_;
    options.store = scratch_ / store;
    options.size = {size, false};
    options.leaf_capacity = leaf_capacity;
    return options;
  }
  // Without creases: folds and thin walls are told apart by insertions alone.
  MeshOptions smooth_options(const std::string& store, double size,
                             std::uint64_t leaf_capacity) const {
    MeshOptions options = this->options(store, size, leaf_capacity);
    options.sharp_angle = 0;
    return options;
  }
  void write(const Shape& shape) const { write_off(shape, input_); }

  TempDir scratch_;
  std::filesystem::path input_ = scratch_ / "input.off";
};

RunControl with_threads(int num_threads) {
  RunControl control;
  control.num_threads = num_threads;
  return control;
}

// A run that is stopped after each `num_visits` visits, each time after `num_more` more of them,
// and resumed until it is done. On one thread: on several, those under way would be dropped, and at
// one visit a piece it would get nowhere.
void mesh_in_pieces(const MeshOptions& options, int num_visits, int num_more = 0) {
  int num_pieces = 0, num_done = 0;
  const auto stop_soon = [&] {
    num_done = 0;
    return RunControl{.on_progress = [&](const Progress&) { ++num_done; },
                      .is_stopped = [&] { return num_done >= num_visits; },
                      .on_note = {},
                      .num_threads = 1};
  };
  RunSummary summary = mesh(options, stop_soon());
  while (summary.outcome == RunOutcome::kInterrupted) {
    ASSERT_LT(++num_pieces, 5000);
    num_visits += num_more;
    if (num_pieces % 7 == 0) expect_consistent(contents_of(options.store));
    summary = num_pieces % 2 == 0 ? resume(options.store, stop_soon()) : mesh(options, stop_soon());
  }
  EXPECT_GT(num_pieces, 2);
}

struct Division {
  std::uint64_t leaf_capacity;
  std::uint64_t least_leaves, most_leaves;
};

class EngineAt : public EngineTest, public testing::WithParamInterface<Division> {};

TEST_P(EngineAt, MeshesASphereWithAClosedBoundary) {
  write(sphere(1, 31, 64));
  const auto run = options("store", 0.1, GetParam().leaf_capacity);
  const RunSummary summary = mesh(run);
  EXPECT_EQ(summary.outcome, RunOutcome::kDone);
  EXPECT_GE(summary.num_leaves, GetParam().least_leaves);
  EXPECT_LE(summary.num_leaves, GetParam().most_leaves);
  EXPECT_LE(summary.max_visits_of_a_leaf, 4U);

  const Contents contents = contents_of(run.store);
  expect_consistent(contents);
  EXPECT_EQ(contents.run.phase, Phase::kDone);
  EXPECT_TRUE(contents.queue.empty());
  const Boundary boundary = boundary_of(contents);
  EXPECT_GT(boundary.facets.size(), 1000U);
  EXPECT_EQ(boundary.num_overused_facets, 0U);
  EXPECT_EQ(boundary.num_open_edges, 0U);
  EXPECT_EQ(boundary.euler_characteristic, 2);
  EXPECT_NEAR(volume_of(contents), summary.run.surface.volume, 0.02 * summary.run.surface.volume);
}

INSTANTIATE_TEST_SUITE_P(Leaves, EngineAt,
                         testing::Values(Division{20000, 1, 1}, Division{1000, 8, 64},
                                         Division{50, 100, 1000}));

TEST_F(EngineTest, KeepsTheTorusGenusInTwoOrThreeVisitsOfALeaf) {
  write(torus(1, 0.4, 64, 32));
  const auto run = options("store", 0.1, 200);
  const RunSummary summary = mesh(run);
  EXPECT_EQ(summary.outcome, RunOutcome::kDone);
  const Contents contents = contents_of(run.store);
  expect_consistent(contents);
  const Boundary boundary = boundary_of(contents);
  EXPECT_EQ(boundary.num_overused_facets, 0U);
  EXPECT_EQ(boundary.num_open_edges, 0U);
  EXPECT_EQ(boundary.euler_characteristic, 0);

  const auto num_with_points = static_cast<std::uint64_t>(std::ranges::count_if(
      contents.leaves, [](const auto& leaf) { return leaf.second.info.num_points > 0; }));
  EXPECT_GT(num_with_points, 20U);
  EXPECT_GE(summary.run.counts.num_visits, num_with_points);
  EXPECT_LE(summary.run.counts.num_visits, 3 * num_with_points);
  EXPECT_LE(summary.max_visits_of_a_leaf, 5U);
}

TEST_F(EngineTest, GivesTheSameRecordsTwice) {
  write(torus(1, 0.4, 32, 16));
  mesh(options("one", 0.2, 60));
  mesh(options("two", 0.2, 60));
  EXPECT_TRUE(are_equal(contents_of(scratch_ / "one"), contents_of(scratch_ / "two")));
}

// Where a sharp model makes visits delete points, the triangulation's order of new cells depended
// on their addresses.
TEST_F(EngineTest, GivesTheSameRecordsAgainWithDeletions) {
  if (models_directory().empty()) GTEST_SKIP() << kNoModels;
  const auto turbine = [&](const std::string& store) {
    MeshOptions run = options(store, 4, 2000);
    run.input = models_directory() / "turbine.ply";
    run.size.is_percent = true;
    return run;
  };
  EXPECT_GT(mesh(turbine("first")).run.counts.num_deletions, 0U);
  const Contents first = contents_of(scratch_ / "first");
  for (const int num_threads : {1, 2, 4}) {
    const std::string again = std::to_string(num_threads) + " threads";
    RunControl control;
    control.num_threads = num_threads;
    mesh(turbine(again), control);
    EXPECT_TRUE(are_equal(contents_of(scratch_ / again), first)) << again;
  }
}

TEST_F(EngineTest, GoesOnAfterInterruptionsToTheSameRecords) {
  write(torus(1, 0.4, 32, 16));
  const RunSummary undisturbed = mesh(options("undisturbed", 0.2, 60));
  const Contents expected = contents_of(scratch_ / "undisturbed");
  for (const int num_visits : {1, 17}) {
    const auto run = options("pieces " + std::to_string(num_visits), 0.2, 60);
    mesh_in_pieces(run, num_visits);
    EXPECT_TRUE(are_equal(contents_of(run.store), expected)) << num_visits;
  }
  EXPECT_EQ(mesh(options("undisturbed", 0.2, 60)).run.counts.num_visits,
            undisturbed.run.counts.num_visits);
}

// Threads, the least memory, and interruptions that find several visits under way.
TEST_F(EngineTest, GivesTheSameRecordsWithAnyNumberOfThreads) {
  write(torus(1, 0.4, 32, 16));
  const unsigned seed = std::random_device()();
  RecordProperty("seed", std::to_string(seed));
  std::mt19937 random(seed);
  mesh(options("one", 0.1, 60), with_threads(1));
  const Contents expected = contents_of(scratch_ / "one");
  EXPECT_GT(expected.run.counts.num_visits, 80U);
  for (const int num_threads : {2, 3, 8}) {
    const std::string name = std::to_string(num_threads);
    RunControl control = with_threads(num_threads);
    mesh(options(name, 0.1, 60), control);
    EXPECT_TRUE(are_equal(contents_of(scratch_ / name), expected)) << name << " threads";

    control.memory_bytes = std::uint64_t{100} << 20;
    control.is_stopped = [&random] { return random() % 20 == 0; };
    const auto run = options(name + " in pieces", 0.1, 60);
    int num_pieces = 0;
    for (auto summary = mesh(run, control); summary.outcome == RunOutcome::kInterrupted;
         summary = resume(run.store, control)) {
      ASSERT_LT(++num_pieces, 1000) << "seed " << seed;
      if (num_pieces % 4 == 0) expect_consistent(contents_of(run.store));
    }
    EXPECT_TRUE(are_equal(contents_of(run.store), expected))
        << name << " threads, seed " << seed << ", " << num_pieces << " pieces";
  }
}

TEST_F(EngineTest, SplitsLeavesThatOutgrowTheirCapacity) {
  // Leaves are at least 4 λ wide at the start, and those inside hold about 24 lattice points.
  constexpr double kSize = 0.15;
  constexpr std::uint64_t kCapacity = 12;
  write(torus(1, 0.4, 32, 16));
  const auto run = options("store", kSize, kCapacity);
  EXPECT_EQ(mesh(run).outcome, RunOutcome::kDone);
  const Contents contents = contents_of(run.store);
  expect_consistent(contents);
  std::set<int> levels;
  for (const auto& [key, leaf] : contents.leaves) {
    if (leaf.info.num_points > 0) levels.insert(key.level());
    const bool may_split = contents.run.frame.side(key.level() + 1) >= 2 * kSize;
    // Those that C7 inserts come after the leaf was found to be small enough.
    const std::uint64_t num_most = kCapacity + leaf.info.num_insertions[6];
    EXPECT_TRUE(leaf.info.num_points <= num_most || !may_split) << leaf.info.num_points;
  }
  EXPECT_EQ(levels.size(), 2U);
  const Boundary boundary = boundary_of(contents);
  EXPECT_EQ(boundary.num_overused_facets, 0U);
  EXPECT_EQ(boundary.num_open_edges, 0U);
  EXPECT_EQ(boundary.euler_characteristic, 0);

  auto pieces = run;
  pieces.store = scratch_ / "pieces";
  mesh_in_pieces(pieces, 10);
  EXPECT_TRUE(are_equal(contents_of(pieces.store), contents));
}

TEST_F(EngineTest, MeshesInPaperModeToo) {
  write(sphere(1, 31, 64));
  auto run = options("store", 0.25, 60);
  run.init = Initialization::kPaper;
  const RunSummary summary = mesh(run);
  EXPECT_EQ(summary.outcome, RunOutcome::kDone);
  EXPECT_GT(summary.num_leaves, 1U);
  const Contents contents = contents_of(run.store);
  expect_consistent(contents);
  const Boundary boundary = boundary_of(contents);
  EXPECT_GT(boundary.facets.size(), 100U);
  EXPECT_EQ(boundary.num_overused_facets, 0U);
  EXPECT_EQ(boundary.num_open_edges, 0U);
  EXPECT_EQ(boundary.euler_characteristic, 2);

  auto pieces = run;
  pieces.store = scratch_ / "pieces";
  mesh_in_pieces(pieces, 3);
  EXPECT_TRUE(are_equal(contents_of(pieces.store), contents));
}

// Second visits, of few points of a leaf, need points across the gaps, which are the same leaf's.
TEST_F(EngineTest, MeshesCloseStrandsInPaperMode) {
  Shape strands;
  for (int i = 0; i < 5; ++i)
    strands = together(strands, translated(torus(1, 0.12, 80, 16), {0, 0, 0.4 * i}));
  write(strands);
  auto run = options("store", 0.07, 1500);
  run.init = Initialization::kPaper;
  const RunSummary summary = mesh(run);
  EXPECT_EQ(summary.outcome, RunOutcome::kDone);
  EXPECT_GT(summary.max_visits_of_a_leaf, 1U);
  const Contents contents = contents_of(run.store);
  expect_consistent(contents);
  const Boundary boundary = boundary_of(contents);
  EXPECT_EQ(boundary.num_overused_facets, 0U);
  EXPECT_EQ(boundary.num_open_edges, 0U);
  EXPECT_EQ(boundary.euler_characteristic, 0);
  EXPECT_TRUE(audit(Store::open(run.store, {.read_only = true})).is_valid());
}

TEST_F(EngineTest, MendsTheBoundaryWhereFoldsStayUnresolved) {
  write(knives());
  const auto run = smooth_options("store", 1, 500);
  const RunSummary summary = mesh(run);
  EXPECT_EQ(summary.outcome, RunOutcome::kUnresolved);
  EXPECT_GT(summary.num_leaves, 8U);
  const Contents contents = contents_of(run.store);
  expect_consistent(contents);
  EXPECT_EQ(contents.run.phase, Phase::kDone);
  EXPECT_TRUE(contents.queue.empty());
  EXPECT_EQ(boundary_of(contents).num_open_edges, 0U);
  std::uint64_t num_left_out = 0;
  for (const auto& [key, leaf] : contents.leaves) num_left_out += leaf.info.num_left_out;
  EXPECT_GT(num_left_out, 0U);
  EXPECT_LT(num_left_out, summary.run.counts.num_cells / 20);
  const AuditReport report = audit(Store::open(run.store, {.read_only = true}));
  EXPECT_TRUE(report.is_valid()) << (report.violations.empty() ? "" : report.violations.front());
  EXPECT_EQ(report.num_unresolved, summary.run.counts.num_unresolved);
  EXPECT_GT(report.volume / report.surface_volume, 0.85);  // knives are less than λ thick
}

TEST_F(EngineTest, MendsAlikeWithAnyThreadsAndInterruptions) {
  write(knives());
  const auto run = smooth_options("one", 1, 500);
  RunControl control;
  control.num_threads = 1;
  mesh(run, control);
  const Contents expected = contents_of(run.store);
  control.num_threads = 5;
  mesh(smooth_options("five", 1, 500), control);
  EXPECT_TRUE(are_equal(contents_of(scratch_ / "five"), expected));
  for (const int num_visits : {1, 3}) {
    const auto pieces = smooth_options("pieces " + std::to_string(num_visits), 1, 500);
    mesh_in_pieces(pieces, num_visits);
    EXPECT_TRUE(are_equal(contents_of(pieces.store), expected)) << num_visits;
  }
}

// However many insertions were refused there.
TEST_F(EngineTest, SitesWithinTheSizeOfEachOtherAreOne) {
  write(knives());
  const auto run = smooth_options("store", 1, 500);
  mesh(run);
  std::vector<Point> sites;
  for (const auto& [key, leaf] : contents_of(run.store).leaves)
    for (const UnresolvedSite& site : leaf.unresolved.sites) sites.push_back(site.position);
  EXPECT_GT(sites.size(), 4U);
  for (const Point& a : sites)
    EXPECT_EQ(
        std::ranges::count_if(sites, [&](const Point& b) { return squared_distance(a, b) <= 1; }),
        1);
}

// What was left out is told, so that a leaf's visit still proves the store.
TEST_F(EngineTest, ReplaysLeavesWhoseBoundaryWasMended) {
  write(knives());
  const auto run = smooth_options("store", 1, 500);
  mesh(run);
  const Store store = Store::open(run.store, {.read_only = true});
  for (const auto& [key, leaf] : contents_of(run.store).leaves) {
    if (leaf.info.num_points == 0) continue;
    const Replay again = replay(stored_visit(store, key));
    EXPECT_TRUE(again.reproduces())
        << again.error << again.num_cells_gone << " gone, " << again.num_cells_new << " new, "
        << again.num_left_out << " left out, " << again.delta.inserted.size() << " inserted";
    EXPECT_EQ(again.num_left_out, leaf.info.num_left_out);
  }
}

// A sheet thinner than the spacing floor: each insertion would bring others, down to the floor.
// With creases, mirrored samples tell such sheets apart.
TEST_F(EngineTest, GivesUpEarlyOnSheetsThinnerThanTheFloor) {
  constexpr double kWidth = 12, kThickness = 0.01;
  Shape sheet;
  for (int i = 0; i < 8; ++i)
    sheet.vertices.push_back({i & 1 ? kWidth : 0, i & 2 ? kWidth : 0, i & 4 ? kThickness : 0});
  for (const auto& [a, b, c, d] : std::vector<std::array<std::uint32_t, 4>>{
           {0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}})
    sheet.triangles.insert(sheet.triangles.end(), {{a, b, c}, {a, c, d}});
  const Shape thick = translated(sphere(2, 15, 32), {6, 6, 5});
  write(turned(together(sheet, thick)));
  const RunSummary summary = mesh(smooth_options("store", 1, 0));
  EXPECT_EQ(summary.outcome, RunOutcome::kUnresolved);
  // Two to a sample at the most: 2 · 144 λ² have 1.2 samples each. Down to the floor it is 2500.
  EXPECT_LT(summary.run.counts.num_insertions[2] + summary.run.counts.num_insertions[3], 2000U);
  EXPECT_TRUE(audit(Store::open(scratch_ / "store", {.read_only = true})).is_valid());
}

// ---- Creases

class CreasedEngineTest : public EngineTest {
 protected:
  // In a place where nothing is along an axis.
  void write_turned(const Shape& shape) const { write(turned(shape)); }

  AuditReport audit_of(const MeshOptions& options) const {
    return audit(Store::open(options.store, {.read_only = true}));
  }
};

TEST_F(CreasedEngineTest, KeepsEdgesAndCornersOfABoxInManyLeaves) {
  write(box_shape({{0, 0, 0}, {3, 2, 1}}));
  const MeshOptions run = options("store", 0.15, 100);
  EXPECT_EQ(mesh(run).outcome, RunOutcome::kDone);
  const AuditReport report = audit_of(run);
  EXPECT_TRUE(report.is_valid());
  EXPECT_NEAR(report.crease_length, 24, 1e-12);
  EXPECT_EQ(report.lost_crease_length, 0);
  EXPECT_EQ(report.num_lost_corners, 0U);
  EXPECT_EQ(report.num_poor_cells, 0U);
  EXPECT_NEAR(report.volume, 6, 1e-12);
}

TEST_F(CreasedEngineTest, KeepsKnives) {
  for (const int degrees : {15, 25, 40, 60, 80}) {
    SCOPED_TRACE(degrees);
    const Shape knife = testing_shapes::wedge(3, 2, degrees * std::numbers::pi / 180);
    write_turned(knife);
    const MeshOptions run = options(std::to_string(degrees), 0.2, 200);
    EXPECT_EQ(mesh(run).outcome, RunOutcome::kDone);
    const AuditReport report = audit_of(run);
    EXPECT_TRUE(report.is_valid());
    EXPECT_GT(report.crease_length, 15);
    EXPECT_EQ(report.lost_crease_length, 0);
    EXPECT_EQ(report.num_lost_corners, 0U);
    EXPECT_NEAR(report.volume, report.surface_volume, 1e-9 * report.surface_volume);
  }
}

// One layer of cells, which takes some 9 to λ², far from its creases as well as near them: to tell
// its sides apart by small cells would take hundreds.
TEST_F(CreasedEngineTest, AThinWallHasOneLayer) {
  write_turned(box_shape({{0, 0, 0}, {24, 20, 0.1}}));
  const MeshOptions run = options("store", 1, 100);
  const RunSummary summary = mesh(run);
  EXPECT_EQ(summary.outcome, RunOutcome::kDone);
  EXPECT_LT(summary.run.counts.num_cells, 12U * 24 * 20);
  const AuditReport report = audit_of(run);
  EXPECT_TRUE(report.is_valid());
  EXPECT_EQ(report.lost_crease_length, 0);
}

// Nor do two blocks notice the gap between them. (A point beside an edge of one has a mirror on its
// other face, and that has one on the other block.)
TEST_F(CreasedEngineTest, AGapTakesNoCells) {
  const Shape block = box_shape({{0, 0, 0}, {6, 5, 1.5}});
  write_turned(block);
  const MeshOptions alone = options("alone", 1, 10'000);
  const std::uint64_t num_alone = mesh(alone).run.counts.num_cells;
  write_turned(together(block, translated(block, {0, 0, 1.65})));
  const MeshOptions both = options("both", 1, 10'000);
  const RunSummary summary = mesh(both);
  EXPECT_EQ(summary.outcome, RunOutcome::kDone);
  EXPECT_LT(summary.run.counts.num_cells, 3 * num_alone);
  EXPECT_TRUE(audit_of(both).is_valid());
}

// Two corners that are closer than the spacing floor are one, and nothing is small there.
TEST_F(CreasedEngineTest, CornersCloserThanTheFloorAreOne) {
  // An edge along z becomes a face, as wide as this.
  constexpr double kWidth = 1e-5;
  Shape prism;
  const std::vector<Point> base = {
      {0, 0, 0}, {3, 0, 0}, {3, 2 - kWidth, 0}, {3 - kWidth, 2, 0}, {0, 2, 0}};
  const auto n = static_cast<std::uint32_t>(base.size());
  for (const double z : {0.0, 1.0})
    for (const Point& p : base) prism.vertices.push_back({p.x, p.y, z});
  for (std::uint32_t i = 1; i + 1 < n; ++i) {
    prism.triangles.push_back({0, i + 1, i});
    prism.triangles.push_back({n, n + i, n + i + 1});
  }
  for (std::uint32_t i = 0; i < n; ++i) {
    const std::uint32_t j = (i + 1) % n;
    prism.triangles.push_back({i, j, n + j});
    prism.triangles.push_back({i, n + j, n + i});
  }
  write(prism);
  const MeshOptions run = options("store", 0.3, 1000);
  const RunSummary summary = mesh(run);
  EXPECT_EQ(summary.outcome, RunOutcome::kDone);
  const AuditReport report = audit_of(run);
  EXPECT_TRUE(report.is_valid());
  EXPECT_EQ(report.lost_crease_length, 0);
  EXPECT_LT(summary.run.counts.num_points, 2000U);
}

// A whole part that is smaller than the floor has no corner that could be kept.
TEST_F(CreasedEngineTest, PartsSmallerThanTheFloorAreNoCreases) {
  constexpr double kSide = 1e-4;
  write(together(box_shape({{0, 0, 0}, {1, 1, 1}}),
                 box_shape({{2, 0, 0}, {2 + kSide, kSide, kSide}})));
  const MeshOptions run = options("store", 0.1, 1000);
  EXPECT_EQ(mesh(run).outcome, RunOutcome::kDone);
  const AuditReport report = audit_of(run);
  EXPECT_TRUE(report.is_valid());
  EXPECT_NEAR(report.crease_length, 12, 0.01);
  EXPECT_EQ(report.lost_crease_length, 0);
}

TEST_F(CreasedEngineTest, GivesTheSameRecordsWithAnyThreadsAndInterruptions) {
  write_turned(testing_shapes::wedge(3, 2, 0.5));
  for (const bool is_graded : {false, true}) {
    SCOPED_TRACE(is_graded);
    const auto run = [&](const std::string& name) {
      MeshOptions all = options(name + (is_graded ? " graded" : ""), 0.12, 100);
      if (is_graded) all.growth = 0.2;
      return all;
    };
    mesh(run("one"), with_threads(1));
    const Contents expected = contents_of(run("one").store);
    EXPECT_TRUE(expected.run.has_creases);
    EXPECT_GT(expected.leaves.size(), 30U);
    mesh(run("three"), with_threads(3));
    EXPECT_TRUE(are_equal(contents_of(run("three").store), expected));
    mesh_in_pieces(run("pieces"), 5, 1);
    EXPECT_TRUE(are_equal(contents_of(run("pieces").store), expected));
  }
}

// Creases that the user gives.
class GivenCreasesTest : public CreasedEngineTest {
 protected:
  static constexpr std::uint32_t kRings = 15, kAround = 32;

  void write_ball() const { write(sphere(1, kRings, kAround)); }
  // So many edges of its ring at z = 0.
  std::vector<Point> around(std::uint32_t num_edges) const {
    const Shape ball = sphere(1, kRings, kAround);
    std::vector<Point> points;
    for (std::uint32_t j = 0; j <= num_edges; ++j)
      points.push_back(ball.vertices[1 + (kRings / 2) * kAround + j % kAround]);
    return points;
  }
  void give(const std::vector<std::vector<Point>>& polylines) const {
    std::ofstream file(polylines_);
    file.precision(17);
    for (const auto& points : polylines) {
      file << points.size();
      for (const Point& p : points) file << "  " << p.x << ' ' << p.y << ' ' << p.z;
      file << '\n';
    }
  }
  MeshOptions given(const std::string& store, double size, std::uint64_t leaf_capacity) const {
    MeshOptions run = options(store, size, leaf_capacity);
    run.sharp_polylines = polylines_;
    return run;
  }
  static std::string refusal(const std::function<void()>& run) {
    try {
      run();
    } catch (const std::runtime_error& error) {
      return error.what();
    }
    return "none";
  }

  const std::filesystem::path polylines_ = scratch_ / "given.polylines.txt";
};

TEST_F(GivenCreasesTest, OfABoxOneByOneMakeTheMeshThatTheAngleMakes) {
  write(box_shape({{0, 0, 0}, {3, 2, 1}}));
  std::vector<std::vector<Point>> edges;
  for (const auto& [a, b] : {std::pair{0.0, 0.0}, {0.0, 1.0}, {1.0, 0.0}, {1.0, 1.0}}) {
    edges.push_back({{0, 2 * a, b}, {3, 2 * a, b}});
    edges.push_back({{3 * a, 2, b}, {3 * a, 0, b}});
    edges.push_back({{3 * a, 2 * b, 0}, {3 * a, 2 * b, 1}});
  }
  give(edges);
  MeshOptions run = given("given", 0.2, 100);
  run.sharp_angle = 0;
  mesh(run);
  mesh(options("by angle", 0.2, 100));
  Contents one_by_one = contents_of(run.store);
  const Contents by_angle = contents_of(scratch_ / "by angle");
  EXPECT_EQ(one_by_one.run.parameters.sharp_polylines.size(), 16U);
  EXPECT_EQ(one_by_one.run.sharp_file, polylines_);
  one_by_one.run.parameters = by_angle.run.parameters;
  one_by_one.run.sharp_file.clear();
  EXPECT_TRUE(are_equal(one_by_one, by_angle));
}

TEST_F(GivenCreasesTest, PartABallAtItsEquator) {
  write_ball();
  give({around(kAround)});
  const MeshOptions run = given("store", 0.15, 200);
  const RunSummary summary = mesh(run);
  EXPECT_EQ(summary.outcome, RunOutcome::kDone);
  ASSERT_EQ(summary.sheets.sheets.size(), 2U);
  const AuditReport report = audit_of(run);
  EXPECT_TRUE(report.is_valid());
  EXPECT_NEAR(report.crease_length, 2 * std::numbers::pi, 0.02);
  EXPECT_EQ(report.lost_crease_length, 0);
  EXPECT_EQ(report.num_poor_cells, 0U);
  std::array<std::uint64_t, 3> num_facets{};
  for (const auto& [key, leaf] : contents_of(run.store).leaves)
    for (const MeshFacet& facet : leaf.facets.facets) ++num_facets.at(facet.labels.sheet);
  EXPECT_EQ(num_facets[0], 0U);
  EXPECT_NEAR(static_cast<double>(num_facets[1]) / static_cast<double>(num_facets[2]), 1, 0.1);
}

// A sheet lies on both sides of it, and it ends in the middle.
TEST_F(GivenCreasesTest, AreKeptWhereTheyEndWithinASheet) {
  write_ball();
  for (const double growth : {0.0, 0.2}) {
    give({around(kAround / 3),
          {{0, 0, 1}, sphere(1, kRings, kAround).vertices[1 + (kRings - 1) * kAround]}});
    MeshOptions run = given(growth > 0 ? "graded" : "store", 0.12, 200);
    run.growth = growth;
    const RunSummary summary = mesh(run);
    EXPECT_EQ(summary.outcome, RunOutcome::kDone);
    EXPECT_TRUE(summary.sheets.sheets.empty());
    EXPECT_EQ(summary.sheets.creases.size(), 2U);
    EXPECT_EQ(summary.sheets.num_corners, 4U);
    const AuditReport report = audit_of(run);
    EXPECT_TRUE(report.is_valid());
    EXPECT_GT(report.crease_length, 2);
    EXPECT_EQ(report.lost_crease_length, 0);
    EXPECT_EQ(report.num_lost_corners, 0U);
    EXPECT_EQ(report.num_poor_cells, 0U);
  }
}

TEST_F(GivenCreasesTest, GiveTheSameRecordsWithAnyThreadsAndInterruptions) {
  write_ball();
  give({around(kAround / 2)});
  mesh(given("one", 0.2, 60), with_threads(1));
  const Contents expected = contents_of(scratch_ / "one");
  EXPECT_GT(expected.leaves.size(), 30U);
  mesh(given("three", 0.2, 60), with_threads(3));
  EXPECT_TRUE(are_equal(contents_of(scratch_ / "three"), expected));
  mesh_in_pieces(given("pieces", 0.2, 60), 5, 1);
  EXPECT_TRUE(are_equal(contents_of(scratch_ / "pieces"), expected));
}

TEST_F(GivenCreasesTest, ArePartOfWhatARunIs) {
  write_ball();
  give({around(5)});
  mesh(given("store", 0.3, 1000));
  const auto expect_refusal = [&](const MeshOptions& run, const std::string& words) {
    const std::string what = refusal([&] { mesh(run); });
    EXPECT_NE(what.find(words), std::string::npos) << what;
  };
  expect_refusal(options("store", 0.3, 1000), "--sharp is the file of polylines ");
  expect_refusal(options("store", 0.3, 1000), "in it, and no file of polylines here");
  give({around(6)});
  expect_refusal(given("store", 0.3, 1000), "--sharp is the file of polylines ");
  give({around(5)});
  EXPECT_EQ(refusal([&] { mesh(given("store", 0.3, 1000)); }), "none");
  give({{{0, 0, 1}, {0, 0, 0.5}}});
  expect_refusal(given("bad", 0.3, 1000), "(0, 0, 0.5) is no vertex of the surface");
  std::filesystem::remove(polylines_);
  expect_refusal(given("bad", 0.3, 1000), "given.polylines.txt");
  EXPECT_FALSE(std::filesystem::exists(scratch_ / "bad"));
  EXPECT_EQ(resume(scratch_ / "store", {}).outcome, RunOutcome::kDone);  // needs it no more
}

// While the surface is still being taken in, they are.
TEST_F(GivenCreasesTest, AreReadAgainWhereTheSurfaceIs) {
  write_ball();
  give({around(5)});
  const MeshOptions run = given("store", 0.3, 1000);
  const Contents expected = [&] {
    mesh(given("expected", 0.3, 1000));
    return contents_of(scratch_ / "expected");
  }();
  mesh(run);
  const auto begin_again = [&] {
    Store store = Store::open(run.store);
    RunRecord record = store.snapshot().run().value();
    record.phase = Phase::kIngest;
    record.epoch = 0;
    record.next_point_id = kFirstOtherId;
    record.counts = {};
    Batch batch = store.begin();
    batch.put_run(record);
    batch.commit();
  };
  begin_again();
  give({around(6)});
  const std::string what = refusal([&] { resume(run.store, {}); });
  EXPECT_NE(what.find("sharp edges from " + polylines_.string() + ", which is another file"),
            std::string::npos)
      << what;
  give({around(5)});
  EXPECT_EQ(resume(run.store, {}).outcome, RunOutcome::kDone);
  EXPECT_EQ(contents_of(run.store).leaves, expected.leaves);
}

// Each of its leaves has a few points, too few for a cell, and triangles whose corners are far
// away: several leaves began with the same corner.
TEST_F(EngineTest, MeshesANeedleOfLongTrianglesInManyLeaves) {
  const Point middle{80, -80, 4.5};
  Shape needle{{middle - Point{0, 0, 4}, middle + Point{0, 0, 4}}, {}};
  constexpr std::uint32_t n = 4;
  for (std::uint32_t i = 0; i < n; ++i) {
    const double angle = 2 * std::numbers::pi * i / n;
    needle.vertices.push_back(middle + 0.02 * Point{std::cos(angle), std::sin(angle), 0});
    needle.triangles.push_back({0, 2 + (i + 1) % n, 2 + i});
    needle.triangles.push_back({1, 2 + i, 2 + (i + 1) % n});
  }
  write(needle);
  const RunSummary summary = mesh(options("store", 0.066, 300));
  EXPECT_GT(summary.num_leaves, 64U);
  EXPECT_TRUE(audit(Store::open(scratch_ / "store", {.read_only = true})).is_valid());
}

class GradedEngineTest : public EngineTest {
 protected:
  MeshOptions graded(const std::string& store, double size, std::uint64_t leaf_capacity,
                     double growth = 0.2) const {
    MeshOptions options = this->options(store, size, leaf_capacity);
    options.growth = growth;
    return options;
  }
  // Of a run with one thread: they are the same with others, and in pieces of so many visits and
  // more.
  // `run_of`: with a store of that name
  Contents expect_same_records(const std::function<MeshOptions(const std::string&)>& run_of,
                               const std::vector<int>& some_threads, int num_visits) const {
    const auto one = run_of("one");
    mesh(one, with_threads(1));
    Contents expected = contents_of(one.store);
    for (const int num_threads : some_threads) {
      const auto run = run_of(std::to_string(num_threads));
      mesh(run, with_threads(num_threads));
      EXPECT_TRUE(are_equal(contents_of(run.store), expected)) << num_threads << " threads";
    }
    const auto pieces = run_of("pieces");
    mesh_in_pieces(pieces, num_visits, num_visits);
    EXPECT_TRUE(are_equal(contents_of(pieces.store), expected));
    return expected;
  }
};

// The audit asks the size where each cell's circumcenter is, by other code.
TEST_F(GradedEngineTest, CellsGrowFromTheSurfaceInwards) {
  write(sphere(1, 61, 128));
  std::uint64_t num_before = mesh(options("uniform", 0.08, 500)).run.counts.num_cells;
  for (const double growth : {0.1, 0.3}) {
    const auto run = graded("growth " + std::to_string(growth), 0.08, 500, growth);
    const RunSummary summary = mesh(run);
    EXPECT_EQ(summary.outcome, RunOutcome::kDone);
    EXPECT_GT(summary.num_leaves, 8U);
    EXPECT_LT(summary.run.counts.num_cells, 0.85 * static_cast<double>(num_before));
    num_before = summary.run.counts.num_cells;
    const AuditReport report = audit(Store::open(run.store, {.read_only = true}));
    EXPECT_TRUE(report.is_valid());
    EXPECT_GT(report.max_circumradius, 0.98);
    EXPECT_EQ(report.num_poor_cells, 0U);
    EXPECT_EQ(boundary_of(contents_of(run.store)).euler_characteristic, 2);
  }
}

// Cells deep inside are larger than a leaf's surface patch reaches beyond it: they were taken for
// unknown, and of those at the leaves' borders some were never improved.
TEST_F(GradedEngineTest, NoPoorCellsAreLeftAtTheBordersOfLeaves) {
  write(sphere(1, 122, 256));
  const auto run = graded("borders", 0.04, 300);
  mesh(run);
  const AuditReport report = audit(Store::open(run.store, {.read_only = true}));
  EXPECT_TRUE(report.is_valid());
  EXPECT_EQ(report.num_poor_cells, 0U);
}

TEST_F(GradedEngineTest, SizesStopGrowingAtTheLargest) {
  write(sphere(1, 61, 128));
  auto run = graded("bounded", 0.1, 0, 0.3);
  run.max_size = Size{0.13, false};
  const RunSummary bounded = mesh(run);
  EXPECT_TRUE(audit(Store::open(run.store, {.read_only = true})).is_valid());
  const RunSummary free = mesh(graded("free", 0.1, 0, 0.3));
  EXPECT_GT(bounded.run.counts.num_cells, 1.1 * static_cast<double>(free.run.counts.num_cells));
}

// Where h has a bound, the lattice of that size need not be listed: in leaves of many widths, some
// of them all of the core, and where a shape lies in the midst of it.
TEST_F(GradedEngineTest, HasACoreWhereSizesAreBounded) {
  write(sphere(1, 61, 128));
  for (const bool has_shape : {false, true}) {
    const std::string name = has_shape ? "shape" : "bounded";
    auto run = graded(name, 0.055, has_shape ? 150 : 2000, 0.3);
    if (has_shape) {
      run.growth = 0;  // but around the shape
      run.shapes = {SizedShape::ball({0.01}, {0.2, 0.1, 0}, 0.02)};
    } else {
      run.max_size = Size{0.08, false};
    }
    const RunSummary summary = mesh(run);
    EXPECT_EQ(summary.outcome, RunOutcome::kDone);
    const AuditReport report = audit(Store::open(run.store, {.read_only = true}));
    EXPECT_TRUE(report.is_valid()) << name;
    EXPECT_EQ(report.num_poor_cells, 0U) << name;
    std::uint64_t num_core_cells = 0;
    const Contents contents = contents_of(run.store);
    for (const auto& [key, leaf] : contents.leaves) num_core_cells += leaf.info.num_core_cells;
    EXPECT_GT(num_core_cells, summary.run.counts.num_cells / 20) << name;
    EXPECT_EQ(boundary_of(contents).euler_characteristic, 2) << name;
  }
}

TEST_F(GradedEngineTest, ACoreGivesTheSameRecordsWithAnyThreadsAndInterruptions) {
  write(sphere(1, 61, 128));
  const auto bounded = [&](const std::string& name) {
    auto run = graded(name, 0.08, 150, 0.3);
    run.max_size = Size{0.1, false};
    run.shapes = {SizedShape::ball({0.02}, {0.2, 0.1, 0}, 0.02)};
    return run;
  };
  EXPECT_GT(expect_same_records(bounded, {3}, 23).leaves.size(), 30U);
}

// Small cells on the surface and inside, in leaves of many widths.
TEST_F(GradedEngineTest, CellsAreSmallerAtShapes) {
  write(sphere(1, 61, 128));
  auto run = options("shapes", 0.2, 300);
  run.shapes = {SizedShape::ball({0.015}, {1, 0, 0}), SizedShape::ball({0.03}, {-0.3, 0, 0.2}, 0.1),
                SizedShape::segment({0.02}, {0, 0.9, 0.4}, {0, 0.6, 0.85}),
                SizedShape::box(Size::percent(2), {-1, -1, -1}, {-0.9, 1, 1})};
  const RunSummary summary = mesh(run);
  EXPECT_EQ(summary.outcome, RunOutcome::kDone);
  const AuditReport report = audit(Store::open(run.store, {.read_only = true}));
  EXPECT_TRUE(report.is_valid());
  EXPECT_GT(report.max_circumradius, 0.95);
  EXPECT_EQ(report.num_poor_cells, 0U);
  const Contents contents = contents_of(run.store);
  EXPECT_EQ(boundary_of(contents).euler_characteristic, 2);
  std::size_t num_near = 0;
  for (const auto& [key, leaf] : contents.leaves)
    for (const MeshPoint& p : leaf.points.points)
      num_near += squared_distance(p.position, {1, 0, 0}) < 0.05 * 0.05;
  EXPECT_GT(num_near, 20U);
  EXPECT_LT(summary.run.counts.num_cells, 60000U);
  const auto uniform = options("uniform", 0.2, 300);
  EXPECT_GT(summary.run.counts.num_cells, 10 * mesh(uniform).run.counts.num_cells);
}

TEST_F(GradedEngineTest, ShapesGiveTheSameRecordsWithAnyThreadsAndInterruptions) {
  write(torus(1, 0.4, 48, 24));
  const auto with_shapes = [&](const std::string& name) {
    auto run = graded(name, 0.15, 100);
    run.shapes = {SizedShape::ball({0.04}, {1.2, 0.3, 0}, 0.1),
                  SizedShape::segment({0.06}, {-1, 0, 0.4}, {-1.4, 0, 0})};
    return run;
  };
  EXPECT_GT(expect_same_records(with_shapes, {3}, 23).leaves.size(), 30U);
}

// By curvature, deviation and thickness.
TEST_F(GradedEngineTest, CellsAreSmallerWhereTheSurfaceAsksForIt) {
  write(torus(1, 0.2, 128, 32));
  const auto measured = [&](const std::string& name) {
    auto run = options(name, 0.25, 300);
    run.min_size = Size{0.02, false};
    return run;
  };
  const auto num_cells = [&](const MeshOptions& run) {
    const RunSummary summary = mesh(run);
    EXPECT_EQ(summary.outcome, RunOutcome::kDone);
    const AuditReport report = audit(Store::open(run.store, {.read_only = true}));
    EXPECT_TRUE(report.is_valid()) << run.store;
    EXPECT_EQ(report.num_poor_cells, 0U) << run.store;
    EXPECT_EQ(boundary_of(contents_of(run.store)).euler_characteristic, 0) << run.store;
    return static_cast<double>(summary.run.counts.num_cells);
  };
  const double num_uniform = num_cells(options("uniform", 0.25, 300));
  auto run = measured("circles");
  run.per_circle = 20;
  const double num_circles = num_cells(run);
  EXPECT_GT(num_circles, 3 * num_uniform);
  run = measured("deviation");
  run.deviation = Size{0.01, false};
  EXPECT_GT(num_cells(run), 3 * num_uniform);
  run = measured("layers");
  run.layers = 2;
  EXPECT_GT(num_cells(run), 3 * num_uniform);
  run = measured("all");
  run.per_circle = 20, run.layers = 8;
  EXPECT_GT(num_cells(run), 1.5 * num_circles);
  run = measured("least");
  run.per_circle = 200;
  run.min_size = Size{0.1, false};
  run.shapes = {SizedShape::ball({0.01}, {1, 0, 0})};
  num_cells(run);
  std::size_t num_nodes = 0;
  for (const auto& [key, leaf] : contents_of(run.store).leaves)
    for (const SizedNode& node : leaf.sizes.nodes) {
      EXPECT_EQ(node.size, 0.1F);  // and not that of the point
      ++num_nodes;
    }
  EXPECT_GT(num_nodes, 100U);
}

// The corners of triangles, a place on each edge, and `num` places spread over their area.
std::vector<Point> places_on(const std::vector<Triangle>& triangles, std::size_t num,
                             std::mt19937_64& random) {
  std::vector<Point> places = shapes::random_points_on(triangles, num, random);
  for (const Triangle& t : triangles)
    for (std::size_t i = 0; i < 3; ++i) {
      const Point &from = t.corners[i], &to = t.corners[(i + 1) % 3];
      places.insert(places.end(), {from, from + shapes::uniform(random, 0, 1) * (to - from)});
    }
  return places;
}

double farthest(const std::vector<Point>& places, const std::vector<Triangle>& triangles) {
  double farthest = 0;
  for (const Point& p : places) {
    double nearest = std::numeric_limits<double>::infinity();
    for (const Triangle& t : triangles) {
      if (nearest <= farthest) break;
      if (Box::around(t.corners[0]).joined(t.corners[1]).joined(t.corners[2]).squared_distance(p) <
          nearest * nearest)
        nearest = std::min(nearest, distance_to_triangle(p, t));
    }
    farthest = std::max(farthest, nearest);
  }
  return farthest;
}

// By brute force, where the surface is smooth, bends, and has edges and corners.
TEST_F(GradedEngineTest, BoundaryAndSurfaceAreWithinTheDeviationOfEachOther) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  std::mt19937_64 random(seed);
  constexpr double kDeviation = 0.02;
  const std::vector<std::pair<std::string, Shape>> shapes = {
      {"ball", sphere(1, 61, 128)},
      {"ring", torus(1, 0.4, 96, 48)},
      {"box", turned(box_shape({{0, 0, 0}, {1, 0.7, 1.3}}))},
      {"wedge", wedge(1, 0.6, std::numbers::pi / 6)}};
  for (const auto& [name, shape] : shapes) {
    SCOPED_TRACE(name);
    write(shape);
    auto run = options(name, 0.4, 1000);
    run.deviation = Size{kDeviation, false};
    run.seed = seed;
    const RunOutcome outcome = mesh(run).outcome;
    if (name != "wedge") {  // whose edges are acute
      EXPECT_EQ(outcome, RunOutcome::kDone);
    }
    std::vector<Triangle> surface, boundary;
    for (const auto& [a, b, c] : shape.triangles)
      surface.push_back({0, {shape.vertices[a], shape.vertices[b], shape.vertices[c]}});
    const Contents contents = contents_of(run.store);
    const auto points = points_of(contents);
    for (const auto& [a, b, c] : boundary_of(contents).facets)
      boundary.push_back(
          {0, {points.at(a).position, points.at(b).position, points.at(c).position}});
    EXPECT_LT(farthest(places_on(boundary, 3000, random), surface), kDeviation);
    EXPECT_LT(farthest(places_on(surface, 3000, random), boundary), kDeviation);
    // And not closer than it takes: of the ball, where the bound is all there is.
    if (name == "ball") {
      EXPECT_GT(farthest(places_on(boundary, 3000, random), surface), 0.2 * kDeviation);
    }
  }
}

// Sheets that make 5° have cells of their own between them, where they are closer than the spacing
// floor. None hangs on nothing: the boundary is one sphere.
TEST_F(GradedEngineTest, NoCellHangsOnNothingAtAKnifeEdge) {
  write(wedge(0.4, 1, std::numbers::pi / 36));
  for (const std::uint64_t seed : {1, 2}) {
    auto run = smooth_options("knife " + std::to_string(seed), 0.05, 30000);
    run.seed = seed;
    EXPECT_EQ(mesh(run).outcome, RunOutcome::kUnresolved);
    EXPECT_EQ(boundary_of(contents_of(run.store)).euler_characteristic, 2) << seed;
  }
}

// Of this wedge the boundary is 0.039 off without. At its tip of 15° hardly anything is cut off, so
// that the tip asks for nothing; other edges and corners do, for some of them may be worse.
TEST_F(GradedEngineTest, DeviationDoesNotPayTwiceAtATip) {
  write(wedge(0.6, 0.6, std::numbers::pi / 12));
  const auto num_cells = [&](const MeshOptions& run) {
    return static_cast<double>(mesh(run).run.counts.num_cells);
  };
  auto run = options("with", 0.06, 30000);
  run.deviation = Size{0.04, false};
  EXPECT_LT(num_cells(run), 1.7 * num_cells(options("without", 0.06, 30000)));
}

TEST_F(GradedEngineTest, MeasuredSizesGiveTheSameRecordsWithAnyThreadsAndInterruptions) {
  write(torus(1, 0.4, 48, 24));
  const auto measured = [&](const std::string& name) {
    auto run = graded(name, 0.3, 100);
    run.per_circle = 18;
    run.deviation = Size{0.015, false};
    run.layers = 2;
    return run;
  };
  EXPECT_GT(expect_same_records(measured, {3}, 23).leaves.size(), 30U);
}

// Voxels of point data on a grid 0.25 apart: small at one side of the ball, in voxels out of it as
// well, and what matters nowhere.
std::string image_of_sizes(const std::function<double(const Point&)>& size_at) {
  std::string text =
      "<VTKFile type=\"ImageData\" version=\"1.0\"><ImageData WholeExtent=\"0 8 0 8 0 8\" "
      "Origin=\"-1 -1 -1\" Spacing=\"0.25 0.25 0.25\"><Piece Extent=\"0 8 0 8 0 8\"><PointData>"
      "<DataArray type=\"Float64\" Name=\"size\" format=\"ascii\">";
  for (int k = 0; k < 9; ++k)
    for (int j = 0; j < 9; ++j)
      for (int i = 0; i < 9; ++i)
        text += std::to_string(size_at({-1 + 0.25 * i, -1 + 0.25 * j, -1 + 0.25 * k})) + ' ';
  return text + "</DataArray></PointData></Piece></ImageData></VTKFile>";
}

TEST_F(GradedEngineTest, CellsAreAsSmallAsAnImageAsks) {
  write(sphere(1, 61, 128));
  const auto image = scratch_ / "field.vti";
  const auto size_of = [](const Point& p) { return p.x > 0.6 ? 0.06 : 0.12 + 0.1 * (0.6 - p.x); };
  std::ofstream(image) << image_of_sizes(size_of);
  const auto of_image = [&](const std::string& name) {
    auto run = options(name, 0.25, 300);
    run.size_image = image;
    return run;
  };
  const Contents expected = expect_same_records(of_image, {3}, 23);
  const AuditReport report = audit(Store::open(scratch_ / "one", {.read_only = true}));
  EXPECT_TRUE(report.is_valid());
  EXPECT_EQ(report.num_poor_cells, 0U);
  EXPECT_EQ(boundary_of(expected).euler_characteristic, 2);
  const auto uniform = mesh(options("uniform", 0.25, 300)).run.counts.num_cells;
  EXPECT_GT(expected.run.counts.num_cells, 8 * uniform);
  std::vector<SizeCube> cubes;
  for (const auto& [key, leaf] : expected.leaves)
    cubes.insert(cubes.end(), leaf.sizes.cubes.begin(), leaf.sizes.cubes.end());
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> uniform_in(-0.6, 0.6);
  for (int n = 0; n < 1000; ++n) {
    const Point p{1.4 * uniform_in(random), uniform_in(random), 0.5 * uniform_in(random)};
    const auto nearest = [](double v) { return -1 + 0.25 * std::round((v + 1) / 0.25); };
    const double asked = size_of({nearest(p.x), nearest(p.y), nearest(p.z)});
    const double size = size_at(expected.run.parameters.sizes(), expected.run.frame, cubes, p);
    EXPECT_LT(size, 1.02 * asked);
    // No less than the smallest value that is a voxel and a node away.
    EXPECT_GT(size, 0.9 * size_of({std::min(p.x + 0.5, 1.0), p.y, p.z}));
  }

  auto all = of_image("all");
  all.per_circle = 30, all.layers = 2;
  mesh(all);
  EXPECT_TRUE(audit(Store::open(all.store, {.read_only = true})).is_valid());

  const auto expect_refusal = [&](const MeshOptions& options, const std::string& words) {
    try {
      mesh(options);
      ADD_FAILURE() << "not refused: " << words;
    } catch (const std::runtime_error& e) {
      EXPECT_NE(std::string(e.what()).find(words), std::string::npos) << e.what();
    }
  };
  expect_refusal(options("one", 0.25, 300), "--sizes is the image ");
  std::ofstream(image) << image_of_sizes([](const Point&) { return 0.1; });
  expect_refusal(of_image("one"), "--sizes is the image ");
  std::ofstream(image) << image_of_sizes([](const Point& p) { return p.x > 0 ? 0.1 : -0.1; });
  expect_refusal(of_image("bad"), "field.vti");
  std::ofstream(image) << image_of_sizes([](const Point&) { return 2e-5; });
  expect_refusal(of_image("bad"), "cells: give sizes");
  EXPECT_FALSE(std::filesystem::exists(scratch_ / "bad"));
}

// Colors go with it. A visit puts points up to 1.125 h away.
TEST_F(GradedEngineTest, KnowsHowLargeSizesAreWhereAVisitMayPutPoints) {
  write(box_shape({{0, 0, 0}, {1, 1, 1}}));
  auto run = options("cube", 0.2, 300);
  run.deviation = Size{0.02, false};
  run.shapes = {SizedShape::ball({0.01}, {0.3, 0.3, 0.3})};
  run.growth = 0.3;
  mesh(run);
  const Contents contents = contents_of(run.store);
  const SizeLaw law = contents.run.parameters.sizes();
  const Frame& frame = contents.run.frame;
  std::vector<SizeCube> cubes;
  for (const auto& [key, leaf] : contents.leaves)
    cubes.insert(cubes.end(), leaf.sizes.cubes.begin(), leaf.sizes.cubes.end());
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::size_t num_beyond = 0;
  for (int i = 0; i < 3000; ++i) {
    const Point p{uniform(random), uniform(random), uniform(random)};
    const double size = size_at(law, frame, cubes, p);
    for (const auto& [key, leaf] : contents.leaves) {
      if (leaf.info.largest_size == 0) continue;
      if (frame.box(key).squared_distance(p) > std::pow(1.125 * size, 2)) continue;
      EXPECT_LE(size, leaf.info.reached_size);
      num_beyond += size > leaf.info.largest_size;
    }
  }
  EXPECT_GT(num_beyond, 100U);
}

TEST_F(GradedEngineTest, SharpAndThinPartsKeepTheirTopology) {
  write(together(wedge(1, 0.5, 0.9), translated(torus(0.5, 0.05, 64, 12), {0, 0, 3})));
  for (const double size : {0.06, 0.035}) {
    const auto run = graded("thin " + std::to_string(size), size, 500);
    mesh(run);
    const AuditReport report = audit(Store::open(run.store, {.read_only = true}));
    EXPECT_TRUE(report.is_valid());
    EXPECT_EQ(boundary_of(contents_of(run.store)).euler_characteristic, 2);
  }
}

TEST_F(GradedEngineTest, GivesTheSameRecordsWithAnyThreadsAndInterruptions) {
  write(torus(1, 0.4, 48, 24));
  const auto run_of = [&](const std::string& name) { return graded(name, 0.1, 100); };
  EXPECT_GT(expect_same_records(run_of, {2, 5}, 17).leaves.size(), 8U);
}

TEST_F(GradedEngineTest, RefusesOtherSizesAndBadOnes) {
  write(sphere(1, 15, 32));
  mesh(graded("store", 0.3, 0));
  const auto expect_refusal = [&](MeshOptions options, const std::string& words) {
    try {
      mesh(options);
      ADD_FAILURE() << "not refused: " << words;
    } catch (const std::runtime_error& e) {
      EXPECT_NE(std::string(e.what()).find(words), std::string::npos) << e.what();
    }
  };
  expect_refusal(graded("store", 0.3, 0, 0.1), "--growth is 0.2 in it, and 0.1 here");
  expect_refusal(options("store", 0.3, 0), "--growth is 0.2 in it, and 0 here");
  auto bounded = graded("store", 0.3, 0);
  bounded.max_size = Size{0.5, false};
  expect_refusal(bounded, "--max-size is inf in it, and 0.5 here");
  auto shaped = graded("store", 0.3, 0);
  shaped.shapes = {SizedShape::ball({0.1}, {1, 0, 0})};
  shaped.shapes.front().place = "sizes.txt, line 7";
  expect_refusal(shaped, "--sizes is none in it, and 1 shape (hash ");
  shaped.store = scratch_ / "bad";
  shaped.shapes.front().size = {1e-9};
  shaped.shapes.front().radius = 0.5;
  expect_refusal(shaped, "sizes.txt, line 7: size 1e-09 asks for ");
  shaped.shapes.front().radius = 0;
  expect_refusal(shaped, "the octree of sizes would have more than");
  shaped.shapes.front().size = {-1};
  expect_refusal(shaped, "sizes.txt, line 7: size -1");
  auto measured = graded("store", 0.3, 0);
  measured.per_circle = 20, measured.layers = 2, measured.deviation = Size{0.1, false};
  expect_refusal(measured, "--per-circle is 0 in it, and 20 here");
  expect_refusal(measured, "--layers is 0 in it, and 2 here");
  expect_refusal(measured, "--deviation is 0 in it, and 0.1 here");
  expect_refusal(measured, "--min-size is 0 in it, and 0.006 here");
  auto welded = graded("store", 0.3, 0);
  welded.weld = Size{1e-6, false};
  expect_refusal(welded, "--weld is auto in it, and 1e-06 here");
  welded.weld = Size{};
  expect_refusal(welded, "--weld is auto in it, and 0 here");
  const auto expect_bad = [&](const std::function<void(MeshOptions&)>& change,
                              const std::string& words) {
    auto bad = graded("bad", 0.3, 0);
    change(bad);
    expect_refusal(bad, words);
  };
  expect_bad([](MeshOptions& o) { o.per_circle = 2; }, "edges per circle 2");
  expect_bad([](MeshOptions& o) { o.layers = std::nan(""); }, "layers nan");
  expect_bad([](MeshOptions& o) { o.weld = Size{-1, false}; }, "weld -1");
  expect_bad([](MeshOptions& o) { o.deviation = Size{-1, false}; }, "deviation -1");
  expect_bad([](MeshOptions& o) { o.min_size = Size{0.1, false}; }, "give one");
  expect_bad(
      [](MeshOptions& o) {
        o.layers = 2, o.min_size = Size{0.4, false};
      },
      "is above the size");
  expect_bad(
      [](MeshOptions& o) {
        o.layers = 2, o.min_size = Size{-0.4, false};
      },
      "smallest size -0.4");
  for (const double growth : {-0.1, 0.31, std::nan("")})
    expect_refusal(graded("bad", 0.3, 0, growth), "growth");
  bounded.store = scratch_ / "bad";
  bounded.max_size = Size{0.1, false};
  expect_refusal(bounded, "below the size at the surface");
  bounded.growth = 0;
  expect_refusal(bounded, "give a growth");
  auto paper = graded("bad", 0.3, 0);
  paper.init = Initialization::kPaper;
  expect_refusal(paper, "cover mode");
  EXPECT_FALSE(std::filesystem::exists(scratch_ / "bad"));
}

TEST_F(EngineTest, RefusesAStoreOfAnotherRunUnlessForced) {
  write(sphere(1, 15, 32));
  mesh(options("store", 0.3, 0));
  auto other = options("store", 0.25, 0);
  try {
    mesh(other);
    FAIL() << "the store was taken over";
  } catch (const StoreMismatch& e) {
    const std::string message = e.what();
    EXPECT_NE(message.find("--size is 0.3 in it, and 0.25 here"), std::string::npos) << message;
  }
  EXPECT_EQ(contents_of(other.store).run.parameters.size, 0.3);
  write(sphere(1.1, 15, 32));
  EXPECT_THROW(mesh(options("store", 0.3, 0)), StoreMismatch);
  other.is_forced = true;
  EXPECT_EQ(mesh(other).outcome, RunOutcome::kDone);
  mesh(options("fresh", 0.25, 0));
  EXPECT_TRUE(are_equal(contents_of(other.store), contents_of(scratch_ / "fresh")));
}

TEST_F(EngineTest, IngestsAgainWhatWasCutShort) {
  write(sphere(1, 15, 32));
  const auto run = options("store", 0.3, 60);
  mesh(run);
  const Contents expected = contents_of(run.store);
  const auto back_to_ingest = [&] {
    Store store = Store::open(run.store);
    Batch batch = store.begin();
    RunRecord record;
    record.parameters = expected.run.parameters;
    record.surface = expected.run.surface;
    record.next_point_id = kFirstOtherId;
    batch.put_run(record);
    batch.commit();
  };
  back_to_ingest();
  resume(run.store);
  EXPECT_TRUE(are_equal(contents_of(run.store), expected));
  back_to_ingest();
  mesh(run);
  EXPECT_TRUE(are_equal(contents_of(run.store), expected));
  back_to_ingest();
  write(sphere(1.1, 15, 32));
  EXPECT_THROW(resume(run.store), StoreMismatch);
}

TEST_F(EngineTest, LeavesNoStoreBehindWhenItRefuses) {
  write(sphere(1, 15, 32));
  EXPECT_THROW(mesh(options("store", 1e-7, 1000000)), InputError);
  EXPECT_FALSE(std::filesystem::exists(scratch_ / "store"));
  EXPECT_THROW(resume(scratch_ / "store"), StoreError);
}

TEST_F(EngineTest, ReportsProgressAndStopsWhenAsked) {
  write(sphere(1, 31, 64));
  std::vector<Progress> reports;
  const RunControl control{.on_progress = [&](const Progress& p) { reports.push_back(p); },
                           .is_stopped = {},
                           .on_note = {}};
  const RunSummary summary = mesh(options("store", 0.1, 1000), control);
  ASSERT_GT(reports.size(), 3U);
  EXPECT_EQ(reports.back().phase, Phase::kDone);
  EXPECT_EQ(reports.back().num_queued, 0U);
  EXPECT_EQ(reports.back().counts.num_cells, summary.run.counts.num_cells);
  EXPECT_TRUE(
      std::ranges::is_sorted(reports, {}, [](const Progress& p) { return p.counts.num_visits; }));
  EXPECT_TRUE(std::ranges::is_sorted(reports, {}, &Progress::epoch));

  bool is_known = false;
  const RunSummary stopped =
      mesh(options("stopped", 0.1, 1000), {.on_progress = {},
                                           .is_stopped = [&] { return is_known; },
                                           .on_note = {},
                                           .on_run = [&](const RunRecord&) { is_known = true; }});
  EXPECT_EQ(stopped.outcome, RunOutcome::kInterrupted);
  EXPECT_EQ(stopped.run.counts.num_visits, 0U);
}

}  // namespace
}  // namespace locvol
