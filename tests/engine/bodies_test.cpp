// Whole runs of several bodies: what lies in what, their volumes, and what lies between them.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <map>
#include <numbers>
#include <numeric>
#include <optional>
#include <random>
#include <set>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "engine/audit/audit.h"
#include "engine/engine.h"
#include "engine/exchange/thread_ranks.h"
#include "engine/formats/writer.h"
#include "engine/inspect/mesh_statistics.h"
#include "engine/output/mesh_source.h"
#include "engine/rank_engine.h"
#include "engine/ranks/move_leaves.h"
#include "engine/ranks/rank_store.h"
#include "engine/shared/cell_quality.h"
#include "engine/shared/input_error.h"
#include "tests/engine/closed_shapes.h"
#include "tests/engine/store_contents.h"
#include "tests/file_bytes.h"
#include "tests/stops_at.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

using testing_shapes::box;
using testing_shapes::Shape;
using testing_shapes::sphere;

constexpr double kPi = std::numbers::pi;

Shape moved(Shape shape, const Point& by) {
  for (Point& p : shape.vertices) p = p + by;
  return shape;
}

// What a mesh with facets in balls of this size may cut off a sphere, or add around it: two thirds
// of it, at most, over the square of the radius.
double rounding(double radius, double size) { return 0.65 * 4 / 3 * kPi * size * size * radius; }
constexpr double kPlane = 1e-6;  // the lattice core's volume is a formula's

// What lies between two angles around the z axis, in degrees, with so many edges on its rim.
Shape sector(double from, double to, int num) {
  Shape shape{{{0, 0, 0}, {0, 0, 1}}, {}};
  for (int i = 0; i <= num; ++i) {
    const double angle = std::fmod(from + (to - from) * i / num, 360) * kPi / 180;
    for (const double z : {0.0, 1.0})
      shape.vertices.push_back({std::cos(angle), std::sin(angle), z});
  }
  const auto last = static_cast<std::uint32_t>(2 + 2 * num);
  for (std::uint32_t p = 2; p < last; p += 2)
    for (const auto& t : {std::array<std::uint32_t, 3>{0, p + 2, p},
                          {1, p + 1, p + 3},
                          {p, p + 2, p + 3},
                          {p, p + 3, p + 1}})
      shape.triangles.push_back(t);
  for (const auto& t :
       {std::array<std::uint32_t, 3>{0, 2, 3}, {0, 3, 1}, {0, last + 1, last}, {0, 1, last + 1}})
    shape.triangles.push_back(t);
  return shape;
}

std::uint64_t num_insertions(const Contents& contents) {
  const auto& by_condition = contents.run.counts.num_insertions;
  return std::accumulate(by_condition.begin(), by_condition.end(), std::uint64_t{0});
}

double volume_of(const Shape& shape) {
  double six = 0;
  for (const auto& [a, b, c] : shape.triangles)
    six += dot(shape.vertices[a], cross(shape.vertices[b], shape.vertices[c]));
  return six / 6;
}

class Bodies : public testing::Test {
 protected:
  std::filesystem::path off(const std::string& name, const Shape& shape) {
    const std::filesystem::path file = dir_ / (name + ".off");
    std::ofstream out(file);
    out.precision(17);
    out << "OFF\n" << shape.vertices.size() << ' ' << shape.triangles.size() << " 0\n";
    for (const Point& p : shape.vertices) out << p.x << ' ' << p.y << ' ' << p.z << '\n';
    for (const auto& [a, b, c] : shape.triangles) out << "3 " << a << ' ' << b << ' ' << c << '\n';
    return file;
  }

  // One file, with a group of each name; of an empty name, none begins.
  std::filesystem::path obj(const std::string& name,
                            const std::vector<std::pair<std::string, Shape>>& shapes) {
    const std::filesystem::path file = dir_ / (name + ".obj");
    std::ofstream out(file);
    out.precision(17);
    std::size_t first = 1;
    for (const auto& [group, shape] : shapes) {
      if (!group.empty()) out << "g " << group << '\n';
      for (const Point& p : shape.vertices) out << "v " << p.x << ' ' << p.y << ' ' << p.z << '\n';
      for (const auto& [a, b, c] : shape.triangles)
        out << "f " << first + a << ' ' << first + b << ' ' << first + c << '\n';
      first += shape.vertices.size();
    }
    return file;
  }

  MeshOptions options(const std::vector<std::filesystem::path>& files, double size) {
    MeshOptions options;
    options.input = files.front();
    options.more_inputs.assign(files.begin() + 1, files.end());
    options.size = {size, false};
    options.leaf_capacity = 400;
    return options;
  }

  Contents meshed(MeshOptions options, const std::string& name, int num_threads = 1) {
    options.store = dir_ / name;
    RunControl control;
    control.num_threads = num_threads;
    mesh(options, control);
    return contents_of(options.store);
  }

  // By three ranks, whose stores are joined.
  Contents meshed_on_ranks(MeshOptions options) {
    options.store = dir_ / "ranks-%r";
    run_as_ranks(3, [&](Exchange& exchange) {
      RunControl control;
      control.num_threads = 1;
      mesh_as_rank(options, control, exchange);
      std::optional<Store> whole;
      if (exchange.rank() == 0) whole = Store::open(dir_ / "joined", {.create = true});
      const Store own =
          Store::open(store_of_rank(options.store, exchange.rank()), {.read_only = true});
      join_leaves({&own, 1}, whole ? &*whole : nullptr, exchange);
    });
    return contents_of(dir_ / "joined");
  }

  // Of a run that is stopped again and again, each time `step` looks later, and goes on by the same
  // command, every other time from the store alone, too.
  Contents meshed_with_stops(MeshOptions options, std::uint64_t step) {
    options.store = dir_ / "again";
    int num_stops = 0;
    for (std::uint64_t last = 3;; last += step) {
      StopsAt stops(last);
      RunControl control;
      control.num_threads = 1;
      control.is_stopped = [&] { return stops.is_stopped(); };
      if (mesh(options, control).outcome != RunOutcome::kInterrupted) break;
      if (++num_stops == 1000) {
        ADD_FAILURE() << "it does not end";
        break;
      }
      if (num_stops % 2 != 0) continue;
      StopsAt more(last);
      control.is_stopped = [&] { return more.is_stopped(); };
      if (resume(options.store, control).outcome != RunOutcome::kInterrupted) break;
    }
    EXPECT_GT(num_stops, 1);
    return contents_of(options.store);
  }

  // The audit finds nothing, volumes are those that are expected, and what lies between two bodies
  // is there once. Returns how many facets each pair of bodies has.
  std::map<std::pair<BodyId, BodyId>, std::uint64_t> check(const std::string& name,
                                                           const std::vector<double>& volumes,
                                                           const std::vector<double>& tolerances,
                                                           std::uint64_t most_poor = 0) {
    const Store store = Store::open(dir_ / name, {.read_only = true});
    const AuditReport report = audit(store);
    EXPECT_TRUE(report.is_valid());
    for (const std::string& violation : report.violations) ADD_FAILURE() << violation;
    EXPECT_LE(report.num_poor_cells, most_poor);
    EXPECT_EQ(report.num_components, report.surface_num_components);
    EXPECT_EQ(report.euler_characteristic, report.surface_euler_characteristic);
    const MeshStatistics statistics = mesh_statistics(store);
    EXPECT_EQ(statistics.bodies.size(), volumes.size());
    std::uint64_t num_cells = 0;
    for (std::size_t b = 0; b < statistics.bodies.size(); ++b) {
      EXPECT_NEAR(statistics.bodies[b].volume, volumes[b], tolerances[b]) << b;
      EXPECT_NEAR(report.body_volumes.at(b), statistics.bodies[b].volume, kPlane * volumes[b]);
      EXPECT_NEAR(report.surface_body_volumes.at(b), volumes[b], 1e-9 * volumes[b]);
      num_cells += statistics.bodies[b].num_cells;
    }
    EXPECT_EQ(num_cells, statistics.num_cells);

    MeshSource source(store, dir_ / "mesh", 1);
    std::map<std::array<std::int64_t, 3>, std::vector<BodyId>> sides;
    std::vector<std::uint64_t> num_of_body(volumes.size());
    source.for_each_piece(
        {.has_cells = true}, [](const MeshPiece& piece) { return piece; },
        [&](const MeshPiece& piece) {
          ASSERT_EQ(piece.bodies.size(), piece.cells.size());
          for (std::size_t i = 0; i < piece.cells.size(); ++i) {
            ++num_of_body.at(piece.bodies[i] - 1);
            for (std::size_t k = 0; k < 4; ++k) {
              std::array<std::int64_t, 3> facet{};
              for (std::size_t j = 0, n = 0; j < 4; ++j)
                if (j != k) facet[n++] = piece.cells[i][j];
              std::ranges::sort(facet);
              sides[facet].push_back(piece.bodies[i]);
            }
          }
        });
    for (std::size_t b = 0; b < num_of_body.size(); ++b)
      EXPECT_EQ(num_of_body[b], statistics.bodies.at(b).num_cells);
    std::map<std::pair<BodyId, BodyId>, std::uint64_t> expected, found;
    for (auto& [facet, bodies] : sides) {
      if (bodies.size() == 1) bodies.push_back(kNoBody);
      EXPECT_EQ(bodies.size(), 2U);
      if (bodies[0] != bodies[1])
        ++expected[{std::max(bodies[0], bodies[1]), std::min(bodies[0], bodies[1])}];
    }
    const auto facets = source.boundary().facets({});
    while (const auto some = facets())
      for (const BoundaryFacet& facet : some->facets)
        ++found[{facet.labels.behind, facet.labels.before}];
    EXPECT_EQ(found, expected);
    return found;
  }

  // Of each cell the body, the circumradius, and how far its centroid is from the plane x = 1.
  struct SizedCell {
    BodyId body = kNoBody;
    double radius = 0, distance = 0;
  };
  std::vector<SizedCell> cells_of(const std::string& name) {
    const Store store = Store::open(dir_ / name, {.read_only = true});
    MeshSource source(store, dir_ / "mesh", 1);
    std::vector<Point> points;
    std::vector<std::pair<BodyId, MeshPiece::Cell>> cells;
    source.for_each_piece(
        {.has_points = true, .has_cells = true}, [](const MeshPiece& piece) { return piece; },
        [&](const MeshPiece& piece) {
          for (const auto& [x, y, z] : piece.points) points.push_back({x, y, z});
          for (std::size_t i = 0; i < piece.cells.size(); ++i)
            cells.emplace_back(piece.body_of(i), piece.cells[i]);
        });
    std::vector<SizedCell> sized;
    for (const auto& [body, cell] : cells) {
      std::array<Point, 4> corners;
      Point sum;
      for (std::size_t k = 0; k < 4; ++k) {
        corners[k] = points.at(static_cast<std::size_t>(cell[k]));
        sum = sum + corners[k];
      }
      sized.push_back({body, quality_of(corners).circumradius, std::abs(sum.x / 4 - 1)});
    }
    return sized;
  }
  static double largest(const std::vector<SizedCell>& cells, BodyId body, double from, double to) {
    double most = 0;
    for (const SizedCell& cell : cells)
      if (cell.body == body && cell.distance >= from && cell.distance < to)
        most = std::max(most, cell.radius);
    return most;
  }

  std::string refusal_of(const MeshOptions& options) {
    try {
      meshed(options, "refused");
    } catch (const InputError& e) {
      return e.what();
    }
    return "none";
  }

  TempDir dir_;
};

TEST_F(Bodies, ASphereInASphereHasTwo) {
  const Shape outer = sphere(1, 30, 60), inner = sphere(0.5, 20, 40);
  const MeshOptions options = this->options({off("shell", outer), off("core", inner)}, 0.15);
  const Contents contents = meshed(options, "run");
  ASSERT_EQ(contents.sheets.bodies.size(), 2U);
  EXPECT_EQ(contents.sheets.bodies[0].name, "shell");
  EXPECT_EQ(contents.sheets.bodies[1].name, "core");
  EXPECT_EQ(contents.sheets.bodies[0].around, kNoBody);
  EXPECT_EQ(contents.sheets.bodies[1].around, 1U);
  const auto facets = check("run", {volume_of(outer) - volume_of(inner), volume_of(inner)},
                            {rounding(1, 0.15), rounding(0.5, 0.15)});
  EXPECT_EQ(facets.size(), 2U);
  EXPECT_TRUE(facets.contains({1, 0}) && facets.contains({2, 1}));
  EXPECT_TRUE(are_equal(contents, meshed(options, "threads", 3)));
}

TEST_F(Bodies, TheOrderOfTheFilesDecidesNoThingButNumbers) {
  const Shape outer = sphere(1, 20, 40), inner = sphere(0.5, 12, 24);
  const MeshOptions options = this->options({off("core", inner), off("shell", outer)}, 0.2);
  meshed(options, "run");
  const auto facets = check("run", {volume_of(inner), volume_of(outer) - volume_of(inner)},
                            {rounding(0.5, 0.2), rounding(1, 0.2)});
  EXPECT_TRUE(facets.contains({2, 0}) && facets.contains({2, 1}));
}

TEST_F(Bodies, ASphereInABoxKeepsTheBoxExactly) {
  const Shape outer = box({-1, -1, -1}, {1, 1, 1}), inner = sphere(0.6, 20, 40);
  const MeshOptions options = this->options({off("box", outer), off("ball", inner)}, 0.2);
  meshed(options, "run");
  check("run", {volume_of(outer) - volume_of(inner), volume_of(inner)},
        {rounding(0.6, 0.2), rounding(0.6, 0.2)});
  const AuditReport report = audit(Store::open(dir_ / "run", {.read_only = true}));
  EXPECT_NEAR(report.volume, 8, 1e-9);
}

TEST_F(Bodies, ABoxInABoxIsExact) {
  const Shape outer = box({-1, -1, -1}, {1, 1, 1}),
              inner = box({-0.5, -0.4, -0.3}, {0.3, 0.4, 0.5});
  const MeshOptions options = this->options({off("outer", outer), off("inner", inner)}, 0.2);
  meshed(options, "run");
  check("run", {volume_of(outer) - volume_of(inner), volume_of(inner)}, {kPlane, kPlane});
}

TEST_F(Bodies, ThreeInEachOther) {
  const Shape a = sphere(1, 20, 40), b = sphere(0.7, 16, 32), c = sphere(0.35, 12, 24);
  MeshOptions options = this->options({obj("three", {{"", a}, {"", b}, {"", c}})}, 0.14);
  options.has_bodies = true;
  const Contents contents = meshed(options, "run");
  ASSERT_EQ(contents.sheets.bodies.size(), 3U);
  EXPECT_EQ(contents.sheets.bodies[2].around, 2U);
  const auto facets =
      check("run", {volume_of(a) - volume_of(b), volume_of(b) - volume_of(c), volume_of(c)},
            {rounding(1, 0.14), rounding(0.7, 0.14), rounding(0.35, 0.14)});
  EXPECT_EQ(facets.size(), 3U);
}

TEST_F(Bodies, SideBySide) {
  const Shape a = sphere(1, 16, 32), b = moved(sphere(0.8, 16, 32), {2.2, 0, 0});
  const MeshOptions options = this->options({off("left", a), off("right", b)}, 0.2);
  meshed(options, "run");
  const auto facets =
      check("run", {volume_of(a), volume_of(b)}, {rounding(1, 0.2), rounding(0.8, 0.2)});
  EXPECT_TRUE(facets.contains({1, 0}) && facets.contains({2, 0}));
}

TEST_F(Bodies, AVoidIsACavityOfWhatItLiesIn) {
  const Shape outer = sphere(1, 20, 40), inner = sphere(0.5, 12, 24);
  MeshOptions options = this->options({off("shell", outer), off("hole", inner)}, 0.2);
  options.voids = {"hole"};
  const Contents contents = meshed(options, "void");
  ASSERT_EQ(contents.sheets.bodies.size(), 1U);
  EXPECT_EQ(contents.sheets.bodies[0].name, "shell");
  // As the cavity that it is in one file.
  MeshOptions one = this->options({obj("one", {{"", outer}, {"", inner}})}, 0.2);
  const Contents cavity = meshed(one, "cavity");
  ASSERT_EQ(contents.leaves.size(), cavity.leaves.size());
  for (auto a = contents.leaves.begin(), b = cavity.leaves.begin(); b != cavity.leaves.end();
       ++a, ++b)
    EXPECT_TRUE(a->second.cells == b->second.cells);
}

TEST_F(Bodies, GroupsThatAreClosedByThemselvesAreBodiesOnRequest) {
  const Shape outer = box({-1, -1, -1}, {1, 1, 1}), inner = sphere(0.5, 12, 24);
  MeshOptions options = this->options({obj("both", {{"case", outer}, {"ball", inner}})}, 0.2);
  const Contents cavity = meshed(options, "cavity");
  EXPECT_TRUE(cavity.sheets.bodies.empty());
  options.has_bodies = true;
  const Contents contents = meshed(options, "run");
  ASSERT_EQ(contents.sheets.bodies.size(), 2U);
  EXPECT_EQ(contents.sheets.bodies[0].name, "case");
  EXPECT_EQ(contents.sheets.bodies[1].name, "ball");
  check("run", {8 - volume_of(inner), volume_of(inner)}, {rounding(0.5, 0.2), rounding(0.5, 0.2)});
}

TEST_F(Bodies, FilesThatAreClosedTogetherAloneAreSheetsOfOne) {
  Shape lid = box({0, 0, 0}, {1, 1, 1}), rest = lid;
  lid.triangles.erase(lid.triangles.begin() + 2, lid.triangles.end());
  rest.triangles.erase(rest.triangles.begin(), rest.triangles.begin() + 2);
  const MeshOptions options =
      this->options({off("lid", lid), off("rest", rest),
                     off("ball", moved(sphere(0.2, 10, 20), {0.5, 0.5, 0.5}))},
                    0.15);
  const Contents contents = meshed(options, "run");
  ASSERT_EQ(contents.sheets.bodies.size(), 2U);
  EXPECT_EQ(contents.sheets.bodies[0].name, "lid+rest");
  EXPECT_EQ(contents.sheets.sheets.front().name, "lid");
}

TEST_F(Bodies, AnEmptyCavityMayHoldABody) {
  const Shape outer = sphere(1, 20, 40), hole = sphere(0.7, 16, 32), inner = sphere(0.35, 10, 20);
  const MeshOptions options =
      this->options({obj("case", {{"", outer}, {"", hole}}), off("ball", inner)}, 0.18);
  const Contents contents = meshed(options, "run");
  ASSERT_EQ(contents.sheets.bodies.size(), 2U);
  EXPECT_EQ(contents.sheets.bodies[0].num_shells, 2U);
  const auto facets = check("run", {volume_of(outer) - volume_of(hole), volume_of(inner)},
                            {rounding(1, 0.18), rounding(0.35, 0.18)});
  EXPECT_FALSE(facets.contains({2, 1}));
}

TEST_F(Bodies, GrowAwayFromWhatLiesBetweenThem) {
  const Shape outer = sphere(1, 30, 60), inner = sphere(0.5, 20, 40);
  MeshOptions options = this->options({off("shell", outer), off("core", inner)}, 0.1);
  options.growth = 0.2;
  const Contents contents = meshed(options, "run");
  check("run", {volume_of(outer) - volume_of(inner), volume_of(inner)},
        {rounding(1, 0.1), rounding(0.5, 0.1)});
  options.growth = 0;
  EXPECT_LT(contents.run.counts.num_cells, meshed(options, "uniform").run.counts.num_cells);
}

// With cores of the lattice in two bodies, in leaves that both lie in.
TEST_F(Bodies, HaveLatticeCoresOfTheirOwn) {
  const Shape outer = box({-1, -1, -1}, {1, 1, 1}),
              inner = box({-0.5, -0.5, -0.5}, {0.5, 0.5, 0.5});
  MeshOptions options = this->options({off("outer", outer), off("inner", inner)}, 0.06);
  options.leaf_capacity = 30'000;
  const Contents contents = meshed(options, "run", 2);
  std::set<BodyId> of_core;
  for (const auto& [key, leaf] : contents.leaves) {
    if (leaf.points.core.is_whole) of_core.insert(leaf.points.core.body);
    for (const LatticeRow& row : leaf.points.core.rows) of_core.insert(row.body);
  }
  EXPECT_EQ(of_core, (std::set<BodyId>{1, 2}));
  check("run", {7, 1}, {kPlane, kPlane});
}

// Closer than the spacing floor, and facing the same way.
TEST_F(Bodies, ShellsThatAreTooCloseLeaveAManifoldEach) {
  MeshOptions options =
      this->options({off("outer", sphere(1, 20, 40)), off("inner", sphere(0.997, 20, 40))}, 0.2);
  options.min_dihedral = 0;  // there is nothing to gain
  const Contents contents = meshed(options, "run");
  EXPECT_GT(contents.run.counts.num_unresolved, 0U);
  EXPECT_LT(contents.run.counts.num_points, 5000U) << "folds are given up";
  const AuditReport report = audit(Store::open(dir_ / "run", {.read_only = true}));
  EXPECT_TRUE(report.is_valid());
  for (const std::string& violation : report.violations) ADD_FAILURE() << violation;
}

// Cells as large as all of them: a dual edge leads through three shells at once. One cell between
// points of the inner shells, of the outermost body, was a mesh without the three others once, with
// no word about it: what parts 3 from 0 was what parts 2 from 1.
TEST_F(Bodies, NoFacetPartsTwoWhereTheSurfaceDoesNot) {
  std::vector<std::filesystem::path> files;
  for (const double radius : {1.5, 0.5, 0.3, 0.2})
    files.push_back(off("ball" + std::to_string(files.size()), sphere(radius, 10, 20)));
  for (const double size : {3.0, 1.0, 0.5}) {
    const std::string name = "run" + std::to_string(size);
    const Contents contents = meshed(options(files, size), name);
    const AuditReport report = audit(Store::open(dir_ / name, {.read_only = true}));
    EXPECT_TRUE(report.is_valid()) << size;
    for (const std::string& violation : report.violations) ADD_FAILURE() << violation;
    if (contents.run.counts.num_unresolved > 0) continue;  // it is told where
    for (const double volume : report.body_volumes) EXPECT_GT(volume, 0) << size;
  }
}

TEST_F(Bodies, TheAuditFindsFacetsWhereTheSurfacePartsOthers) {
  meshed(options({off("shell", sphere(1, 12, 24)), off("core", sphere(0.5, 8, 16))}, 0.25), "run");
  {
    // The shell's outer sheet stands for a part of what lies between the two.
    Store store = Store::open(dir_ / "run");
    std::vector<MortonKey> leaves;
    store.snapshot().for_each_leaf([&](MortonKey leaf, const LeafInfo&) {
      leaves.push_back(leaf);
      return true;
    });
    Batch batch = store.begin();
    for (const MortonKey leaf : leaves) {
      LeafSurface surface = batch.surface(leaf);
      for (Triangle& triangle : surface.triangles)
        if (triangle.sheet == 2 && triangle.corners[0].z > 0.3) triangle.sheet = 1;
      batch.put_surface(leaf, surface);
    }
    batch.commit();
  }
  const AuditReport report = audit(Store::open(dir_ / "run", {.read_only = true}));
  EXPECT_GT(report.num_wrong_facets, 0U);
  EXPECT_TRUE(std::ranges::any_of(report.violations, [](const std::string& violation) {
    return violation.find("does not part there") != violation.npos;
  }));
}

// ---- That touch

TEST_F(Bodies, TouchInAFace) {
  const MeshOptions options = this->options(
      {off("left", box({0, 0, 0}, {1, 1, 1})), off("right", box({1, 0, 0}, {2, 1, 1}))}, 0.12);
  const Contents contents = meshed(options, "run");
  EXPECT_EQ(contents.run.counts.num_unresolved, 0U);
  const auto facets = check("run", {1, 1}, {kPlane, kPlane});
  EXPECT_EQ(facets.size(), 3U);
  EXPECT_TRUE(facets.contains({2, 1}));
  const AuditReport report = audit(Store::open(dir_ / "run", {.read_only = true}));
  EXPECT_NEAR(report.surface_crease_length, 20, 1e-9);
  EXPECT_EQ(report.num_lost_creases, 0U);
  EXPECT_TRUE(are_equal(contents, meshed(options, "threads", 3)));
}

TEST_F(Bodies, TouchInGroupsOfOneFile) {
  MeshOptions options = this->options(
      {obj("pair", {{"left", box({0, 0, 0}, {1, 1, 1})}, {"right", box({1, 0, 0}, {2, 1, 1})}})},
      0.2);
  options.has_bodies = true;
  const Contents contents = meshed(options, "run");
  EXPECT_EQ(contents.run.counts.num_unresolved, 0U);
  EXPECT_TRUE(check("run", {1, 1}, {kPlane, kPlane}).contains({2, 1}));
}

TEST_F(Bodies, LieOnAFaceOfWhatTheyLieIn) {
  // The inner one has a face of its own on the outer one's, which has its border for edges.
  Shape outer = box({0, 0, 0}, {3, 3, 1});
  outer.triangles.erase(outer.triangles.begin() + 2, outer.triangles.begin() + 4);
  std::uint32_t first = static_cast<std::uint32_t>(outer.vertices.size());
  for (std::uint32_t j = 0; j < 4; ++j)
    for (std::uint32_t i = 0; i < 4; ++i) outer.vertices.push_back({double(i), double(j), 1});
  for (const auto& [corner, at] : {std::pair(4U, 0U), {5U, 3U}, {6U, 12U}, {7U, 15U}})
    for (auto& t : outer.triangles) std::ranges::replace(t, corner, first + at);
  // The sides have edges there, too.
  std::vector<std::array<std::uint32_t, 3>> cut;
  for (const auto& t : outer.triangles) {
    const auto is_top = [&](std::uint32_t v) { return v >= first; };
    std::array<std::uint32_t, 3> r = t;
    while (std::ranges::count_if(t, is_top) == 2 && !(is_top(r[0]) && is_top(r[1])))
      std::ranges::rotate(r, r.begin() + 1);
    if (std::ranges::count_if(t, is_top) < 2) {
      cut.push_back(t);
      continue;
    }
    const std::int64_t step = (std::int64_t(r[1]) - std::int64_t(r[0])) / 3;
    for (std::int64_t n = 0; n < 3; ++n)
      cut.push_back({static_cast<std::uint32_t>(r[0] + n * step),
                     static_cast<std::uint32_t>(r[0] + (n + 1) * step), r[2]});
  }
  outer.triangles = cut;
  for (std::uint32_t j = 0; j < 3; ++j)
    for (std::uint32_t i = 0; i < 3; ++i) {
      const std::uint32_t at = first + 4 * j + i;
      outer.triangles.push_back({at, at + 1, at + 5});
      outer.triangles.push_back({at, at + 5, at + 4});
    }
  const Shape inner = box({1, 1, 0.5}, {2, 2, 1});
  const MeshOptions options = this->options({off("outer", outer), off("inner", inner)}, 0.2);
  const Contents contents = meshed(options, "run");
  EXPECT_EQ(contents.run.counts.num_unresolved, 0U);
  const auto facets = check("run", {8.5, 0.5}, {kPlane, kPlane});
  EXPECT_TRUE(facets.contains({1, 0}) && facets.contains({2, 0}) && facets.contains({2, 1}));
}

TEST_F(Bodies, EightCubesAroundAPoint) {
  std::vector<std::filesystem::path> files;
  for (int k = 0; k < 8; ++k) {
    const Point low{double(k & 1), double(k >> 1 & 1), double(k >> 2)};
    files.push_back(off("cube" + std::to_string(k), box(low, low + Point{1, 1, 1})));
  }
  const Contents contents = meshed(options(files, 0.2), "run", 2);
  EXPECT_EQ(contents.run.counts.num_unresolved, 0U);
  const auto facets = check("run", std::vector<double>(8, 1), std::vector<double>(8, kPlane));
  EXPECT_EQ(facets.size(), 8U + 12U);
}

TEST_F(Bodies, AStackOfPlates) {
  std::vector<std::filesystem::path> files;
  for (int k = 0; k < 10; ++k)
    files.push_back(off("plate" + std::to_string(k), box({0, 0, 0.1 * k}, {1, 1, 0.1 * (k + 1)})));
  const Contents contents = meshed(options(files, 0.12), "run", 2);
  EXPECT_EQ(contents.run.counts.num_unresolved, 0U);
  const auto facets = check("run", std::vector<double>(10, 0.1), std::vector<double>(10, kPlane));
  EXPECT_EQ(facets.size(), 10U + 9U);
}

TEST_F(Bodies, WedgesAroundAnAxis) {
  const std::vector<Shape> wedges = {sector(0, 60, 1), sector(60, 120, 1), sector(120, 360, 4)};
  const MeshOptions options =
      this->options({off("a", wedges[0]), off("b", wedges[1]), off("c", wedges[2])}, 0.15);
  const Contents contents = meshed(options, "run");
  EXPECT_EQ(contents.run.counts.num_unresolved, 0U);
  const auto facets =
      check("run", {volume_of(wedges[0]), volume_of(wedges[1]), volume_of(wedges[2])},
            {kPlane, kPlane, kPlane});
  EXPECT_EQ(facets.size(), 6U);
}

// A little thinner than mirrors reach. Samples of all layers are above each other, also across
// leaves: so nothing has to tell the layers apart, and hardly a point is inserted.
TEST_F(Bodies, AStackOfThinPlatesInSeveralLeaves) {
  std::vector<std::filesystem::path> files;
  for (int k = 0; k < 10; ++k)
    files.push_back(
        off("plate" + std::to_string(k), box({0, 0, 0.02 * k}, {1, 1, 0.02 * (k + 1)})));
  MeshOptions options = this->options(files, 0.025);
  options.leaf_capacity = 1000;
  const Contents contents = meshed(options, "run", 2);
  EXPECT_EQ(contents.run.counts.num_unresolved, 0U);
  EXPECT_LT(num_insertions(contents), contents.run.counts.num_points / 50);
  constexpr std::uint64_t kFew = 4;  // of 80,000 cells
  check("run", std::vector<double>(10, 0.02), std::vector<double>(10, kPlane), kFew);
}

// Twelve sheets in one crease: samples on all of them are images of each other.
TEST_F(Bodies, TwelveWedgesAroundAnAxis) {
  std::vector<std::filesystem::path> files;
  std::vector<double> volumes;
  for (int k = 0; k < 12; ++k) {
    const Shape wedge = sector(30 * k, 30 * (k + 1), 1);
    files.push_back(off("wedge" + std::to_string(k), wedge));
    volumes.push_back(volume_of(wedge));
  }
  MeshOptions options = this->options(files, 0.06);
  options.leaf_capacity = 30'000;
  const Contents contents = meshed(options, "run");
  EXPECT_EQ(contents.run.counts.num_unresolved, 0U);
  EXPECT_LT(num_insertions(contents), contents.run.counts.num_points / 5);
  constexpr std::uint64_t kFew = 30;  // of 70,000 cells
  check("run", volumes, std::vector<double>(12, kPlane), kFew);
}

TEST_F(Bodies, TouchInAnEdgeAndInAVertex) {
  for (const Point& low : {Point{1, 1, 0}, Point{1, 1, 1}}) {
    const MeshOptions options = this->options(
        {off("one", box({0, 0, 0}, {1, 1, 1})), off("other", box(low, low + Point{1, 1, 1}))}, 0.2);
    const std::string name = low.z == 0 ? "edge" : "vertex";
    const Contents contents = meshed(options, name);
    EXPECT_EQ(contents.run.counts.num_unresolved, 0U);
    EXPECT_EQ(check(name, {1, 1}, {kPlane, kPlane}).size(), 2U);
  }
}

TEST_F(Bodies, AVoidThatTouchesOutsideIsAPocket) {
  MeshOptions options =
      this->options({off("left", box({0, 0, 0}, {1, 1, 1})), off("gap", box({1, 0, 0}, {2, 1, 1})),
                     off("right", box({2, 0, 0}, {3, 1, 1}))},
                    0.2);
  options.voids = {"gap"};
  const Contents contents = meshed(options, "run");
  EXPECT_EQ(contents.run.counts.num_unresolved, 0U);
  EXPECT_EQ(check("run", {1, 1}, {kPlane, kPlane}).size(), 2U);
}

TEST_F(Bodies, ThatTouchGrowAwayFromWhatLiesBetweenThem) {
  MeshOptions options = this->options(
      {off("left", box({0, 0, 0}, {1, 1, 1})), off("right", box({1, 0, 0}, {2, 1, 1}))}, 0.1);
  options.growth = 0.2;
  const Contents contents = meshed(options, "run");
  EXPECT_EQ(contents.run.counts.num_unresolved, 0U);
  EXPECT_TRUE(check("run", {1, 1}, {kPlane, kPlane}).contains({2, 1}));
}

// In the body with a size no cell is larger; in the other they grow from there, to λ.
TEST_F(Bodies, HaveSizesOfTheirOwn) {
  MeshOptions options = this->options(
      {off("left", box({0, 0, 0}, {1, 1, 1})), off("right", box({1, 0, 0}, {2, 1, 1}))}, 0.2);
  options.bodies = {{"right", {0.06, false}, {}}};
  const Contents contents = meshed(options, "run");
  EXPECT_EQ(contents.run.counts.num_unresolved, 0U);
  EXPECT_EQ(contents.run.parameters.growth, kDefaultGrowth);
  EXPECT_TRUE(check("run", {1, 1}, {kPlane, kPlane}).contains({2, 1}));
  const std::vector<SizedCell> cells = cells_of("run");
  EXPECT_LE(largest(cells, 2, 0, 2), 0.06 * (1 + 1e-9));
  EXPECT_LT(largest(cells, 1, 0, 0.1), 0.06 + 0.2 * 0.2);
  EXPECT_GT(largest(cells, 1, 0.7, 2), 0.15);
  const Contents again = meshed(options, "threads", 2);
  EXPECT_TRUE(are_equal(contents, again));
}

// With a growth that is asked for, cells grow away from the side between the two, in both.
TEST_F(Bodies, WithSizesGrowOnBothSides) {
  MeshOptions options = this->options(
      {off("left", box({0, 0, 0}, {1, 1, 1})), off("right", box({1, 0, 0}, {2, 1, 1}))}, 0.2);
  options.bodies = {{"right", {0.05, false}, {}}};
  options.growth = 0.3;
  meshed(options, "run");
  check("run", {1, 1}, {kPlane, kPlane});
  const std::vector<SizedCell> cells = cells_of("run");
  for (const BodyId body : {1U, 2U}) {
    EXPECT_LT(largest(cells, body, 0, 0.05), 0.05 + 0.3 * 0.15) << body;
    EXPECT_GT(largest(cells, body, 0.4, 0.6), 0.11) << body;
  }
  EXPECT_LT(largest(cells, 2, 0, 2), 0.05 + 0.3 * 0.5 + 0.01);
}

TEST_F(Bodies, InOthersHaveSizesOfTheirOwn) {
  const Shape outer = sphere(1, 20, 40), inner = sphere(0.5, 16, 32);
  MeshOptions options = this->options({off("shell", outer), off("core", inner)}, 0.2);
  options.bodies = {{"core", {0.07, false}, {}}};
  const Contents expected = meshed(options, "run");
  check("run", {volume_of(outer) - volume_of(inner), volume_of(inner)},
        {rounding(1, 0.2), rounding(0.5, 0.07)});
  const std::vector<SizedCell> cells = cells_of("run");
  EXPECT_LE(largest(cells, 2, 0, 3), 0.07 * (1 + 1e-9));
  EXPECT_GT(largest(cells, 1, 0, 3), 0.13);
  EXPECT_TRUE(are_equal(expected, meshed_on_ranks(options)));
}

TEST_F(Bodies, SizesOfUnknownOnesAreRefused) {
  const auto a = off("shell", sphere(1, 10, 20)), b = off("core", sphere(0.5, 10, 20));
  MeshOptions options = this->options({a, b}, 0.3);
  options.bodies = {{"coer", {0.1, false}, {}}};
  EXPECT_EQ(refusal_of(options),
            "a size is given for the body 'coer', and no body of the surface has that name: there "
            "are shell, core; is 'core' meant?");
  options.bodies = {{"core", {0, false}, {}}};
  EXPECT_NE(refusal_of(options).find("body core: size 0"), std::string::npos);
  options.bodies = {{"core", {1e-12, false}, {}}};
  EXPECT_NE(refusal_of(options).find("choose a size of at least"), std::string::npos);
  options.more_inputs.clear();
  EXPECT_NE(refusal_of(options).find("give --bodies, or more files"), std::string::npos);
}

TEST_F(Bodies, ThatTouchAreThoseOfOneProcessOnSeveralRanks) {
  const MeshOptions options = this->options(
      {off("left", box({0, 0, 0}, {1, 1, 1})), off("right", box({1, 0, 0}, {2, 1, 1}))}, 0.2);
  const Contents expected = meshed(options, "one");
  EXPECT_TRUE(are_equal(expected, meshed_on_ranks(options)));
}

// ---- That cross, or lie on each other with other triangles

// A disk's rim, between two heights.
Shape cylinder(double radius, double low, double high, int num) {
  Shape shape{{{0, 0, low}, {0, 0, high}}, {}};
  for (int i = 0; i < num; ++i)
    for (const double z : {low, high})
      shape.vertices.push_back(
          {radius * std::cos(2 * kPi * i / num), radius * std::sin(2 * kPi * i / num), z});
  for (int i = 0; i < num; ++i) {
    const auto p = static_cast<std::uint32_t>(2 + 2 * i),
               q = static_cast<std::uint32_t>(2 + 2 * ((i + 1) % num));
    for (const auto& t : {std::array<std::uint32_t, 3>{0, q, p},
                          {1, p + 1, q + 1},
                          {p, q, q + 1},
                          {p, q + 1, p + 1}})
      shape.triangles.push_back(t);
  }
  return shape;
}

struct CutCase {
  std::string name;
  std::vector<Shape> shapes;
  std::vector<double> volumes;  // of what is left of each
  double crease_length = 0;
};

class BodiesThatAreCut : public Bodies, public testing::WithParamInterface<CutCase> {};

TEST_P(BodiesThatAreCut, AreOneMesh) {
  const auto& [name, shapes, volumes, crease_length] = GetParam();
  for (const bool is_turned : {false, true}) {
    SCOPED_TRACE(is_turned ? "turned" : "as it is");
    std::vector<std::filesystem::path> files;
    for (std::size_t b = 0; b < shapes.size(); ++b)
      files.push_back(off("body" + std::to_string(b),
                          is_turned ? testing_shapes::turned(shapes[b]) : shapes[b]));
    const std::string run = is_turned ? "turned" : "run";
    MeshOptions options = this->options(files, 6);
    options.size.is_percent = true;
    const Contents contents = meshed(options, run, 2);
    EXPECT_EQ(contents.run.counts.num_unresolved, 0U);
    check(run, volumes, std::vector<double>(volumes.size(), 1e-6));
    const AuditReport report = audit(Store::open(dir_ / run, {.read_only = true}));
    EXPECT_EQ(report.num_lost_creases, 0U);
    EXPECT_EQ(report.num_lost_corners, 0U);
    EXPECT_NEAR(report.surface_crease_length, crease_length, 1e-9);
  }
}

const Shape kLeftCube = box({0, 0, 0}, {1, 1, 1});
Shape right_cube_with_the_other_diagonal() {
  Shape other = box({1, 0, 0}, {2, 1, 1});
  for (auto& t : other.triangles) {
    if (t == std::array<std::uint32_t, 3>{0, 4, 6}) t = {0, 4, 2};
    if (t == std::array<std::uint32_t, 3>{0, 6, 2}) t = {2, 4, 6};
  }
  return other;
}

INSTANTIATE_TEST_SUITE_P(
    Shapes, BodiesThatAreCut,
    testing::Values(
        CutCase{"OtherDiagonals", {kLeftCube, right_cube_with_the_other_diagonal()}, {1, 1}, 20},
        CutCase{"AFaceInAFace", {box({0, 0, 0}, {3, 3, 1}), box({1, 1, 1}, {2, 2, 2})}, {9, 1}, 40},
        CutCase{"AFaceInAFaceFromWithin",
                {box({0, 0, 0}, {3, 3, 1}), box({1, 1, 0.25}, {2, 2, 1})},
                {8.25, 0.75},
                28 + 8 + 3},
        CutCase{"HalfInEachOther",
                {box({0, 0, 0}, {3, 3, 1}), box({2.5, 1, 0.25}, {3.5, 2, 0.75})},
                {9, 0.25},
                28 + 3 + 3 + 2},
        CutCase{"AVertexOnAFace",
                {box({0, 0, 0}, {2, 2, 1}), box({0.75, 0.5, 1}, {2, 2, 2})},
                {4, 1.25 * 1.5},
                20 + 2 * 2.75 + 4 + 2.75},
        CutCase{"ThreeThroughOnePlace",
                {box({0, 0, 0}, {2, 1, 1}), box({0.5, -0.5, 0.25}, {1.5, 1.5, 0.75}),
                 box({0.75, 0.25, -0.5}, {1.25, 0.75, 1.5})},
                {2, 0.5, 0.25},
                44}),
    [](const auto& shape) { return shape.param.name; });

TEST_F(Bodies, SpheresThatOverlap) {
  const Shape one = sphere(1, 16, 32), other = moved(sphere(1, 15, 30), {0.9, 0.13, 0.21});
  const MeshOptions options = this->options({off("one", one), off("other", other)}, 0.12);
  const Contents contents = meshed(options, "run");
  EXPECT_EQ(contents.run.counts.num_unresolved, 0U);
  ASSERT_EQ(contents.sheets.bodies.size(), 2U);
  EXPECT_NEAR(contents.sheets.bodies[0].volume, volume_of(one), 1e-9);
  const auto facets = check("run", {volume_of(one), contents.sheets.bodies[1].volume},
                            {rounding(1, 0.12), rounding(1, 0.12)});
  EXPECT_EQ(facets.size(), 3U);
  EXPECT_EQ(audit(Store::open(dir_ / "run", {.read_only = true})).num_lost_creases, 0U);
  bool is_told = false;
  for (const std::string& note : contents.run.surface.notes)
    is_told |= note.find("one and other overlap") != note.npos &&
               note.find("one has the place") != note.npos;
  EXPECT_TRUE(is_told);
  EXPECT_TRUE(are_equal(contents, meshed(options, "threads", 3)));
}

TEST_F(Bodies, ABoltInAPlateOfOtherTriangles) {
  const Shape bolt = cylinder(0.5, 0, 0.5, 24);
  const MeshOptions options =
      this->options({off("plate", box({-1, -1, 0}, {1, 1, 0.5})), off("bolt", bolt)}, 0.15);
  const Contents contents = meshed(options, "run");
  EXPECT_EQ(contents.run.counts.num_unresolved, 0U);
  const double rounded = 2 * kPi * 0.5 * 0.5 * 0.005;
  const auto facets = check("run", {2 - volume_of(bolt), volume_of(bolt)}, {rounded, rounded});
  EXPECT_TRUE(facets.contains({1, 0}) && facets.contains({2, 0}) && facets.contains({2, 1}));
  EXPECT_EQ(audit(Store::open(dir_ / "run", {.read_only = true})).num_lost_creases, 0U);
}

// A stack of three, with the faces between them given once; in groups that are closed only
// together; and in two files, of which the second lacks what the first has.
TEST_F(Bodies, MayShareFacesThatAreGivenOnce) {
  const std::filesystem::path layers = dir_ / "layers.off";
  std::ofstream out(layers);
  out << "OFF\n16 32 0\n";
  for (int v = 0; v < 16; ++v)
    out << (v & 2 ? 4 : 0) << ' ' << (v & 1 ? 4 : 0) << ' ' << v / 4 << '\n';
  for (int z = 0; z < 4; ++z)
    out << "3 " << 4 * z << ' ' << 4 * z + 2 << ' ' << 4 * z + 3 << "\n3 " << 4 * z << ' '
        << 4 * z + 3 << ' ' << 4 * z + 1 << '\n';
  for (int z = 0; z < 3; ++z)
    for (const auto& [a, b] : {std::pair(0, 1), {1, 3}, {3, 2}, {2, 0}}) {
      const int p = 4 * z + a, q = 4 * z + b;
      out << "3 " << p << ' ' << q << ' ' << q + 4 << "\n3 " << p << ' ' << q + 4 << ' ' << p + 4
          << '\n';
    }
  out.close();
  MeshOptions stack = options({layers}, 0.8);
  stack.has_bodies = true;
  const Contents contents = meshed(stack, "stack", 2);
  EXPECT_EQ(contents.run.counts.num_unresolved, 0U);
  ASSERT_EQ(contents.sheets.bodies.size(), 3U);
  EXPECT_EQ(contents.sheets.bodies[0].name, "body 1");
  const auto facets = check("stack", {16, 16, 16}, {1e-5, 1e-5, 1e-5});
  EXPECT_EQ(facets.size(), 5U);
  EXPECT_TRUE(are_equal(contents, meshed_on_ranks(stack)));

  Shape right = box({1, 0, 0}, {2, 1, 1});
  std::erase_if(right.triangles, [&](const auto& t) {
    return std::ranges::all_of(t, [&](std::uint32_t v) { return right.vertices[v].x == 1; });
  });
  ASSERT_EQ(right.triangles.size(), 10U);
  const auto left_and_right = [&](const Contents& both) {
    ASSERT_EQ(both.sheets.bodies.size(), 2U);
    EXPECT_EQ(both.sheets.bodies[0].name, "left");
    EXPECT_EQ(both.sheets.bodies[1].name, "right");
    EXPECT_NEAR(both.sheets.bodies[0].volume, 1, 1e-12);
    EXPECT_NEAR(both.sheets.bodies[1].volume, 1, 1e-12);
  };
  MeshOptions groups = options({obj("groups", {{"left", kLeftCube}, {"right", right}})}, 0.2);
  groups.has_bodies = true;
  left_and_right(meshed(groups, "groups"));
  EXPECT_TRUE(check("groups", {1, 1}, {kPlane, kPlane}).contains({2, 1}));
  left_and_right(meshed(options({off("left", kLeftCube), off("right", right)}, 0.2), "files"));
  EXPECT_TRUE(check("files", {1, 1}, {kPlane, kPlane}).contains({2, 1}));

  // Without names, two that have the same triangles where they touch.
  MeshOptions unnamed =
      options({obj("pair", {{"", kLeftCube}, {"", box({1, 0, 0}, {2, 1, 1})}})}, 0.2);
  unnamed.has_bodies = true;
  meshed(unnamed, "unnamed");
  EXPECT_TRUE(check("unnamed", {1, 1}, {kPlane, kPlane}).contains({2, 1}));

  // A hole stays one.
  Shape open = right;
  open.triangles.pop_back();
  EXPECT_NE(
      refusal_of(options({off("left", kLeftCube), off("open", open)}, 0.2)).find("not closed"),
      std::string::npos);
}

// What lies between two of them becomes the second's, whose corners move to the first's.
TEST_F(Bodies, NearerThanAGapTouch) {
  for (const bool is_cut_alike : {true, false}) {
    for (const double from : {1.01, 0.99}) {
      SCOPED_TRACE(std::to_string(is_cut_alike) + ", from " + std::to_string(from));
      const Shape right =
          is_cut_alike ? box({from, 0, 0}, {2, 1, 1}) : box({from, 0.25, 0.25}, {2, 0.75, 0.75});
      MeshOptions options = this->options({off("left", kLeftCube), off("right", right)}, 0.2);
      options.gap = {0.02, false};
      const std::string run = std::to_string(is_cut_alike) + std::to_string(from);
      const Contents contents = meshed(options, run);
      EXPECT_EQ(contents.run.counts.num_unresolved, 0U);
      ASSERT_EQ(contents.sheets.bodies.size(), 2U);
      const double left = contents.sheets.bodies[0].volume, both = is_cut_alike ? 2 : 1.25;
      EXPECT_NEAR(left, 1, 0.011);
      // Of a part of a face the vertices alone move: what is around it leans.
      const double tolerance = is_cut_alike ? kPlane : 1e-3;
      const double right_volume = contents.sheets.bodies[1].volume;
      EXPECT_NEAR(left + right_volume, both, is_cut_alike ? 1e-12 : 0.01);
      EXPECT_TRUE(check(run, {left, right_volume}, {tolerance, tolerance}).contains({2, 1}));
      bool is_told = false;
      for (const std::string& note : contents.run.surface.notes)
        is_told |= note.find("--gap") != note.npos && note.find("up to 0.01 away") != note.npos;
      EXPECT_TRUE(is_told);
      EXPECT_TRUE(are_equal(contents, meshed(options, run + "again", 3)));
      if (is_cut_alike && from > 1) {
        EXPECT_TRUE(are_equal(contents, meshed_on_ranks(options)));
      }
      options.gap = {0.005, false};
      if (from > 1) {
        EXPECT_EQ(meshed(options, run + "apart").sheets.sheets.size(), 12U);
      }
    }
  }
}

// What lies across its longest edge gets its corner, also where no other body is near.
TEST_F(Bodies, ANeedleThatGoesForAGapLeavesItsBodyClosed) {
  Shape apart = box({5, 0, 0}, {6, 1, 1});
  auto& [a, b, c] = apart.triangles.front();
  const auto length = [&](std::uint32_t from, std::uint32_t to) {
    return norm(apart.vertices[to] - apart.vertices[from]);
  };
  while (length(a, b) < std::max(length(b, c), length(c, a)))
    std::tie(a, b, c) = std::tuple(b, c, a);
  const Point middle = 0.5 * (apart.vertices[a] + apart.vertices[b]);
  const auto p = static_cast<std::uint32_t>(apart.vertices.size());
  apart.vertices.push_back(middle + 0.01 * (apart.vertices[c] - middle));
  const std::array<std::uint32_t, 3> whole = {a, b, c};
  c = p;
  apart.triangles.push_back({whole[1], whole[2], p});
  apart.triangles.push_back({whole[2], whole[0], p});

  MeshOptions options = this->options(
      {off("left", kLeftCube), off("right", box({1.01, 0, 0}, {2, 1, 1})), off("apart", apart)},
      0.2);
  options.gap = {0.02, false};
  const Contents contents = meshed(options, "run");
  EXPECT_EQ(contents.run.counts.num_unresolved, 0U);
  ASSERT_EQ(contents.sheets.bodies.size(), 3U);
  EXPECT_NEAR(contents.sheets.bodies[2].volume, 1, 1e-12);
}

// As in binary STL, and as streams write them: no face lies exactly in another's plane.
TEST_F(Bodies, OfRoundedCoordinatesTouch) {
  const std::uint64_t seed = std::random_device()();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> unit(-1, 1);
  const auto random_point = [&] { return Point{unit(random), unit(random), unit(random)}; };
  const auto direction = [](const Point& p) { return 1 / norm(p) * p; };
  for (const bool is_single : {true, false}) {
    const Point w = direction(random_point()), u = direction(cross(w, random_point()));
    const Point origin = 3 * random_point(), v = cross(w, u);
    const auto placed = [&](Shape shape) {
      for (Point& p : shape.vertices) {
        p = origin + p.x * u + p.y * v + p.z * w;
        for (int axis = 0; axis < 3; ++axis)
          p[axis] = is_single ? static_cast<double>(static_cast<float>(p[axis]))
                              : std::stod(fmt::format("{:.7g}", p[axis]));
      }
      return shape;
    };
    const std::string run = is_single ? "single" : "digits";
    const Contents contents =
        meshed(options({off(run + "_below", placed(box({0, 0, 0}, {2, 2, 1}))),
                        off(run + "_above", placed(box({0.4, 0.3, 1}, {1.3, 1.1, 1.8})))},
                       0.2),
               run);
    SCOPED_TRACE(run);
    EXPECT_EQ(contents.run.counts.num_unresolved, 0U);
    EXPECT_EQ(contents.sheets.sheets.size(), 12U);  // one of them between the two
    const std::string notes = fmt::format("{}", fmt::join(contents.run.surface.notes, "; "));
    EXPECT_NE(notes.find("which is how precise coordinates are"), notes.npos) << notes;
    const AuditReport report = audit(Store::open(dir_ / run, {.read_only = true}));
    EXPECT_TRUE(report.is_valid());
    ASSERT_EQ(report.body_volumes.size(), 2U);
    EXPECT_NEAR(report.body_volumes[0], 4, 1e-5);
    EXPECT_NEAR(report.body_volumes[1], 0.576, 1e-5);
  }
}

TEST_F(Bodies, AGapAsWideAsOneOfThemIsRefused) {
  MeshOptions options =
      this->options({off("left", kLeftCube), off("between", box({1, 0, 0}, {1.01, 1, 1})),
                     off("right", box({1.01, 0, 0}, {2, 1, 1}))},
                    0.2);
  options.gap = {0.02, false};
  const std::string told = refusal_of(options);
  for (const char* word : {"--gap", "not closed", "(1", "give less"})
    EXPECT_NE(told.find(word), std::string::npos) << told;
  MeshOptions alone = this->options({off("alone", kLeftCube)}, 0.2);
  alone.gap = {0.02, false};
  EXPECT_NE(refusal_of(alone).find("--bodies"), std::string::npos);
}

TEST_F(Bodies, ThatAreCutGoOnAfterInterruptionsAndOnRanks) {
  const MeshOptions options = this->options(
      {off("left", kLeftCube), off("right", right_cube_with_the_other_diagonal())}, 0.2);
  const Contents expected = meshed(options, "whole");
  EXPECT_TRUE(are_equal(expected, meshed_on_ranks(options)));
  EXPECT_TRUE(are_equal(expected, meshed_with_stops(options, 5)));
}

// ---- Winding numbers of each

TEST_F(Bodies, ByWindingNumbersSoundOnesAreTheSame) {
  // Whose triangles are the same where they touch; that are cut there; that cross, of which one
  // faces inward.
  Shape across = box({0.5, 0.5, 0.5}, {1.5, 1.5, 1.5});
  for (auto& t : across.triangles) std::swap(t[0], t[1]);
  int n = 0;
  for (const Shape& other :
       {box({1, 0, 0}, {2, 1, 1}), right_cube_with_the_other_diagonal(), across}) {
    SCOPED_TRACE(n);
    MeshOptions options = this->options({off("left", kLeftCube), off("other", other)}, 0.2);
    const std::string run = "closed" + std::to_string(n), again = "wound" + std::to_string(n);
    Contents closed = meshed(options, run);
    options.inside = InsideRule::kWinding;
    const Contents wound = meshed(options, again);
    closed.run.parameters.inside = InsideRule::kWinding;
    EXPECT_TRUE(are_equal(closed, wound));
    ++n;
  }
}

TEST_F(Bodies, ByWindingNumbersEachIsWhatItsOwnTrianglesWindAround) {
  const auto append = [](Shape& to, const Shape& more) {
    const auto first = static_cast<std::uint32_t>(to.vertices.size());
    to.vertices.insert(to.vertices.end(), more.vertices.begin(), more.vertices.end());
    for (auto [a, b, c] : more.triangles) to.triangles.push_back({first + a, first + b, first + c});
  };
  Shape left = kLeftCube, right = box({1, 0, 0}, {2, 1, 1});
  left.triangles.erase(left.triangles.begin() + 3);          // a hole
  append(right, box({0.75, 0.25, 0.25}, {1.5, 0.75, 1.5}));  // a shell across it
  right.triangles.push_back(right.triangles.front());        // a doubled one
  std::swap(right.triangles[4][0], right.triangles[4][1]);   // one that is turned
  MeshOptions options = this->options({off("left", left), off("right", right)}, 0.15);
  EXPECT_NE(refusal_of(options).find("--inside winding"), std::string::npos);
  options.inside = InsideRule::kWinding;
  const Contents contents = meshed(options, "run");
  EXPECT_EQ(contents.run.counts.num_unresolved, 0U);
  // What of the shell lies in the left one is that one's; this stands above both.
  const double above = 0.75 * 0.5 * 0.5;
  const auto facets = check("run", {1, 1 + above}, {kPlane, kPlane});
  EXPECT_TRUE(facets.contains({2, 1}));
  const std::string notes = fmt::format("{}", fmt::join(contents.run.surface.notes, "; "));
  for (const char* told : {"of left: closed 1 hole", "of right: turned 1 triangle"})
    EXPECT_NE(notes.find(told), notes.npos) << notes;
  EXPECT_TRUE(are_equal(contents, meshed(options, "threads", 3)));
  EXPECT_TRUE(are_equal(contents, meshed_with_stops(options, 20)));
}

TEST_F(Bodies, ByWindingNumbersASheetOrOnesWithoutNamesAreRefused) {
  Shape sheet = box({1, 0, 0}, {2, 1, 1});
  sheet.triangles.resize(2);
  MeshOptions options = this->options({off("left", kLeftCube), off("sheet", sheet)}, 0.2);
  options.inside = InsideRule::kWinding;
  EXPECT_NE(refusal_of(options).find("sheet wind around nothing"), std::string::npos)
      << refusal_of(options);
  Shape open = box({1, 0, 0}, {2, 1, 1});
  open.triangles.pop_back();
  options = this->options({obj("pair", {{"", kLeftCube}, {"", open}})}, 0.2);
  options.inside = InsideRule::kWinding;
  options.has_bodies = true;
  EXPECT_NE(refusal_of(options).find("give each as a file or a"), std::string::npos)
      << refusal_of(options);
}

TEST_F(Bodies, ShellsThatNobodyCanTellApartAreNotCut) {
  // Without names nobody can tell which triangles are whose.
  MeshOptions unnamed = this->options(
      {obj("pair", {{"", kLeftCube}, {"", right_cube_with_the_other_diagonal()}})}, 0.2);
  unnamed.has_bodies = true;
  EXPECT_NE(refusal_of(unnamed).find("give each as a file"), std::string::npos);
  // Files that are closed together alone are one body, which may not cross itself.
  Shape tube = box({0, 0, 0}, {1, 1, 1}), lid = tube;
  lid.triangles = {tube.triangles[2], tube.triangles[3]};
  tube.triangles.erase(tube.triangles.begin() + 2, tube.triangles.begin() + 4);
  lid.vertices.push_back({0.5, 0.5, -1});
  lid.triangles = {{4, 5, 8}, {5, 7, 8}, {7, 6, 8}, {6, 4, 8}};
  const std::string told = refusal_of(options({off("tube", tube), off("lid", lid)}, 0.2));
  for (const char* word : {"tube", "lid", "cross"})
    EXPECT_NE(told.find(word), std::string::npos) << told;
}

TEST_F(Bodies, GoOnAfterInterruptionsToTheSameRecords) {
  const MeshOptions options =
      this->options({off("shell", sphere(1, 16, 32)), off("core", sphere(0.5, 12, 24))}, 0.2);
  const Contents expected = meshed(options, "whole");
  EXPECT_TRUE(are_equal(expected, meshed_with_stops(options, 7)));
}

TEST_F(Bodies, OfSeveralRanksAreThoseOfOneProcess) {
  const MeshOptions options = this->options(
      {off("outer", box({-1, -1, -1}, {1, 1, 1})), off("core", sphere(0.6, 16, 32))}, 0.2);
  const Contents expected = meshed(options, "one");
  EXPECT_TRUE(are_equal(expected, meshed_on_ranks(options)));
}

TEST_F(Bodies, OddInputIsRefused) {
  const auto a = off("a", sphere(1, 10, 20)), c = off("c", sphere(0.5, 10, 20));
  EXPECT_NE(refusal_of(options({a, a}, 0.2)).find("given twice"), std::string::npos);
  EXPECT_NE(refusal_of(options({a, off("copy", sphere(1, 10, 20))}, 0.2)).find("copy.off"),
            std::string::npos);
  MeshOptions unknown = options({a, c}, 0.2);
  unknown.voids = {"d"};
  EXPECT_NE(refusal_of(unknown).find("no body that is called d"), std::string::npos);
  unknown.voids = {"a", "c"};
  EXPECT_NE(refusal_of(unknown).find("all void"), std::string::npos);
  unknown.voids = {"a"};  // what lies around c is nothing, and so is what lies outside of a
  EXPECT_NE(refusal_of(unknown).find("bounds nothing"), std::string::npos);
  Shape open = sphere(0.4, 10, 20);
  open.triangles.pop_back();
  EXPECT_NE(refusal_of(options({a, off("open", open)}, 0.2)).find("not closed"), std::string::npos);
  MeshOptions alone = options({a}, 0.2);
  alone.voids = {"a"};
  EXPECT_NE(refusal_of(alone).find("--void"), std::string::npos);
  MeshOptions both = options({a, c}, 0.2);
  both.has_bodies = true;
  EXPECT_NE(refusal_of(both).find("leave --bodies out"), std::string::npos);
}

}  // namespace
}  // namespace locvol
