// The lattice core of real runs against all of its points and cells one by one, and what becomes of
// a run when parts of it are listed, lost or damaged.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <iterator>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "engine/audit/audit.h"
#include "engine/engine.h"
#include "engine/formats/writer.h"
#include "engine/run/core_around.h"
#include "engine/run/run_state.h"
#include "tests/engine/closed_shapes.h"
#include "tests/engine/core_brute_force.h"
#include "tests/engine/described.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

using namespace testing_shapes;

// A finished run over a ball: in cubes of at least 4 λ, some of them all core. Each test has its
// own copy.
class CoreOfARun : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    made_ = std::make_unique<TempDir>();
    write_off(sphere(1, 31, 64), *made_ / "ball.off");
    MeshOptions options;
    options.input = *made_ / "ball.off";
    options.store = *made_ / "store";
    options.size = {0.07, false};
    options.leaf_capacity = 24;
    EXPECT_EQ(mesh(options).outcome, RunOutcome::kDone);
  }
  static void TearDownTestSuite() { made_.reset(); }
  CoreOfARun() {
    std::filesystem::copy(*made_ / "store", scratch_ / "store",
                          std::filesystem::copy_options::recursive);
    RecordProperty("seed", std::to_string(seed_));
  }
  void TearDown() override {
    if (HasFailure()) ADD_FAILURE() << "seed " << seed_;
  }

  Store open() const { return Store::open(scratch_ / "store"); }
  CoreByBruteForce core() const { return core_of(open()); }
  static CoreByBruteForce core_of(const Store& store) {
    const Snapshot snapshot = store.snapshot();
    return {*snapshot.run(), snapshot.leaf_keys(),
            [&](MortonKey leaf) { return snapshot.points(leaf).core; }};
  }
  static CoreByBruteForce core_of(const RunView& state) {
    const auto leaves = state.octree().leaves();
    return {state.run(), {leaves.begin(), leaves.end()}, [&](MortonKey leaf) {
              return state.leaves().points(leaf).core;
            }};
  }

  std::vector<LatticeSite> random_core_sites(std::size_t num) {
    const auto sites = core().sites;
    std::vector<LatticeSite> picked;
    std::ranges::sample(sites, std::back_inserter(picked), static_cast<std::ptrdiff_t>(num),
                        random_);
    return picked;
  }

  static inline std::unique_ptr<TempDir> made_;
  TempDir scratch_;
  const unsigned seed_ = std::random_device()();
  std::mt19937_64 random_{seed_};
};

void expect_counts_of(const RunView& state, const CoreByBruteForce& core) {
  std::uint64_t num_points = 0, num_cells = 0;
  const auto count = [](const auto& counts, MortonKey leaf) {
    return counts.contains(leaf) ? counts.at(leaf) : std::uint64_t{0};
  };
  for (const MortonKey leaf : state.octree().leaves()) {
    const LeafInfo info = state.leaves().info(leaf);
    EXPECT_EQ(info.num_core_points, count(core.num_points, leaf));
    EXPECT_EQ(info.num_core_cells, count(core.num_cells, leaf));
    EXPECT_EQ(num_core_cells(state, leaf), info.num_core_cells);
    EXPECT_EQ(info.num_points, state.leaves().points(leaf).points.size());
    num_points += info.num_points + info.num_core_points;
    num_cells += info.num_cells + info.num_core_cells;
  }
  EXPECT_EQ(state.run().counts.num_points, num_points);
  EXPECT_EQ(state.run().counts.num_cells, num_cells);
}

TEST_F(CoreOfARun, IsCountedAsItIs) {
  Store store = open();
  RunState state(store);
  const CoreByBruteForce core = core_of(state);
  EXPECT_GT(core.sites.size(), 500U);
  bool has_whole_leaf = false;
  for (const MortonKey leaf : state.octree().leaves())
    has_whole_leaf |= state.leaves().points(leaf).core.is_whole;
  EXPECT_TRUE(has_whole_leaf);
  expect_counts_of(state, core);
}

TEST_F(CoreOfARun, AroundALeafIsThatOfItsNeighbors) {
  Store store = open();
  RunState state(store);
  const auto sites = core_of(state).sites;
  std::size_t num_in = 0, num_empty = 0, num_within = 0;
  std::vector<MeshPoint> listed_points;
  for (const MortonKey leaf : state.octree().leaves())
    std::ranges::copy(state.leaves().points(leaf).points, std::back_inserter(listed_points));
  for (const MortonKey leaf : state.octree().leaves()) {
    const double distance = kCoreReach * state.size();
    const CoreRows rows = core_around(state, leaf, distance);
    const CoreIndex around(rows);
    const Box box = state.box(leaf);
    std::set<LatticeSite> expected;  // in leaves at most so far away, and the box around
    std::set<MortonKey> near;
    for (const MortonKey other : state.octree().leaves_within(state.frame(), box, distance))
      near.insert(other);
    const SiteBox region = state.lattice().sites_in(box.expanded(distance));
    for_each_site(region.expanded(2), [&](const LatticeSite& site) {
      const Point p = state.lattice().position(site);
      const bool is_in = sites.contains(site) && region.contains(site) &&
                         near.contains(state.octree().leaf_owning(state.frame(), p));
      ASSERT_EQ(around.contains(site), is_in);
      if (sites.contains(site) && box.squared_distance(p) <= distance * distance) {
        ASSERT_TRUE(is_in);
      }
      if (is_in) expected.insert(site);
    });
    if (!expected.empty()) {
      EXPECT_FALSE(around.is_empty());
    }
    num_empty += around.is_empty();
    num_in += expected.size();

    std::set<LatticeSite> listed;
    for (const auto& [first, count, body] : rows.rows)
      for (std::int32_t n = 0; n < static_cast<std::int32_t>(count); ++n)
        EXPECT_TRUE(listed.insert(first + LatticeSite{0, 0, 2 * n}).second) << "each site once";
    EXPECT_EQ(listed, expected);
    std::vector<MeshPoint> points;
    for (const LatticeSite& site : listed) points.push_back(state.lattice().point(site));

    const auto coordinate = [&](double low, double high) {
      return std::uniform_real_distribution<double>(low, high)(random_);
    };
    for (int n = 0; n < 5; ++n) {
      const Point q{coordinate(box.min.x, box.max.x), coordinate(box.min.y, box.max.y),
                    coordinate(box.min.z, box.max.z)};
      const double radius = coordinate(0, 2) * state.size();
      std::vector<MeshPoint> within{{}};
      around.within(q, radius, within);
      std::vector<MeshPoint> found = points;
      std::erase_if(found, [&](const MeshPoint& p) {
        return squared_distance(p.position, q) > radius * radius;
      });
      EXPECT_EQ(within, found);
    }

    // The one near a place that no other point of P is as close to.
    for (int n = 0; n < 50; ++n) {
      const Point q{coordinate(box.min.x, box.max.x), coordinate(box.min.y, box.max.y),
                    coordinate(box.min.z, box.max.z)};
      const auto nearest = [&](const auto& among) {
        double least = std::numeric_limits<double>::infinity();
        for (const MeshPoint& p : among) least = std::min(least, norm(p.position - q));
        return least;
      };
      const double core_distance = nearest(points);
      const double radius =
          std::min({2 * state.size(), nearest(listed_points), coordinate(0, 2) * state.size()});
      if (std::abs(radius - core_distance) < 1e-4 * state.size()) continue;
      EXPECT_EQ(around.has_within(q, radius), core_distance < radius);
      num_within += core_distance < radius;
    }
  }
  EXPECT_GT(num_in, 1000U);
  EXPECT_GT(num_empty, 0U);
  EXPECT_GT(num_within, 100U);
}

TEST_F(CoreOfARun, IsAskedSiteBySite) {
  Store store = open();
  RunState state(store);
  const auto sites = core_of(state).sites;
  for_each_site({{-16, -16, -16}, {17, 17, 17}}, [&](const LatticeSite& site) {
    ASSERT_EQ(is_core(state, site), sites.contains(site));
  });
  EXPECT_FALSE(is_core(state, {1001, 1, 1}));  // outside the octree
}

// A conversion changes no mesh: the same cells, but more of them are listed.
TEST_F(CoreOfARun, PointsMadeExplicitChangeNoMesh) {
  const auto before = all_cells(open().snapshot());
  const RunRecord run_before = *open().snapshot().run();
  std::vector<LatticeSite> sites = random_core_sites(25);
  for (std::size_t n = 0; n < 10; ++n) {  // and neighbors of them, if they are of the core
    const LatticeSite next = sites[n] + kLatticeNeighbors[random_() % kLatticeNeighbors.size()];
    if (core().sites.contains(next) && std::ranges::find(sites, next) == sites.end())
      sites.push_back(next);
  }
  {
    Store store = open();
    RunState state(store);
    const CoreByBruteForce all_core = core_of(state);
    for (const LatticeSite& site : sites) make_explicit(state, site);
    const CoreByBruteForce core = core_of(state);
    std::set<LatticeSite> expected = all_core.sites;
    for (const LatticeSite& site : sites) expected.erase(site);
    EXPECT_EQ(core.sites, expected);
    expect_counts_of(state, core);
    EXPECT_EQ(state.run().counts.num_points, run_before.counts.num_points);
    // The cells at these points are gone until they are listed.
    EXPECT_EQ(
        run_before.counts.num_cells - state.run().counts.num_cells,
        static_cast<std::uint64_t>(std::ranges::count_if(all_core.cells, [&](const SiteCell& cell) {
          return std::ranges::any_of(cell, [&](const LatticeSite& s) {
            return std::ranges::find(sites, s) != sites.end();
          });
        })));
    for (const LatticeSite& site : sites) {
      const MortonKey leaf =
          state.octree().leaf_owning(state.frame(), state.lattice().position(site));
      EXPECT_TRUE(state.leaves().info(leaf).queued);
      const std::vector<Point> asked = state.leaves().cells(leaf).asked;
      EXPECT_TRUE(state.leaves().info(leaf).first_new_id == 0 ||
                  std::ranges::find(asked, state.lattice().position(site)) != asked.end());
      EXPECT_TRUE(std::ranges::binary_search(state.leaves().points(leaf).points, site_id(site), {},
                                             &MeshPoint::id));
    }
    state.begin_phase(Phase::kRefine);
    state.commits().commit();
  }
  EXPECT_EQ(resume(scratch_ / "store").outcome, RunOutcome::kDone);
  Store store = open();
  EXPECT_TRUE(all_cells(store.snapshot()) == before);
  const AuditReport report = audit(store);
  EXPECT_TRUE(report.is_valid()) << described(report);
  EXPECT_EQ(report.num_cells, before.size());
  RunState state(store);
  expect_counts_of(state, core_of(state));
  EXPECT_EQ(state.run().counts.num_cells, run_before.counts.num_cells);
}

TEST_F(CoreOfARun, MayBeMadeExplicitAltogether) {
  const auto before = all_cells(open().snapshot());
  {
    Store store = open();
    RunState state(store);
    for (const LatticeSite& site : core_of(state).sites) make_explicit(state, site);
    const CoreByBruteForce core = core_of(state);
    EXPECT_TRUE(core.sites.empty());
    expect_counts_of(state, core);
    state.begin_phase(Phase::kRefine);
    state.commits().commit();
  }
  EXPECT_EQ(resume(scratch_ / "store").outcome, RunOutcome::kDone);
  EXPECT_TRUE(all_cells(open().snapshot()) == before);
}

TEST_F(CoreOfARun, IsSplitWithItsLeaf) {
  const Store store = open();
  const Snapshot snapshot = store.snapshot();
  const RunRecord run = *snapshot.run();
  std::map<int, int> num_with_core;  // by level
  for (const auto& [leaf, num] : core_of(store).num_points) ++num_with_core[leaf.level()];
  ASSERT_EQ(num_with_core.size(), 2U) << "no leaf with a core was split";
  const AuditReport report = audit(store);
  EXPECT_TRUE(report.is_valid()) << described(report);
  EXPECT_EQ(report.num_cells, run.counts.num_cells);
}

TEST_F(CoreOfARun, IsWrittenWithTheRest) {
  const Store store = open();
  const std::uint64_t num_cells = all_cells(store.snapshot()).size();
  const WriteSummary written = write_vtu(store, scratch_ / "mesh.vtu");
  EXPECT_EQ(written.num_cells, num_cells);
  EXPECT_EQ(written.num_cells, store.snapshot().run()->counts.num_cells);
  EXPECT_EQ(written.num_vertices, store.snapshot().run()->counts.num_points);
}

// ---- Damage

class DamagedCore : public CoreOfARun {
 protected:
  // A leaf with rows of a core, listed lattice points, and a site as below.
  MortonKey leaf() const {
    const auto all = core().sites;
    const Store store = open();
    const Snapshot snapshot = store.snapshot();
    const RunRecord run = *snapshot.run();
    for (const MortonKey key : snapshot.leaf_keys()) {
      const LeafPoints held = snapshot.points(key);
      const SiteBox box = lattice_of(run).sites_in(run.frame.box(key));
      if (held.core.rows.size() > 2 && find_deep_site(all, box) &&
          std::ranges::count(held.points, PointKind::kLattice, &MeshPoint::kind) > 0)
        return key;
    }
    throw std::runtime_error("no such leaf");
  }
  static std::optional<LatticeSite> find_deep_site(const std::set<LatticeSite>& core,
                                                   const SiteBox& box) {
    for (const LatticeSite& site : core)
      if (box.contains(site) &&
          std::ranges::all_of(kLatticeNeighbors,
                              [&](const LatticeSite& step) { return core.contains(site + step); }))
        return site;
    return std::nullopt;
  }
  SiteBox sites(MortonKey leaf) const {
    const RunRecord run = *open().snapshot().run();
    return lattice_of(run).sites_in(run.frame.box(leaf));
  }
  void edit_points(MortonKey leaf, const std::function<void(LeafPoints&)>& edit) const {
    Store store = open();
    Batch batch = store.begin();
    LeafPoints points = batch.points(leaf);
    edit(points);
    batch.put_points(leaf, points);
    batch.commit();
  }
  AuditReport report() const { return audit(open()); }
  // A site of the leaf's core with all cells in the core.
  LatticeSite deep_site(MortonKey leaf) const {
    return find_deep_site(core().sites, sites(leaf)).value();
  }
};

TEST_F(DamagedCore, IsNotThereToBeginWith) {
  const AuditReport whole = report();
  EXPECT_TRUE(whole.is_valid()) << described(whole);
}

TEST_F(DamagedCore, AuditFindsAMissingSite) {
  const MortonKey key = leaf();
  const LatticeSite gone = deep_site(key);
  const SiteBox box = sites(key);
  edit_points(key, [&](LeafPoints& points) { points.core = without(points.core, box, gone); });
  const AuditReport found = report();
  EXPECT_FALSE(found.is_valid());
  EXPECT_GT(found.num_off_surface_vertices, 0U);  // around the hole
}

TEST_F(DamagedCore, AuditFindsAMissingRow) {
  const MortonKey key = leaf();
  edit_points(key, [&](LeafPoints& points) {
    points.core.rows.erase(points.core.rows.begin() +
                           static_cast<std::ptrdiff_t>(random_() % points.core.rows.size()));
  });
  EXPECT_FALSE(report().is_valid());
}

TEST_F(DamagedCore, AuditFindsASiteTooMany) {
  const MortonKey key = leaf();
  const SiteBox box = sites(key);
  edit_points(key, [&](LeafPoints& points) {  // one that is listed besides
    const auto listed = std::ranges::find(points.points, PointKind::kLattice, &MeshPoint::kind);
    ASSERT_NE(listed, points.points.end());
    std::set<LatticeSite> all{site_of(listed->id)};
    for_each_core_site(points.core, box, box,
                       [&](const LatticeSite& site, std::uint64_t) { all.insert(site); });
    points.core = {};
    for (const LatticeSite& site : all) add_row({site, 1}, points.core);
  });
  const AuditReport found = report();
  EXPECT_FALSE(found.is_valid());
  EXPECT_GT(found.num_repeated_points, 0U);
}

TEST_F(DamagedCore, AuditFindsAPointAmongIt) {
  const MortonKey key = leaf();
  const RunRecord run = *open().snapshot().run();
  const Point p = lattice_of(run).position(deep_site(key));
  edit_points(key, [&](LeafPoints& points) {
    points.points.push_back({run.next_point_id,
                             p + 0.3 * run.parameters.size * Point{0.4, 0.3, 0.2},
                             PointKind::kVolume});
  });
  const AuditReport found = report();
  EXPECT_GT(found.num_nonempty_circumballs, 0U);
  EXPECT_GE(found.num_nonempty_circumballs, found.num_violations() - found.num_misplaced_points);
}

TEST_F(DamagedCore, AuditFindsRowsOutOfTheLeaf) {
  const MortonKey key = leaf();
  edit_points(key, [&](LeafPoints& points) { points.core.rows.back().count += 1000; });
  const AuditReport found = report();
  EXPECT_EQ(found.num_misplaced_points, 1U) << described(found);
}

// A cell is of the leaf of its smallest vertex that is not of the core, though another be smaller.
TEST_F(DamagedCore, AuditFindsACellInTheLeafOfACorePoint) {
  const auto sites = core().sites;
  Store store = open();
  const Snapshot snapshot = store.snapshot();
  const RunRecord run = *snapshot.run();
  const LinearOctree octree(snapshot.leaf_keys());
  for (const MortonKey from : snapshot.leaf_keys()) {
    LeafCells cells = snapshot.cells(from);
    for (std::size_t n = 0; n < cells.cells.size(); ++n) {
      std::array<std::uint64_t, 4> ids{};
      MortonKey to;
      for (std::size_t i = 0; i < 4; ++i) {
        ids[i] = cells.vertices[cells.cells[n][i]];
        if (ids[i] >= kFirstOtherId || !sites.contains(site_of(ids[i]))) continue;
        const MortonKey owner =
            octree.leaf_owning(run.frame, lattice_of(run).position(site_of(ids[i])));
        if (owner != from) to = owner;
      }
      if (!to.is_valid()) continue;
      // The vertices may be unused afterwards, which is no damage to audit.
      cells.cells.erase(cells.cells.begin() + static_cast<std::ptrdiff_t>(n));
      LeafCells others = snapshot.cells(to);
      std::set<std::uint64_t> vertices(others.vertices.begin(), others.vertices.end());
      std::vector<std::array<std::uint64_t, 4>> named{ids};
      for (const auto& [a, b, c, d] : others.cells)
        named.push_back(
            {others.vertices[a], others.vertices[b], others.vertices[c], others.vertices[d]});
      vertices.insert(ids.begin(), ids.end());
      others.vertices.assign(vertices.begin(), vertices.end());
      others.cells.clear();
      for (const auto& cell : named) {
        auto& indices = others.cells.emplace_back();
        for (std::size_t i = 0; i < 4; ++i)
          indices[i] =
              static_cast<std::uint32_t>(std::distance(vertices.begin(), vertices.find(cell[i])));
      }
      Batch batch = store.begin();
      batch.put_cells(from, cells);
      batch.put_cells(to, others);
      batch.commit();
      const AuditReport found = audit(store);
      EXPECT_EQ(found.num_misplaced_cells, 1U) << described(found);
      EXPECT_EQ(found.num_violations(), 1U) << described(found);
      return;
    }
  }
  FAIL() << "no cell with a core point of another leaf";
}

TEST_F(DamagedCore, WriterRefusesAWrongCountOfCells) {
  const MortonKey key = leaf();
  {
    Store store = open();
    Batch batch = store.begin();
    LeafInfo info = *batch.leaf(key);
    ++info.num_core_cells;
    batch.put_leaf(key, info);
    batch.commit();
  }
  const Store store = open();
  EXPECT_THROW(write_vtu(store, scratch_ / "mesh.vtu"), CorruptRecord);
  EXPECT_FALSE(std::filesystem::exists(scratch_ / "mesh.vtu"));
}

TEST_F(DamagedCore, WriterRefusesRowsOutOfTheLeaf) {
  const MortonKey key = leaf();
  edit_points(key, [&](LeafPoints& points) { points.core.rows.front().first.k += 1; });
  const Store store = open();
  EXPECT_THROW(write_vtu(store, scratch_ / "mesh.vtu"), CorruptRecord);
}

}  // namespace
}  // namespace locvol
