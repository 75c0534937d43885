// Runs of the surface alone: triangles, and no cells.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "engine/audit/audit.h"
#include "engine/engine.h"
#include "engine/exchange/thread_ranks.h"
#include "engine/formats/writer.h"
#include "engine/plan/run_estimate.h"
#include "engine/rank_engine.h"
#include "engine/ranks/move_leaves.h"
#include "engine/ranks/rank_store.h"
#include "engine/shared/input_error.h"
#include "tests/engine/closed_shapes.h"
#include "tests/engine/store_contents.h"
#include "tests/file_bytes.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

using namespace testing_shapes;

// What the facets of a store make, by what is listed alone.
struct Triangles {
  std::uint64_t num = 0, num_bad_edges = 0;  // not of two facets that face the same way
  std::int64_t euler_characteristic = 0;
  double volume = 0;
};

Triangles triangles_of(const Contents& contents) {
  std::map<std::uint64_t, Point> places;
  for (const auto& [key, leaf] : contents.leaves)
    for (const MeshPoint& p : leaf.points.points) places[p.id] = p.position;
  Triangles found;
  std::map<std::pair<std::uint64_t, std::uint64_t>, int> num_ways;  // directed
  std::set<std::uint64_t> vertices;
  for (const auto& [key, leaf] : contents.leaves)
    for (const MeshFacet& facet : leaf.facets.facets) {
      std::array<std::uint64_t, 3> ids{};
      std::ranges::transform(facet.vertices, ids.begin(),
                             [&](std::uint32_t v) { return leaf.facets.vertices[v]; });
      ++found.num;
      for (std::size_t i = 0; i < 3; ++i) ++num_ways[{ids[i], ids[(i + 1) % 3]}];
      vertices.insert(ids.begin(), ids.end());
      found.volume += dot(places.at(ids[0]), cross(places.at(ids[1]), places.at(ids[2]))) / 6;
    }
  for (const auto& [edge, num] : num_ways) {
    const auto back = num_ways.find({edge.second, edge.first});
    found.num_bad_edges += num != 1 || back == num_ways.end() || back->second != 1;
  }
  found.euler_characteristic = static_cast<std::int64_t>(vertices.size()) -
                               static_cast<std::int64_t>(num_ways.size() / 2) +
                               static_cast<std::int64_t>(found.num);
  return found;
}

class SurfaceOnly : public testing::Test {
 protected:
  MeshOptions options(const Shape& shape, double size, std::uint64_t leaf_capacity = 400) {
    const std::filesystem::path file = dir_ / (std::to_string(++num_files_) + ".off");
    write_off(shape, file);
    MeshOptions options;
    options.input = file;
    options.size = {size, false};
    options.leaf_capacity = leaf_capacity;
    options.is_surface_only = true;
    return options;
  }

  Contents meshed(MeshOptions options, const std::string& name, int num_threads = 1) {
    options.store = dir_ / name;
    RunControl control;
    control.num_threads = num_threads;
    outcome_ = mesh(options, control).outcome;
    return contents_of(options.store);
  }

  Contents meshed_with_stops(MeshOptions options, std::uint64_t step) {
    options.store = dir_ / ("stopped " + std::to_string(step));
    RunControl control;
    control.num_threads = 2;
    std::uint64_t asked = 0;
    control.is_stopped = [&] { return ++asked % step == 0; };
    int num_pieces = 0;
    for (auto summary = mesh(options, control); summary.outcome == RunOutcome::kInterrupted;
         summary = resume(options.store, control))
      if (++num_pieces == 5000) {
        ADD_FAILURE() << "it does not end";
        break;
      }
    EXPECT_GT(num_pieces, 2);
    return contents_of(options.store);
  }

  Contents meshed_on_ranks(MeshOptions options, int num_ranks) {
    const std::string name = dir_ / ("ranks " + std::to_string(num_ranks));
    run_as_ranks(num_ranks, [&](Exchange& exchange) {
      MeshOptions all = options;
      all.store = name + "-%r";
      RunControl control;
      control.num_threads = 1;
      mesh_as_rank(all, control, exchange);
      const Store own = Store::open(store_of_rank(all.store, exchange.rank()), {.read_only = true});
      const AuditReport report = audit_as_rank(own, exchange);
      std::optional<Store> whole;
      if (exchange.rank() == 0) {
        report_of_ranks_ = report;
        whole = Store::open(name, {.create = true});
      }
      join_leaves({&own, 1}, whole ? &*whole : nullptr, exchange);
    });
    return contents_of(name);
  }

  AuditReport audited(const std::string& name) {
    return audit(Store::open(dir_ / name, {.read_only = true}));
  }

  std::string written(const std::string& name, MeshFormat format, int num_threads = 1) {
    const std::filesystem::path file = dir_ / "written";
    write_mesh(Store::open(dir_ / name, {.read_only = true}), file, {.format = format},
               num_threads);
    return bytes_of(file);
  }

  TempDir dir_;
  int num_files_ = 0;
  RunOutcome outcome_ = RunOutcome::kDone;
  AuditReport report_of_ranks_;
};

void expect_closed(const Contents& contents, std::int64_t euler_characteristic) {
  const Triangles found = triangles_of(contents);
  EXPECT_GT(found.num, 100U);
  EXPECT_EQ(found.num, contents.run.counts.num_cells);
  EXPECT_EQ(found.num_bad_edges, 0U);
  EXPECT_EQ(found.euler_characteristic, euler_characteristic);
  for (const auto& [key, leaf] : contents.leaves) {
    EXPECT_TRUE(leaf.cells.cells.empty());
    EXPECT_TRUE(leaf.points.core.is_empty());
    for (const MeshPoint& p : leaf.points.points) EXPECT_TRUE(is_on_surface(p.kind));
  }
}

TEST_F(SurfaceOnly, ASphereIsClosedAndFacesOutwards) {
  const Shape shape = sphere(1, 48, 96);
  for (const std::uint64_t capacity : {std::uint64_t{30000}, std::uint64_t{100}}) {
    const std::string name = std::to_string(capacity);
    const Contents contents = meshed(options(shape, 0.1, capacity), name);
    EXPECT_EQ(outcome_, RunOutcome::kDone);
    expect_closed(contents, 2);
    const double volume = contents.run.surface.volume;
    EXPECT_NEAR(triangles_of(contents).volume, volume, 0.01 * volume);
    const AuditReport report = audited(name);
    EXPECT_TRUE(report.is_valid()) << testing::PrintToString(report.violations);
    EXPECT_EQ(report.num_boundary_facets, contents.run.counts.num_cells);
    EXPECT_NEAR(report.volume, triangles_of(contents).volume, 1e-9);
    EXPECT_GT(report.max_circumradius, 0.5);
    EXPECT_LT(report.max_circumradius, 1);
    EXPECT_GT(report.min_facet_degrees, 20);
  }
}

// Far apart or in each other: what lies between the walls is in no cell.
TEST_F(SurfaceOnly, AShellHasTwoComponents) {
  const Contents contents = meshed(options(shell(1, 0.4, 32), 0.08), "store");
  expect_closed(contents, 4);
  const AuditReport report = audited("store");
  EXPECT_TRUE(report.is_valid()) << testing::PrintToString(report.violations);
  EXPECT_EQ(report.num_components, 2U);
}

TEST_F(SurfaceOnly, AThinShellDoesToo) {
  const Contents contents = meshed(options(shell(1, 0.06, 32), 0.1), "store");
  expect_closed(contents, 4);
  EXPECT_TRUE(audited("store").is_valid());
}

TEST_F(SurfaceOnly, ABoxKeepsItsEdgesAndVolume) {
  const Contents contents = meshed(options(box({0, 0, 0}, {1, 2, 3}), 0.2), "store");
  expect_closed(contents, 2);
  EXPECT_NEAR(triangles_of(contents).volume, 6, 1e-9);
  const AuditReport report = audited("store");
  EXPECT_TRUE(report.is_valid()) << testing::PrintToString(report.violations);
  EXPECT_NEAR(report.crease_length, 24, 1e-6);
  EXPECT_EQ(report.lost_crease_length, 0);
}

TEST_F(SurfaceOnly, BodiesShareWhatLiesBetweenThem) {
  MeshOptions two = options(box({0, 0, 0}, {1, 1, 1}), 0.15);
  two.more_inputs = {options(box({1, 0, 0}, {2, 1, 1}), 0.15).input};
  meshed(two, "store");
  const AuditReport report = audited("store");
  EXPECT_TRUE(report.is_valid()) << testing::PrintToString(report.violations);
  ASSERT_EQ(report.body_volumes.size(), 2U);
  EXPECT_NEAR(report.body_volumes[0], 1, 1e-9);
  EXPECT_NEAR(report.body_volumes[1], 1, 1e-9);
  EXPECT_NEAR(report.volume, 2, 1e-9);
}

TEST_F(SurfaceOnly, SizesThatVaryAreKept) {
  MeshOptions graded = options(torus(1, 0.3, 96, 48), 0.2);
  graded.per_circle = 24;
  const Contents contents = meshed(graded, "store");
  expect_closed(contents, 0);
  const AuditReport report = audited("store");
  EXPECT_TRUE(report.is_valid()) << testing::PrintToString(report.violations);
  const Contents uniform = meshed(options(torus(1, 0.3, 96, 48), 0.2), "uniform");
  EXPECT_GT(contents.run.counts.num_cells, 2 * uniform.run.counts.num_cells);
}

TEST_F(SurfaceOnly, GivesTheSameRecordsHoweverItIsMade) {
  const MeshOptions options = this->options(torus(1, 0.4, 64, 32), 0.08, 100);
  const Contents expected = meshed(options, "one");
  EXPECT_GT(expected.run.counts.num_visits, 10U);
  EXPECT_TRUE(are_equal(expected, meshed(options, "three", 3)));
  EXPECT_TRUE(are_equal(expected, meshed_with_stops(options, 23)));
  for (const int num_ranks : {2, 3}) {
    EXPECT_TRUE(are_equal(expected, meshed_on_ranks(options, num_ranks))) << num_ranks;
    AuditReport alone = audited("one");
    EXPECT_NEAR(alone.volume, report_of_ranks_.volume, 1e-12);
    alone.volume = report_of_ranks_.volume;
    EXPECT_TRUE(alone == report_of_ranks_) << num_ranks;
  }
}

// Sharp edges without creases leave sites, and a surface that is mended.
TEST_F(SurfaceOnly, IsMendedAlikeHoweverItIsMade) {
  MeshOptions options = this->options(knives(), 1, 200);
  options.sharp_angle = 0;
  const Contents expected = meshed(options, "one");
  EXPECT_EQ(outcome_, RunOutcome::kUnresolved);
  EXPECT_EQ(triangles_of(expected).num_bad_edges, 0U);
  const AuditReport report = audited("one");
  EXPECT_TRUE(report.is_valid()) << testing::PrintToString(report.violations);
  EXPECT_TRUE(are_equal(expected, meshed(options, "three", 3)));
  EXPECT_TRUE(are_equal(expected, meshed_with_stops(options, 29)));
  EXPECT_TRUE(are_equal(expected, meshed_on_ranks(options, 2)));
}

TEST_F(SurfaceOnly, IsWrittenInEachFormatOfTriangles) {
  MeshOptions options = this->options(box({0, 0, 0}, {1, 1, 1}), 0.1);
  const std::uint64_t num = meshed(options, "store").run.counts.num_cells;
  for (const FormatInfo& info : mesh_formats()) {
    if (!info.holds_triangles_alone) {
      EXPECT_THROW(written("store", info.format), InputError) << info.name;
      continue;
    }
    const std::string bytes = written("store", info.format);
    EXPECT_FALSE(bytes.empty()) << info.name;
    if (info.format != MeshFormat::kVtkHdf) {
      EXPECT_EQ(bytes, written("store", info.format, 3)) << info.name;
    }
  }
  EXPECT_EQ(written("store", MeshFormat::kStl).size(), 84 + 50 * num);
  EXPECT_NE(
      written("store", MeshFormat::kVtp).find("NumberOfPolys=\"" + std::to_string(num) + "\""),
      std::string::npos);
}

TEST_F(SurfaceOnly, WhatHasNoSenseIsRefused) {
  MeshOptions paper = options(box({0, 0, 0}, {1, 1, 1}), 0.2);
  paper.store = dir_ / "store";
  paper.init = Initialization::kPaper;
  EXPECT_THROW(mesh(paper), InputError);
  MeshOptions angle = options(box({0, 0, 0}, {1, 1, 1}), 0.2);
  angle.store = dir_ / "store";
  angle.min_dihedral = 15;
  EXPECT_THROW(mesh(angle), InputError);
  EXPECT_THROW(of_surface({.format = MeshFormat::kVtu, .order = 2}), InputError);
  EXPECT_THROW(of_surface({.format = MeshFormat::kTetgen}), InputError);
  EXPECT_THROW(of_surface({.format = MeshFormat::kVtu, .has_quality = true}), InputError);
}

TEST_F(SurfaceOnly, IsEstimated) {
  const MeshOptions options = this->options(sphere(1, 48, 96), 0.05);
  const Contents contents = meshed(options, "store");
  RunRecord before = contents.run;
  before.phase = Phase::kCover;
  const RunEstimate estimate = estimate_run(before, {.format = MeshFormat::kStl});
  const auto num = static_cast<double>(contents.run.counts.num_cells);
  EXPECT_NEAR(estimate.num_cells, num, (kCellsFactor - 1) * num);
  EXPECT_NEAR(estimate.output.file_bytes, 50 * num, (kFileFactor - 1) * 50 * num);
}

// The audit finds what is wrong with what is listed.
TEST_F(SurfaceOnly, TheAuditFindsFacetsThatAreMissingOrTurned) {
  meshed(options(sphere(1, 32, 64), 0.15, 30000), "store");
  const auto change = [&](const auto& how) {
    Store store = Store::open(dir_ / "store", {});
    for (const MortonKey leaf : store.snapshot().leaf_keys()) {
      LeafFacets facets = store.snapshot().facets(leaf);
      if (facets.facets.empty()) continue;
      how(facets);
      Batch batch = store.begin();
      batch.put_facets(leaf, facets);
      batch.commit();
      return;
    }
  };
  ASSERT_TRUE(audited("store").is_valid());
  LeafFacets before;
  change([&](LeafFacets& facets) {
    before = facets;
    facets.facets.pop_back();
  });
  EXPECT_GT(audited("store").num_bad_boundary_edges, 0U);
  change([&](LeafFacets& facets) {
    facets = before;
    std::swap(facets.facets.front().vertices[1], facets.facets.front().vertices[2]);
  });
  EXPECT_EQ(audited("store").num_misoriented_edges, 3U);
  change([&](LeafFacets& facets) {
    facets = before;
    facets.facets.push_back(facets.facets.front());
    std::ranges::sort(facets.facets);
  });
  EXPECT_EQ(audited("store").num_overused_facets, 1U);
  change([&](LeafFacets& facets) { facets = before; });
  EXPECT_TRUE(audited("store").is_valid());
}

}  // namespace
}  // namespace locvol
