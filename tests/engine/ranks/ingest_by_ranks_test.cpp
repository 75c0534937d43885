// A surface that ranks take in together, against one process.
#include "engine/ranks/ingest_by_ranks.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <cstring>
#include <functional>
#include <limits>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "engine/engine.h"
#include "engine/exchange/thread_ranks.h"
#include "engine/ingest/given_edges.h"
#include "engine/ingest/option_files.h"
#include "engine/ingest/surface_input.h"
#include "engine/plan/run_setup.h"
#include "engine/rank_engine.h"
#include "engine/ranks/move_leaves.h"
#include "engine/shared/input_error.h"
#include "engine/shared/stop_source.h"
#include "tests/engine/ingest/random_surfaces.h"
#include "tests/engine/ingest/surface_fixtures.h"
#include "tests/engine/store_contents.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

// A surface taken in, or why not.
struct TakenIn {
  bool needs_one_process = false;
  std::string refusal;
  Contents contents;
};

class IngestByRanksTest : public testing::Test {
 protected:
  MeshOptions options(const std::string& name, const std::string& content, double size) const {
    MeshOptions options;
    options.input = files_.write(name, content);
    options.size = {size, true};
    options.leaf_capacity = 50;
    return options;
  }

  TakenIn by_one(const MeshOptions& options) {
    IngestWatch watch;
    Workers workers(1);
    const std::filesystem::path store = next_store();
    try {
      RawSurface raw = read_surface(options.input, files_.directory(), watch);
      const RunRecord run =
          planned_run(options, raw.digest, raw.box, survey_files(options, raw.box));
      ingest(std::move(raw), run, calls(store), watch, workers);
    } catch (const InputError& error) {
      return {.needs_one_process = false, .refusal = error.what(), .contents = {}};
    }
    return {.needs_one_process = false, .refusal = {}, .contents = contents_of(store)};
  }

  TakenIn by_ranks(int num_ranks, const MeshOptions& options,
                   std::uint64_t bucket_capacity = kBucketCapacity) {
    const std::filesystem::path store = next_store();
    std::atomic<int> num_taken = 0;
    try {
      run_as_ranks(num_ranks, [&](Exchange& exchange) {
        IngestWatch watch;
        const std::filesystem::path own = store.string() + "-" + std::to_string(exchange.rank());
        auto part = taken_in(options, own, watch, exchange, bucket_capacity);
        if (!part) return;
        ++num_taken;
        std::optional<Store> whole;
        if (exchange.rank() == 0) whole = Store::open(store, kNotDurable);
        join_leaves({&*part, 1}, whole ? &*whole : nullptr, exchange);
      });
    } catch (const InputError& error) {
      return {.needs_one_process = false, .refusal = error.what(), .contents = {}};
    }
    if (num_taken == 0) return {.needs_one_process = true, .refusal = {}, .contents = {}};
    EXPECT_EQ(num_taken, num_ranks);
    return {.needs_one_process = false, .refusal = {}, .contents = contents_of(store)};
  }

  std::optional<Store> taken_in(const MeshOptions& options, const std::filesystem::path& store,
                                IngestWatch& watch, Exchange& exchange,
                                std::uint64_t bucket_capacity = kBucketCapacity) {
    Workers workers(exchange.rank() % 2 + 1);
    return ingest_by_ranks(
        options.input, files_.directory(),
        [&](const std::string& digest, const Box& box) {
          EXPECT_EQ(exchange.rank(), 0);
          return planned_run(options, digest, box, survey_files(options, box));
        },
        calls(store), watch, workers, exchange, disk_of, bucket_capacity);
  }

  std::filesystem::path next_store() { return scratch_ / std::to_string(num_stores_++); }

  static IngestCalls calls(const std::filesystem::path& store) {
    return {[](const RunRecord&, std::uint64_t) {}, [](const RunRecord&) {},
            [store] { return Store::open(store, kNotDurable); }};
  }

  static constexpr StoreOptions kNotDurable{.create = true, .is_durable = false};

  SurfaceFiles files_;
  TempDir scratch_;
  int num_stores_ = 0;
};

struct Encoded {
  std::string name;
  std::function<std::string(const Polygons&)> encode;
};

const std::vector<Encoded> kFormats = {
    {"surface.stl", [](const Polygons& s) { return to_binary_stl(s); }},
    {"surface.ply", [](const Polygons& s) { return to_ply(s, PlyEncoding::kLittleEndian); }},
    {"surface.ply", [](const Polygons& s) { return to_ply(s, PlyEncoding::kBigEndian); }}};

TEST_F(IngestByRanksTest, HasTheRecordsOfOneProcess) {
  Random random(1);
  const Polygons balls = random_balls(random);
  for (const auto& [name, encode] : kFormats) {
    const MeshOptions options = this->options(name, encode(balls), 3);
    const TakenIn expected = by_one(options);
    ASSERT_EQ(expected.refusal, "");
    EXPECT_GT(expected.contents.leaves.size(), 500U);
    EXPECT_GT(expected.contents.run.surface.num_components, 5U);
    for (const int num_ranks : name == "surface.stl" ? std::vector{2, 3, 5, 7} : std::vector{4}) {
      const TakenIn found = by_ranks(num_ranks, options, 300);
      EXPECT_FALSE(found.needs_one_process);
      EXPECT_EQ(found.refusal, "");
      EXPECT_TRUE(are_equal(expected.contents, found.contents)) << name << ", " << num_ranks;
    }
  }
}

// Groups in slabs, in an order that ranks see differently, and sheets that end at sharp edges.
TEST_F(IngestByRanksTest, NumbersGroupsAndSheetsAsOneProcessDoes) {
  Random random(3);
  for (int trial = 0; trial < 4; ++trial) {
    const Polygons shape = trial % 2 == 0 ? manifold_voxels(random, files_) : random_balls(random);
    std::string content = fmt::format(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\n"
        "property double x\nproperty double y\nproperty double z\nelement face {}\n"
        "property list uchar int vertex_indices\nproperty int patch\nend_header\n",
        shape.vertices.size(), shape.faces.size());
    const auto put = [&](const auto& value) {
      content.append(reinterpret_cast<const char*>(&value), sizeof value);
    };
    for (const Point& p : shape.vertices) put(p);
    for (const auto& face : shape.faces) {
      put(std::uint8_t{3});
      for (const std::uint32_t v : face) put(v);
      put(trial < 2 ? 7 : static_cast<std::int32_t>(std::floor(shape.vertices[face[0]].y)));
    }
    MeshOptions options = this->options("patches.ply", content, 20);
    options.sharp_angle = trial == 3 ? 0 : 25;
    const TakenIn expected = by_one(options);
    ASSERT_EQ(expected.refusal, "");
    EXPECT_GT(expected.contents.sheets.sheets.size(), trial == 0 ? 5U : 1U);
    EXPECT_EQ(expected.contents.sheets.creases.empty(), trial == 3);
    for (const int num_ranks : {2, 5}) {
      const TakenIn found = by_ranks(num_ranks, options, 200);
      EXPECT_FALSE(found.needs_one_process);
      EXPECT_TRUE(are_equal(expected.contents, found.contents)) << trial << ", " << num_ranks;
    }
  }
}

// Edges here and there, one or several to a piece; each rank finds those in its cells.
TEST_F(IngestByRanksTest, FindsGivenEdgesAsOneProcessDoes) {
  Random random(5);
  const Polygons solid = manifold_voxels(random, files_);
  MeshOptions options = this->options("solid.stl", to_binary_stl(solid), 20);
  options.sharp_angle = 0;
  std::set<EdgeEnds> edges;
  std::string polylines;
  for (const auto& face : solid.faces)
    for (std::size_t k = 0; k < 3; ++k) {
      const EdgeEnds edge = ends_of(solid.vertices[face[k]], solid.vertices[face[(k + 1) % 3]]);
      if (norm(edge[1] - edge[0]) > 1 || random() % 2 == 0) continue;
      edges.insert(edge);
    }
  for (const auto& [a, b] : edges) {
    Point end = b;
    while (edges.contains({end, end + (b - a)})) end = end + (b - a);
    polylines += fmt::format("2 {} {} {} {} {} {}\n", a.x, a.y, a.z, end.x, end.y, end.z);
  }
  options.sharp_polylines = files_.write("given.txt", polylines);
  const TakenIn expected = by_one(options);
  ASSERT_EQ(expected.refusal, "");
  std::set<EdgeEnds> found_edges;
  for (const auto& [key, leaf] : expected.contents.leaves)
    for (const CreaseEdge& edge : leaf.surface.creases) found_edges.insert(edge.ends);
  EXPECT_EQ(found_edges, edges);
  for (const int num_ranks : {2, 5}) {
    const TakenIn found = by_ranks(num_ranks, options, 200);
    EXPECT_FALSE(found.needs_one_process);
    EXPECT_TRUE(are_equal(expected.contents, found.contents)) << num_ranks;
  }
  for (const std::string line : {"2 0 0 0 0.5 0 0\n", "2 0 0 0 100 0 0\n"}) {
    options.sharp_polylines = files_.write("bad.txt", polylines + line);
    const std::string refusal = by_one(options).refusal;
    EXPECT_NE(refusal.find(fmt::format("bad.txt: line {}: ", edges.size() + 1)), std::string::npos)
        << refusal;
    for (const int num_ranks : {2, 5})
      EXPECT_EQ(by_ranks(num_ranks, options, 200).refusal, refusal) << num_ranks;
  }
}

// Of good surfaces and bad ones, with all sizes of buckets.
TEST_F(IngestByRanksTest, JudgesAsOneProcess) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  Random random(seed);
  int num_taken = 0, num_refused = 0, num_left = 0;
  for (int round = 0; round < 2; ++round)
    for (const auto& [kind, surface] : random_samples(random, files_)) {
      const auto& [name, encode] = kFormats[below(random, kFormats.size())];
      MeshOptions options = this->options(name, encode(surface), 5);
      if (random() % 4) options.weld = Size{};  // or one process has to see what is open
      const int num_ranks = static_cast<int>(2 + below(random, 6));
      SCOPED_TRACE(kind + ", " + name + ", " + std::to_string(num_ranks));
      const TakenIn expected = by_one(options);
      const TakenIn found =
          by_ranks(num_ranks, options, std::array{50'000U, 400U, 60U}[below(random, 3)]);
      if (found.needs_one_process) {
        ++num_left;
        continue;
      }
      EXPECT_EQ(found.refusal, expected.refusal);
      EXPECT_TRUE(are_equal(expected.contents, found.contents));
      ++(found.refusal.empty() ? num_taken : num_refused);
    }
  EXPECT_GT(num_taken, 1);
  EXPECT_GT(num_refused, 3);
  EXPECT_GT(num_left, 3);
}

TEST_F(IngestByRanksTest, MayHaveMoreRanksThanTriangles) {
  const MeshOptions options = this->options("cube.stl", to_binary_stl(cube()), 20);
  const TakenIn expected = by_one(options);
  ASSERT_EQ(expected.refusal, "");
  EXPECT_TRUE(are_equal(expected.contents, by_ranks(17, options).contents));
}

// Notes, but no repair.
TEST_F(IngestByRanksTest, LeavesOutTrianglesWithoutThreeCorners) {
  Polygons surface = to_polygons(testing_shapes::sphere(1, 20, 30));
  surface.vertices.push_back({5, 5, 5});
  surface.faces.insert(surface.faces.begin() + 7, {3, 3, 4});
  surface.faces.push_back({1, 2, 2});
  for (const auto& [name, encode] : kFormats) {
    const MeshOptions options = this->options(name, encode(surface), 4);
    const TakenIn expected = by_one(options);
    EXPECT_FALSE(expected.contents.run.surface.notes.empty());
    EXPECT_TRUE(are_equal(expected.contents, by_ranks(4, options).contents));
  }
}

TEST_F(IngestByRanksTest, LeavesOtherFilesToOneProcess) {
  const Polygons sphere = to_polygons(testing_shapes::sphere(1, 20, 30));
  Polygons quads = sphere;
  quads.append(box_of_quads({3, 3, 3}, {4, 4, 4}));
  std::string damaged = to_binary_stl(sphere);
  const float no_number = std::numeric_limits<float>::quiet_NaN();
  std::memcpy(damaged.data() + 84 + 50 * 700 + 12, &no_number, sizeof no_number);
  Polygons beyond = sphere;
  beyond.faces.back()[1] = 100'000;
  for (const auto& [name, content] :
       std::vector<NamedFile>{{"surface.off", to_off(sphere)},
                              {"surface.stl", to_ascii_stl(sphere)},
                              {"surface.ply", to_ply(sphere, PlyEncoding::kAscii)},
                              {"surface.ply", to_ply(quads, PlyEncoding::kLittleEndian)},
                              {"surface.ply", to_ply(beyond, PlyEncoding::kBigEndian)},
                              {"surface.ply", to_ply(sphere, PlyEncoding::kBigEndian) + "more"},
                              {"surface.stl", damaged},
                              {"surface.stl", to_binary_stl({})},
                              {"surface.stl", damaged.substr(0, 20'000)}}) {
    SCOPED_TRACE(name);
    EXPECT_TRUE(by_ranks(3, options(name, content, 5)).needs_one_process);
  }
  MeshOptions nowhere = options("surface.stl", damaged, 5);
  nowhere.input = files_.directory() / "nowhere.stl";
  EXPECT_TRUE(by_ranks(3, nowhere).needs_one_process);
}

// Points that are nearly one are joined by one process, whatever number takes part.
TEST_F(IngestByRanksTest, JoinsPointsAsOneProcess) {
  Random random(6);
  const Polygons loose =
      jittered(to_polygons(testing_shapes::sphere(1, 12, 24)), 1e-7, random);  // in float32
  MeshOptions options = this->options("surface.stl", to_binary_stl(loose), 10);
  options.leaf_capacity = 300;
  for (const auto& weld : {std::optional<Size>(), std::optional(Size{1e-4, true})}) {
    options.weld = weld;
    options.store = scratch_ / (weld ? "one" : "one-auto");
    mesh(options);
    const Contents expected = contents_of(options.store);
    EXPECT_EQ(expected.run.surface.num_triangles, loose.faces.size());
    EXPECT_EQ(expected.run.surface.notes.size(), 1U);
    EXPECT_TRUE(by_ranks(3, options).needs_one_process);
    for (const int num_ranks : {1, 3}) {
      MeshOptions many = options;
      many.store = scratch_ / fmt::format("{}-{}-%r", weld ? "many" : "auto", num_ranks);
      run_as_ranks(num_ranks, [&](Exchange& exchange) {
        const RunSummary summary = mesh_as_rank(many, {}, exchange);
        EXPECT_EQ(summary.run.surface, expected.run.surface);
        EXPECT_EQ(summary.run.counts, expected.run.counts);
        join_ranks(many.store, scratch_ / "joined", {}, exchange);
      });
      EXPECT_TRUE(are_equal(expected, contents_of(scratch_ / "joined"))) << num_ranks;
      std::filesystem::remove_all(scratch_ / "joined");
    }
  }
  Polygons open = to_polygons(testing_shapes::sphere(1, 12, 24));
  open.faces.pop_back();
  options = this->options("open.stl", to_binary_stl(open), 10);
  EXPECT_TRUE(by_ranks(3, options).needs_one_process);
  options.weld = Size{};
  EXPECT_NE(by_ranks(3, options).refusal, "") << "where nothing is joined, all can say so";
  EXPECT_EQ(by_ranks(3, options).refusal, by_one(options).refusal);
}

// What one process says then is said of the whole run.
TEST_F(IngestByRanksTest, WhatNeedsOneProcessIsMeshedAllTheSame) {
  Polygons copies = to_polygons(testing_shapes::sphere(1, 10, 20));
  copies.faces.push_back(copies.faces[17]);
  MeshOptions options = this->options("surface.stl", to_binary_stl(copies), 10);
  options.leaf_capacity = 300;
  options.store = scratch_ / "one";
  mesh(options);
  MeshOptions many = options;
  many.store = scratch_ / "many-%r";
  run_as_ranks(3, [&](Exchange& exchange) {
    const RunSummary summary = mesh_as_rank(many, {}, exchange);
    EXPECT_EQ(summary.run.surface.notes, contents_of(options.store).run.surface.notes);
  });
}

// Whenever any rank is stopped, all are, and nothing is left behind.
TEST_F(IngestByRanksTest, AStopOfOneRankIsOneOfAll) {
  MeshOptions options = this->options(
      "surface.stl", to_binary_stl(to_polygons(testing_shapes::sphere(1, 80, 160))), 3);
  options.store = scratch_ / "run-%r";
  int num_stopped = 0;
  for (int last = 0;; last += 3) {
    std::atomic<int> num_ended = 0;
    run_as_ranks(3, [&](Exchange& exchange) {
      const bool is_stopping = exchange.rank() == num_stopped % 3;
      int num_asked = 0;
      const StopSource stop([&] { return is_stopping && num_asked++ == last; });
      IngestWatch watch(&stop, {}, 1024);
      try {
        taken_in(options, scratch_ / ("part-" + std::to_string(exchange.rank())), watch, exchange);
      } catch (const Stopped&) {
        ++num_ended;
      }
    });
    if (num_ended == 0) break;
    ASSERT_EQ(num_ended, 3) << last;
    ASSERT_LT(++num_stopped, 1000);
  }
  EXPECT_GT(num_stopped, 5);
}

TEST_F(IngestByRanksTest, TooMuchForTheDiskIsRefused) {
  const MeshOptions options = this->options("cube.stl", to_binary_stl(cube()), 20);
  const auto taken_in_with = [&](double free_bytes) {
    run_as_ranks(2, [&](Exchange& exchange) {
      IngestWatch watch;
      Workers workers(1);
      ingest_by_ranks(
          options.input, files_.directory(),
          [&](const std::string& digest, const Box& box) {
            return planned_run(options, digest, box, survey_files(options, box));
          },
          calls(scratch_ / ("part-" + std::to_string(exchange.rank()))), watch, workers, exchange,
          [&](const std::filesystem::path&) {
            return Disk{0, free_bytes};
          });
    });
  };
  EXPECT_NO_THROW(taken_in_with(181 * 12));
  EXPECT_THROW(taken_in_with(181 * 12 - 1), InputError);
}

}  // namespace
}  // namespace locvol
