// Against every cell of the written mesh, one by one.
#include "engine/inspect/mesh_statistics.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <iterator>
#include <map>
#include <numbers>
#include <string>
#include <vector>

#include "engine/engine.h"
#include "engine/formats/writer.h"
#include "engine/inspect/cell_mesh.h"
#include "octree/size_field.h"
#include "refine/predicates.h"
#include "tests/engine/closed_shapes.h"
#include "tests/engine/hand_made_mesh.h"
#include "tests/stops_at.h"
#include "tests/temp_dir.h"
#include "tests/vtu_arrays.h"

namespace locvol {
namespace {

using namespace testing_shapes;

using CellCorners = std::array<Point, 4>;

std::vector<CellCorners> cells_of(const std::filesystem::path& file) {
  const VtuArrays vtu(file);
  const auto points = vtu.array<Point>("Float64", "Points");
  std::vector<CellCorners> cells;
  for (const auto& vertices : vtu.array<std::array<std::int32_t, 4>>("Int32", "connectivity")) {
    CellCorners& corners = cells.emplace_back();
    for (std::size_t i = 0; i < 4; ++i)
      corners[i] = points.at(static_cast<std::size_t>(vertices[i]));
  }
  return cells;
}

// The angle at each edge, in the plane across it.
std::array<double, 6> angles_of(const CellCorners& c) {
  std::array<double, 6> angles{};
  std::size_t num = 0;
  for (std::size_t i = 0; i < 4; ++i)
    for (std::size_t j = i + 1; j < 4; ++j) {
      std::array<Point, 2> across;
      std::size_t n = 0;
      const Point edge = (1 / norm(c[j] - c[i])) * (c[j] - c[i]);
      for (std::size_t k = 0; k < 4; ++k)
        if (k != i && k != j) across[n++] = (c[k] - c[i]) - dot(c[k] - c[i], edge) * edge;
      angles[num++] = std::atan2(norm(cross(across[0], across[1])), dot(across[0], across[1])) *
                      (180 / std::numbers::pi);
    }
  return angles;
}

void count(double value, Histogram& histogram) {
  const auto above = std::ranges::upper_bound(histogram.edges, value);
  const auto bin = static_cast<std::size_t>(above - histogram.edges.begin()) - 1;
  ++histogram.counts.at(std::min(bin, histogram.counts.size() - 1));
}

void count_over_size(double radius, double size, MeshStatistics& all) {
  count(radius / size, all.radii_over_size);
  all.max_radius_over_size = std::max(all.max_radius_over_size, radius / size);
  ++all.num_cells_by_octave[std::ilogb(size)];
}

MeshStatistics by_brute_force(const std::vector<CellCorners>& cells, double size,
                              double bound = 2) {
  MeshStatistics all;
  for (const CellCorners& c : cells) {
    const auto angles = angles_of(c);
    const auto [least, most] = std::ranges::minmax(angles);
    for (const double angle : angles) count(angle, all.dihedral_angles);
    count(least, all.min_dihedral_angles);
    const CellQuality quality = quality_of(c);
    count(quality.radius_edge_ratio, all.radius_edge_ratios);
    all.min_dihedral_degrees = std::min(all.min_dihedral_degrees, least);
    all.max_dihedral_degrees = std::max(all.max_dihedral_degrees, most);
    all.max_radius_edge_ratio = std::max(all.max_radius_edge_ratio, quality.radius_edge_ratio);
    if (quality.radius_edge_ratio > bound)
      ++all.num_above_ratio;
    else
      all.max_bounded_ratio = std::max(all.max_bounded_ratio, quality.radius_edge_ratio);
    all.max_circumradius = std::max(all.max_circumradius, quality.circumradius / size);
    count_over_size(quality.circumradius, size, all);
    all.volume += dot(c[1] - c[0], cross(c[2] - c[0], c[3] - c[0])) / 6;
    ++all.num_cells;
  }
  return all;
}

void expect_same(const MeshStatistics& found, const MeshStatistics& expected) {
  EXPECT_EQ(found.num_cells, expected.num_cells);
  EXPECT_EQ(found.dihedral_angles.counts, expected.dihedral_angles.counts);
  EXPECT_EQ(found.min_dihedral_angles.counts, expected.min_dihedral_angles.counts);
  EXPECT_EQ(found.radius_edge_ratios.counts, expected.radius_edge_ratios.counts);
  EXPECT_EQ(found.dihedral_angles.total(), 6 * found.num_cells);
  EXPECT_EQ(found.min_dihedral_angles.total(), found.num_cells);
  EXPECT_EQ(found.radius_edge_ratios.total(), found.num_cells);
  EXPECT_EQ(found.radii_over_size.counts, expected.radii_over_size.counts);
  EXPECT_EQ(found.num_cells_by_octave, expected.num_cells_by_octave);
  // The core's cells are taken without their displacement, some 1e-5 of their size.
  EXPECT_NEAR(found.volume, expected.volume, 1e-7 * expected.volume);
  EXPECT_NEAR(found.min_dihedral_degrees, expected.min_dihedral_degrees, 1e-3);
  EXPECT_NEAR(found.max_dihedral_degrees, expected.max_dihedral_degrees, 1e-3);
  EXPECT_NEAR(found.max_radius_edge_ratio, expected.max_radius_edge_ratio, 1e-4);
  EXPECT_NEAR(found.max_bounded_ratio, expected.max_bounded_ratio, 1e-4);
  EXPECT_EQ(found.num_above_ratio, expected.num_above_ratio);
  EXPECT_NEAR(found.max_circumradius, expected.max_circumradius, 1e-4);
  EXPECT_NEAR(found.max_radius_over_size, expected.max_radius_over_size, 1e-4);
}

// A finished run of the shape.
Store meshed(const TempDir& dir, const Shape& shape, double size, std::uint64_t leaf_capacity = 0,
             double growth = 0, double min_dihedral = 15) {
  write_off(shape, dir / "surface.off");
  MeshOptions options;
  options.input = dir / "surface.off";
  options.store = dir / "store";
  options.size = {size, false};
  options.leaf_capacity = leaf_capacity;
  options.growth = growth;
  options.min_dihedral = min_dihedral;
  EXPECT_EQ(mesh(options).outcome, RunOutcome::kDone);
  return Store::open(options.store, {.read_only = true});
}

TEST(MeshStatistics, AreThoseOfTheWrittenCells) {
  for (const Shape& shape : {sphere(1, 31, 64), torus(1, 0.4, 60, 30)}) {
    const TempDir dir;
    const Store store = meshed(dir, shape, 0.07, 200);  // many leaves
    write_vtu(store, dir / "mesh.vtu");
    const MeshStatistics statistics = mesh_statistics(store);
    EXPECT_GT(statistics.num_core_cells, 0u);
    EXPECT_LT(statistics.num_core_cells, statistics.num_cells);
    expect_same(statistics, by_brute_force(cells_of(dir / "mesh.vtu"), 0.07));
  }
}

// The larger circumradius over the smaller, of two cells with a common facet.
double largest_ratio(const std::vector<CellCorners>& cells) {
  std::map<std::array<std::array<double, 3>, 3>, double> radii;  // by facet
  double most = 0;
  for (const CellCorners& c : cells) {
    const double radius = quality_of(c).circumradius;
    for (std::size_t across = 0; across < 4; ++across) {
      std::array<std::array<double, 3>, 3> facet{};
      for (std::size_t i = 0, n = 0; i < 4; ++i)
        if (i != across) facet[n++] = {c[i].x, c[i].y, c[i].z};
      std::ranges::sort(facet);
      const auto [other, is_new] = radii.try_emplace(facet, radius);
      if (!is_new) most = std::max({most, radius / other->second, other->second / radius});
    }
  }
  return most;
}

TEST(MeshStatistics, AreThoseOfTheWrittenCellsWhereSizesVary) {
  for (const std::size_t leaf_capacity : {200, 100'000}) {
    const TempDir dir;
    const Store store = meshed(dir, sphere(1, 31, 64), 0.06, leaf_capacity, 0.3);
    write_vtu(store, dir / "mesh.vtu");
    const RunRecord run = *store.snapshot().run();
    std::vector<SizeCube> cubes;
    for (const MortonKey leaf : store.snapshot().leaf_keys())
      std::ranges::copy(store.snapshot().sizes(leaf).cubes, std::back_inserter(cubes));
    const std::vector<CellCorners> cells = cells_of(dir / "mesh.vtu");
    MeshStatistics expected;
    for (const CellCorners& c : cells) {
      const Circumsphere ball = circumsphere_of(c[0], c[1], c[2], c[3]);
      count_over_size(ball.radius, size_at(run.parameters.sizes(), run.frame, cubes, ball.center),
                      expected);
    }
    const MeshStatistics found = mesh_statistics(store, 2);
    ASSERT_EQ(found.num_cells, cells.size());
    EXPECT_GT(found.num_cells_by_octave.size(), 1u);
    EXPECT_EQ(found.num_cells_by_octave, expected.num_cells_by_octave);
    EXPECT_EQ(found.radii_over_size.total(), found.num_cells);
    EXPECT_EQ(found.radii_over_size.counts, expected.radii_over_size.counts);
    EXPECT_NEAR(found.max_radius_over_size, expected.max_radius_over_size, 1e-6);
    EXPECT_LT(found.max_radius_over_size, 1);
    EXPECT_GT(found.max_circumradius, 1);
    EXPECT_NEAR(found.max_neighbor_ratio, largest_ratio(cells), 1e-6);
  }
}

TEST(MeshStatistics, AreTheSameToTheBitOnAnyNumberOfThreads) {
  const TempDir dir;
  const Store store = meshed(dir, sphere(1, 31, 64), 0.03);
  const MeshStatistics one = mesh_statistics(store, 1), four = mesh_statistics(store, 4);
  ASSERT_GT(one.num_cells - one.num_core_cells, 150'000u);  // several tasks
  EXPECT_EQ(one.volume, four.volume);
  EXPECT_EQ(one.min_dihedral_degrees, four.min_dihedral_degrees);
  EXPECT_EQ(one.max_dihedral_degrees, four.max_dihedral_degrees);
  EXPECT_EQ(one.max_radius_edge_ratio, four.max_radius_edge_ratio);
  EXPECT_EQ(one.max_circumradius, four.max_circumradius);
  EXPECT_EQ(one.dihedral_angles.counts, four.dihedral_angles.counts);
  EXPECT_EQ(one.min_dihedral_angles.counts, four.min_dihedral_angles.counts);
  EXPECT_EQ(one.radius_edge_ratios.counts, four.radius_edge_ratios.counts);
}

// Whose points are all listed, and whose cells cross from leaf to leaf.
TEST(MeshStatistics, DoNotDependOnTheOctree) {
  for (const unsigned seed : {3u, 5u}) {
    HandMadeMesh mesh = random_delaunay(seed, 30);
    std::vector<CellCorners> cells;
    for (const CellIds& cell : mesh.cells) cells.push_back(mesh.corners(cell));
    for (const LinearOctree& octree : octrees()) {
      const TempDir dir;
      expect_same(mesh_statistics(HandMadeStore(mesh, octree).write(dir / "store")),
                  by_brute_force(cells, mesh.size, mesh.radius_edge_bound));
    }
  }
}

TEST(MeshStatistics, KnowTheRegularTetrahedronAndAFlatCell) {
  HandMadeMesh mesh;
  mesh.points = {{0, {0, 0, 0}, PointKind::kVolume}, {1, {1, 1, 0}, PointKind::kVolume},
                 {2, {1, 0, 1}, PointKind::kVolume}, {3, {0, 1, 1}, PointKind::kVolume},
                 {4, {1, 0, 0}, PointKind::kVolume}, {5, {0, 1, 0}, PointKind::kVolume}};
  mesh.cells = {{0, 2, 1, 3}};
  const TempDir dir;
  const auto statistics_of = [&](const char* name) {
    return mesh_statistics(HandMadeStore(mesh, octrees().front()).write(dir / name));
  };
  const double angle = std::acos(1.0 / 3) * (180 / std::numbers::pi);
  const MeshStatistics regular = statistics_of("regular");
  EXPECT_NEAR(regular.volume, 1.0 / 3, 1e-15);
  EXPECT_NEAR(regular.min_dihedral_degrees, angle, 1e-12);
  EXPECT_NEAR(regular.max_dihedral_degrees, angle, 1e-12);
  EXPECT_NEAR(regular.max_radius_edge_ratio, std::sqrt(6) / 4, 1e-15);
  EXPECT_NEAR(regular.max_circumradius, std::sqrt(3) / 2, 1e-15);

  mesh.cells = {{0, 4, 1, 5}};
  const MeshStatistics flat = statistics_of("flat");
  EXPECT_EQ(flat.volume, 0);
  EXPECT_EQ(flat.min_dihedral_degrees, 0);
  EXPECT_EQ(flat.max_dihedral_degrees, 180);
  EXPECT_TRUE(std::isinf(flat.max_circumradius));
  EXPECT_EQ(flat.radius_edge_ratios.counts.back(), 1u);
  EXPECT_EQ(flat.dihedral_angles.counts.front() + flat.dihedral_angles.counts.back(), 6u);
}

// In the order of leaves, on any number of threads.
TEST(MeshStatistics, CountCellsBelowTheBoundAndTellWhereTheyAre) {
  const HandMadeMesh mesh = random_delaunay(7, 30);
  std::vector<double> smallest;
  for (const CellIds& cell : mesh.cells)
    smallest.push_back(std::ranges::min(angles_of(mesh.corners(cell))));
  for (const double bound : {0.0, 5.0, 20.0}) {
    const auto num_poor = static_cast<std::uint64_t>(
        std::ranges::count_if(smallest, [&](double angle) { return angle < bound; }));
    EXPECT_EQ(num_poor > 0, bound > 0);
    for (const int num_threads : {1, 3}) {
      const TempDir dir;
      HandMadeStore hand_made(mesh, mixed_octree());
      hand_made.min_dihedral = bound;
      const Store store = hand_made.write(dir / "store");
      const MeshStatistics statistics = mesh_statistics(store, num_threads);
      EXPECT_EQ(statistics.min_dihedral_bound, bound);
      EXPECT_EQ(statistics.num_poor_cells, num_poor);
      std::vector<LeafPoorCell> cells;
      const auto take = [&](const LeafPoorCell& cell) {
        cells.push_back(cell);
        return true;
      };
      for_each_poor_cell(store, take, num_threads);
      ASSERT_EQ(cells.size(), num_poor);
      EXPECT_TRUE(std::ranges::is_sorted(cells, {}, &LeafPoorCell::leaf));
      std::vector<bool> is_told(mesh.cells.size());
      for (const LeafPoorCell& cell : cells) {
        const auto c = std::ranges::find_if(mesh.cells, [&](const CellIds& ids) {
          const CellCorners corners = mesh.corners(ids);
          return std::ranges::all_of(corners, [&](const Point& p) {
            return std::abs(norm(p - cell.position) - cell.radius) < 1e-6 * cell.radius;
          });
        });
        ASSERT_NE(c, mesh.cells.end());
        const auto i = static_cast<std::size_t>(c - mesh.cells.begin());
        EXPECT_FALSE(is_told[i]);
        is_told[i] = true;
        EXPECT_NEAR(cell.degrees, smallest[i], 1e-6);
        EXPECT_LT(cell.degrees, bound);
      }
      std::uint64_t num_taken = 0;
      for_each_poor_cell(
          store, [&](const LeafPoorCell&) { return ++num_taken < 2; }, num_threads);
      EXPECT_EQ(num_taken, std::min<std::uint64_t>(num_poor, 2));
    }
  }
}

// What a wall and an acute edge force, and no more.
TEST(MeshStatistics, TellsApartWhatTheSurfaceForces) {
  const auto statistics_of = [](const Shape& shape, double min_dihedral, int num_threads) {
    const TempDir dir;
    const Store store = meshed(dir, shape, 1, 200, 0, min_dihedral);
    const MeshStatistics all = mesh_statistics(store, num_threads);
    std::uint64_t num_forced = 0;
    for_each_poor_cell(store, [&](const LeafPoorCell& cell) {
      num_forced += cell.is_forced ? 1 : 0;
      return true;
    });
    EXPECT_EQ(num_forced, all.num_forced_cells);
    return all;
  };
  const Shape plate = box_shape({{0, 0, 0}, {6.3, 5.1, 0.1}});
  const Shape knife = testing_shapes::wedge(5, 6, 0.15);
  for (const Shape& shape : {plate, knife}) {
    const MeshStatistics all = statistics_of(shape, 15, 1);
    EXPECT_GT(all.num_poor_cells, 5u);
    EXPECT_GT(10 * all.num_forced_cells, 9 * all.num_poor_cells);
    EXPECT_EQ(statistics_of(shape, 15, 3).num_forced_cells, all.num_forced_cells);
  }
  const Shape block = box_shape({{0, 0, 0}, {6.3, 5.1, 4.2}});
  EXPECT_EQ(statistics_of(block, 15, 1).num_poor_cells, 0u);
  const MeshStatistics asked_too_much = statistics_of(block, 40, 1);
  EXPECT_GT(asked_too_much.num_poor_cells, 20u);
  EXPECT_EQ(asked_too_much.num_forced_cells, 0u);
}

// 45 degrees in all cells but for rounding.
TEST(MeshStatistics, DoNotTakeRoundingForAPoorCell) {
  const TempDir dir;
  HandMadeStore hand_made(cubes(3, [](int, int, int) { return true; }), mixed_octree());
  hand_made.min_dihedral = 45;
  EXPECT_EQ(mesh_statistics(hand_made.write(dir / "store")).num_poor_cells, 0u);
  hand_made.min_dihedral = 45.001;
  const MeshStatistics statistics = mesh_statistics(hand_made.write(dir / "other"));
  EXPECT_EQ(statistics.num_poor_cells, statistics.num_cells);
}

TEST(MeshStatistics, AreStoppedAtAnyPiece) {
  const TempDir dir;
  const Store store =
      HandMadeStore(lattice_ball({2, 2, 2}, 2.6), LinearOctree::uniform(1)).write(dir / "store");
  const StopsAt never(StopsAt::kNever);
  mesh_statistics(store, 1, {}, &never);  // which asks least: each thread asks once more at the end
  ASSERT_GT(never.num_asked(), 0U);
  for (std::uint64_t question = 1; question <= never.num_asked(); ++question) {
    const StopsAt stop(question);
    EXPECT_THROW(mesh_statistics(store, 2, {}, &stop), Stopped);
  }
}

TEST(MeshStatistics, RefuseAnUnfinishedRunAndCellsOfUnknownPoints) {
  const TempDir dir;
  HandMadeMesh mesh = random_delaunay(3, 20);
  HandMadeStore unfinished(mesh, octrees().front());
  unfinished.phase = Phase::kRefine;
  EXPECT_THROW(mesh_statistics(unfinished.write(dir / "unfinished")), StoreError);
  mesh.cells.push_back(mesh.cells.front());
  mesh.cells.back()[1] = 999'999;
  EXPECT_THROW(mesh_statistics(HandMadeStore(mesh, octrees().front()).write(dir / "unknown"), 2),
               CorruptRecord);
}

}  // namespace
}  // namespace locvol
