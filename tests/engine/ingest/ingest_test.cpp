// What does not depend on how a surface is cut into buckets: facts, refusals, the leaves' records.
#include "engine/ingest/ingest.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <csignal>
#include <map>
#include <random>
#include <string>
#include <system_error>
#include <vector>

#include "engine/engine.h"
#include "engine/ingest/start_leaves.h"
#include "engine/ingest/triangle_spill.h"
#include "engine/ingest/vertex_spill.h"
#include "engine/plan/octree_plan.h"
#include "engine/plan/run_setup.h"
#include "refine/domain/triangle_box.h"
#include "tests/engine/closed_shapes.h"
#include "tests/engine/ingest/random_surfaces.h"
#include "tests/engine/ingest/surface_fixtures.h"
#include "tests/engine/ingest/surface_writers.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

// ---- Judged in one bucket and in many ----

TEST(IngestBuckets, DecideNeitherFactsNorRefusals) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  Random random(seed);
  const SurfaceFiles files;
  int num_refused = 0, num_accepted = 0;
  // Chance decides how many are good: two rounds most often have ten of either kind.
  const auto are_few = [&] { return num_accepted < 10 || num_refused < 10; };
  for (int round = 0; round < 2 || (round < 10 && are_few()); ++round)
    for (const auto& [name, surface] : random_samples(random, files)) {
      SCOPED_TRACE(name);
      const auto file = files.write("surface.off", to_off(surface));
      const Judgement whole = judge(file, 1'000'000);
      (whole.refusal.empty() ? num_accepted : num_refused) += 1;
      for (const std::uint64_t capacity : {400u, 60u, 12u}) {
        const Judgement pieces = judge(file, capacity);
        EXPECT_EQ(pieces.refusal, whole.refusal) << capacity;
        EXPECT_EQ(pieces.facts.notes, whole.facts.notes) << capacity;
        EXPECT_EQ(pieces.facts.num_components, whole.facts.num_components) << capacity;
        EXPECT_EQ(pieces.facts.volume, whole.facts.volume) << capacity;
        EXPECT_TRUE(pieces == whole) << capacity;
      }
    }
  EXPECT_FALSE(are_few()) << num_accepted << " accepted, " << num_refused << " refused";
}

// Where three triangles share an edge, a cell may have two of them alone; with this seed it named
// another cure than the whole did.
TEST(IngestBuckets, CureOfFinsIsThatOfTheWhole) {
  const SurfaceFiles files;
  Random random(1001252628);
  for (int round = 0; round < 2; ++round)
    for (const auto& [name, surface] : random_samples(random, files)) {
      if (name != "fins") continue;
      const auto file = files.write("surface.off", to_off(surface));
      const std::string whole = judge(file, 1'000'000).refusal;
      EXPECT_NE(whole.find("locvol wrap"), whole.npos) << whole;
      for (const std::uint64_t capacity : {400u, 60u, 12u})
        EXPECT_EQ(judge(file, capacity).refusal, whole) << capacity;
    }
}

// With these seeds all voxels touched themselves once: no surface was repaired and accepted.
TEST(IngestBuckets, SamplesAreOftenGoodWithAnySeed) {
  const SurfaceFiles files;
  for (const unsigned seed : {10u, 28u, 37u}) {
    Random random(seed);
    int num_repaired = 0;
    for (const auto& [name, surface] : random_samples(random, files)) {
      const bool needs_repair = name.starts_with("flat") || name.starts_with("copies");
      if (needs_repair &&
          judge(files.write("surface.off", to_off(surface)), 1'000'000).refusal.empty())
        ++num_repaired;
    }
    EXPECT_GE(num_repaired, 2) << seed;
  }
}

// A Klein bottle that crosses itself, which is for a later check to find.
TEST(IngestBuckets, KleinBottleIsNotOrientableInAnyNumberOfThem) {
  Polygons bottle;
  constexpr std::uint32_t kAround = 40, kAcross = 20;
  for (std::uint32_t i = 0; i < kAround; ++i)
    for (std::uint32_t j = 0; j < kAcross; ++j) {
      const double u = 2 * std::numbers::pi * i / kAround, v = 2 * std::numbers::pi * j / kAcross;
      const double r = 3 + std::cos(u / 2) * std::sin(v) - std::sin(u / 2) * std::sin(2 * v);
      bottle.vertices.push_back(
          {r * std::cos(u), r * std::sin(u),
           std::sin(u / 2) * std::sin(v) + std::cos(u / 2) * std::sin(2 * v)});
    }
  const auto at = [](std::uint32_t i, std::uint32_t j) {
    // Once around, v becomes -v.
    return i < kAround ? i * kAcross + j % kAcross : (kAcross - j % kAcross) % kAcross;
  };
  for (std::uint32_t i = 0; i < kAround; ++i)
    for (std::uint32_t j = 0; j < kAcross; ++j) {
      bottle.faces.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
      bottle.faces.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
    }
  const SurfaceFiles files;
  const auto file = files.write("klein.off", to_off(bottle));
  for (const std::uint64_t capacity : {1'000'000u, 300u, 40u, 10u})
    EXPECT_NE(judge(file, capacity).refusal.find("not orientable, as a Klein bottle"),
              std::string::npos)
        << capacity << ": " << judge(file, capacity).refusal;
}

TEST(IngestBuckets, ManyTrianglesAtOnePointEnd) {
  // A double cone of 1,500 triangles: no cutting parts them at its tip.
  constexpr std::uint32_t kAround = 1500;
  Polygons cone{{{0, 0, 1}, {0, 0, 0}}, {}};
  for (std::uint32_t i = 0; i < kAround; ++i) {
    const double u = 2 * std::numbers::pi * i / kAround;
    cone.vertices.push_back({std::cos(u), std::sin(u), 0});
    const std::uint32_t a = 2 + i, b = 2 + (i + 1) % kAround;
    cone.faces.push_back({0, a, b});
    cone.faces.push_back({1, b, a});
  }
  const SurfaceFiles files;
  const auto file = files.write("cone.off", to_off(cone));
  const Judgement whole = judge(file, 1'000'000), pieces = judge(file, 50);
  EXPECT_EQ(whole.refusal, "");
  EXPECT_EQ(whole.facts.num_components, 1u);
  EXPECT_TRUE(pieces == whole);
}

TEST(IngestBuckets, HaveEveryTriangleThatMeetsTheirCells) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  Random random(seed);
  const SurfaceFiles files;
  const auto file = files.write("surface.off", to_off(random_balls(random)));
  const InputSurface all = read_whole_surface(file);
  IngestWatch watch;
  Workers workers(2);
  RawSurface raw = read_surface(file, files.directory(), watch);
  const Frame frame = frame_of(raw.box);
  const CheckedSurface checked = check_surface(std::move(raw), frame, watch, workers, 100);
  ASSERT_GT(checked.buckets.all().size(), 20u);
  for (const TriangleBucket& bucket : checked.buckets.all()) {
    std::vector<Triangle> expected;
    std::ranges::copy_if(all.pieces, std::back_inserter(expected),
                         [&](const Triangle& t) { return touches(t, frame.box(bucket.cell)); });
    EXPECT_EQ(checked.load(bucket), expected);
  }
  // The disk is left as it was.
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(files.directory()))
    names.push_back(entry.path().filename());
  EXPECT_EQ(names, std::vector<std::string>{"surface.off"});
}

// ---- The store ----

struct StoredLeaf {
  LeafInfo info;
  LeafSurface surface;
  friend bool operator==(const StoredLeaf&, const StoredLeaf&) = default;
};
struct Stored {
  RunRecord run;
  std::map<MortonKey, StoredLeaf> leaves;
  std::vector<QueueEntry> queue;
  friend bool operator==(const Stored&, const Stored&) = default;
};

Stored stored(const Store& store) {
  const Snapshot snapshot = store.snapshot();
  Stored all{*snapshot.run(), {}, {}};
  for (const MortonKey key : snapshot.leaf_keys())
    all.leaves[key] = {*snapshot.leaf(key), snapshot.surface(key)};
  snapshot.for_each_queued([&](const QueueEntry& entry) {
    all.queue.push_back(entry);
    return true;
  });
  return all;
}

class IngestTest : public testing::Test {
 protected:
  MeshOptions options(double size, std::uint64_t leaf_capacity) const {
    MeshOptions options;
    options.input = input_;
    options.store = scratch_ / "store";
    options.size = {size, false};
    options.leaf_capacity = leaf_capacity;
    return options;
  }

  Store ingested(const MeshOptions& options, const std::string& name,
                 std::uint64_t capacity = kBucketCapacity) const {
    IngestWatch watch;
    Workers workers(num_usable_threads());
    RawSurface raw = read_surface(options.input, std::filesystem::temp_directory_path(), watch);
    const RunRecord run = planned_run(options, raw.digest, raw.box);
    const auto open = [&] {
      return Store::open(scratch_ / name, {.create = true, .is_durable = false});
    };
    return ingest(std::move(raw), run,
                  {[](const RunRecord&, std::uint64_t) {}, [](const RunRecord&) {}, open}, watch,
                  workers, capacity);
  }

  void write(const Polygons& s) const { std::ofstream(input_, std::ios::binary) << to_off(s); }

  TempDir scratch_;
  std::filesystem::path input_ = scratch_ / "input.off";
};

TEST_F(IngestTest, LeavesAreTheSameFromOneBucketAndFromMany) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  Random random(seed);
  Polygons flat;
  do {  // a walk may make what is not manifold, and flat triangles what has no repair
    flat = random_voxels(random, 40, 3);
    for (int i = 0; i < 5; ++i) add_flat_triangle(flat, below(random, flat.faces.size()));
    flat.faces.push_back(flat.faces.front());
    write(flat);
  } while (!judge(input_, kBucketCapacity).refusal.empty());
  int num_stores = 0;
  for (Polygons surface : {random_balls(random), flat}) {
    shuffle(surface, random);
    write(surface);
    for (const double size : {3.0, 0.4, 0.15}) {
      const auto run = options(size, 50);
      const Stored whole = stored(ingested(run, std::to_string(++num_stores)));
      EXPECT_EQ(whole.run.phase, whole.run.has_creases ? Phase::kCrease : Phase::kCover);
      for (const std::uint64_t capacity : {300u, 30u})
        EXPECT_TRUE(stored(ingested(run, std::to_string(++num_stores), capacity)) == whole)
            << size << " " << capacity;
    }
  }
}

TEST_F(IngestTest, LeavesAreSmallNearTheSurfaceAndInsideOnly) {
  Polygons s = box_of_triangles({0, 0, 0}, {1, 1, 1});
  s.append(box_of_triangles({9, 9, 9}, {10, 10, 10}));
  write(s);
  constexpr double kSize = 0.02;
  const Store store = ingested(options(kSize, 50), "store");
  const Stored all = stored(store);
  const Frame& frame = all.run.frame;
  std::vector<MortonKey> keys;
  int deepest = 0;
  for (const auto& [key, leaf] : all.leaves) {
    keys.push_back(key);
    deepest = std::max(deepest, key.level());
  }
  EXPECT_NO_THROW(LinearOctree{keys});
  EXPECT_LT(keys.size(), (std::size_t{1} << (3 * deepest)) / 20);
  const Box parts[] = {{{0, 0, 0}, {1, 1, 1}}, {{9, 9, 9}, {10, 10, 10}}};
  double volume_inside = 0;
  for (const auto& [key, leaf] : all.leaves) {
    const Box box = frame.box(key);
    const bool is_near = box.squared_distance(parts[0]) <= kSize * kSize ||
                         box.squared_distance(parts[1]) <= kSize * kSize;
    if (is_near) {
      EXPECT_EQ(key.level(), deepest);
    }
    const bool is_inside = leaf.info.center.body() != kNoBody;
    EXPECT_EQ(is_inside, parts[0].contains(box.center()) || parts[1].contains(box.center()));
    EXPECT_EQ(leaf.info.queued.has_value(), leaf.info.num_triangles > 0 || is_inside);
    if (is_inside) volume_inside += std::pow(frame.side(key.level()), 3);
  }
  EXPECT_NEAR(volume_inside, 2, 0.6);
  EXPECT_GE(frame.side(deepest), kMinLeafSide * kSize);
}

TEST_F(IngestTest, PaperModeStartsWithOneLeaf) {
  write(to_polygons(testing_shapes::torus(1, 0.4, 32, 16)));
  auto run = options(0.05, 50);
  run.init = Initialization::kPaper;
  const Stored all = stored(ingested(run, "store", 40));
  ASSERT_EQ(all.leaves.size(), 1u);
  EXPECT_EQ(all.leaves.begin()->second.surface.triangles.size(), 1024u);
  EXPECT_TRUE(all.queue.empty());
}

TEST_F(IngestTest, LeavesWithTooManyTrianglesAreCut) {
  write(to_polygons(testing_shapes::sphere(1, 400, 500)));  // 400,000 triangles
  const Stored coarse = stored(ingested(options(0.2, 20000), "coarse"));
  EXPECT_GE(coarse.leaves.size(), 8u);  // one would be wide enough
  for (const auto& [key, leaf] : coarse.leaves) {
    const bool may_split = coarse.run.frame.side(key.level() + 1) >= kMinLeafSide * 0.2;
    EXPECT_TRUE(leaf.info.num_triangles <= 55'000 || !may_split) << leaf.info.num_triangles;
  }
}

TEST_F(IngestTest, RefusesTooManyLeavesAndNamesASizeThatWorks) {
  write(to_polygons(testing_shapes::sphere(1, 15, 32)));
  IngestWatch watch;
  for (const double size : {1e-3, 2e-4}) {
    std::string message;
    try {
      ingested(options(size, 50), "store");
    } catch (const InputError& error) {
      message = error.what();
    }
    const std::string words = "choose a size of at least ";
    const auto place = message.find(words);
    ASSERT_NE(place, std::string::npos) << message;
    EXPECT_FALSE(std::filesystem::exists(scratch_ / "store"));
    const double least = std::stod(message.substr(place + words.size()));
    EXPECT_LT(least, 0.02);

    Workers workers(2);
    RawSurface raw = read_surface(input_, scratch_ / ".", watch);
    const RunParameters works = planned_run(options(least, 50), raw.digest, raw.box).parameters;
    const Frame frame = frame_of(raw.box);
    const CheckedSurface surface = check_surface(std::move(raw), frame, watch, workers);
    EXPECT_GT(cells_near_surface(surface, works, watch).size(), 10'000u);
  }
}

// The records say how points are to be joined, whoever reads the surface again.
TEST_F(IngestTest, JoinsPointsAsTheRunSays) {
  Random random(8);
  const Polygons torus = to_polygons(testing_shapes::torus(1, 0.4, 32, 16));
  write(torus);
  const Stored sound = stored(ingested(options(0.2, 50), "sound"));
  EXPECT_FALSE(sound.run.parameters.weld);
  write(jittered(torus, 1e-9, random));
  const auto automatic = options(0.2, 50);
  const Stored joined = stored(ingested(automatic, "joined"));
  EXPECT_EQ(joined.run.surface.num_vertices, sound.run.surface.num_vertices);
  EXPECT_EQ(joined.run.surface.notes.size(), 1U);
  for (const std::uint64_t capacity : {300U, 30U})
    EXPECT_TRUE(stored(ingested(automatic, std::to_string(capacity), capacity)) == joined);
  auto never = automatic;
  never.weld = Size{};
  EXPECT_THROW(ingested(never, "never"), InputError);
  // A percentage is of the smallest side, 0.8.
  auto asked = automatic;
  asked.weld = Size{0.001, true};
  Stored by_length = stored(ingested(asked, "asked"));
  EXPECT_NEAR(by_length.run.parameters.weld.value(), 8e-6, 1e-8);
  EXPECT_NE(by_length.run.surface.notes, joined.run.surface.notes);
  EXPECT_EQ(by_length.leaves, joined.leaves);
}

TEST_F(IngestTest, ARunThatJoinsPointsGoesOnAfterItIsStopped) {
  Random random(9);
  const Polygons sphere = to_polygons(testing_shapes::sphere(1, 150, 200));
  write(jittered(sphere, 1e-9, random));
  auto run = options(0.3, 20000);
  run.weld = Size{1e-6, false};
  for (int at_report = 2; at_report < 100; ++at_report) {
    int num_reports = 0;
    const RunControl control{.on_progress = [&](const Progress&) { ++num_reports; },
                             .is_stopped = [&] { return num_reports >= at_report; },
                             .on_note = {}};
    run.store = scratch_ / std::to_string(at_report);
    try {
      if (mesh(run, control).outcome == RunOutcome::kDone) break;
    } catch (const Stopped&) {
      continue;
    }
    if (Store::open(run.store).snapshot().run()->phase != Phase::kIngest) break;
    const RunSummary summary = resume(run.store);
    EXPECT_EQ(summary.outcome, RunOutcome::kDone);
    EXPECT_EQ(summary.run.surface.num_triangles, sphere.faces.size());
    EXPECT_EQ(summary.run.parameters.weld, 1e-6);
    EXPECT_EQ(mesh(run).outcome, RunOutcome::kDone) << "the same run";
  }
}

// Of 400,000 triangles: the first report comes while they are read, the others later.
TEST_F(IngestTest, GoesOnAfterItIsStopped) {
  write(to_polygons(testing_shapes::sphere(1, 400, 500)));
  const auto run = options(0.3, 20000);
  int num_reports = 0, at_report = 1;
  RunControl control{.on_progress =
                         [&](const Progress& p) {
                           EXPECT_EQ(p.phase, Phase::kIngest);
                           ++num_reports;
                         },
                     .is_stopped = [&] { return num_reports >= at_report; },
                     .on_note = {}};
  EXPECT_THROW(mesh(run, control), Stopped) << "no run is known yet";
  EXPECT_EQ(num_reports, 1);
  EXPECT_FALSE(std::filesystem::exists(run.store));

  num_reports = 0, at_report = 2;
  EXPECT_EQ(mesh(run, control).outcome, RunOutcome::kInterrupted);
  EXPECT_EQ(num_reports, 2);
  EXPECT_EQ(Store::open(run.store).snapshot().run()->phase, Phase::kIngest);

  num_reports = 0, at_report = 1;
  EXPECT_EQ(resume(run.store, control).outcome, RunOutcome::kInterrupted) << "this one is";
  EXPECT_EQ(Store::open(run.store).snapshot().run()->phase, Phase::kIngest);
  num_reports = 0, at_report = 1;
  EXPECT_THROW(mesh(run, control), Stopped) << "it may be another one";
  EXPECT_EQ(resume(run.store).outcome, RunOutcome::kDone);
}

// ---- Files ----

TEST(VertexSpill, GivesBackWhatWasAppended) {
  Random random(7);
  const TempDir scratch;
  VertexSpill vertices(scratch / ".");
  constexpr std::uint32_t kCount = 100'000;
  const auto position = [](std::uint32_t v) { return Point{1.0 * v, 2.0 * v, -1.0 * v}; };
  for (std::uint32_t v = 0; v < kCount; ++v) {
    vertices.append(position(v));
    const std::uint32_t w = below(random, v + 1);
    ASSERT_EQ(vertices.at(w), position(w));
  }
  EXPECT_EQ(vertices.size(), kCount);
}

TEST(TriangleSpill, UsesReleasedExtentsAgain) {
  const TempDir scratch;
  TriangleSpill spill(scratch / ".");
  std::uint64_t bytes = 0;
  for (int round = 0; round < 3; ++round) {
    TriangleList list;
    TriangleWriter writer(spill, list);
    for (std::uint64_t id = 0; id < 1000; ++id)
      writer.append({id, {Point{1, 2, 3}, Point{0, 0, 1.0 * round}, Point{}}});
    writer.flush();
    const std::vector<Triangle> loaded = spill.load(list);
    ASSERT_EQ(loaded.size(), 1000u);
    EXPECT_EQ(loaded[999], (Triangle{999, {Point{1, 2, 3}, Point{0, 0, 1.0 * round}, Point{}}}));
    spill.release(std::move(list));
    if (round == 0) bytes = spill.bytes();
  }
  EXPECT_EQ(spill.bytes(), bytes);
}

TEST(TriangleSpill, FullDiskIsAnErrorThatNamesTheFile) {
  const TempDir scratch;
  const SurfaceFiles files;
  const auto file = files.write("ball.off", to_off(to_polygons(testing_shapes::sphere(1, 60, 60))));
  rlimit usual{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &usual), 0);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  const rlimit small{100'000, usual.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
  std::string message;
  try {
    IngestWatch watch;
    read_surface(file, scratch / ".", watch);
  } catch (const std::system_error& error) {
    message = error.what();
  }
  setrlimit(RLIMIT_FSIZE, &usual);
  std::signal(SIGXFSZ, handler);
  EXPECT_NE(message.find("cannot write"), std::string::npos) << message;
  EXPECT_NE(message.find((scratch / "").string()), std::string::npos) << message;
  EXPECT_NE(message.find("File too large"), std::string::npos) << message;
}

// In buckets that share triangles.
TEST(TriangleSpill, HoldsNoMoreThanAnIngestIsExpectedTo) {
  const SurfaceFiles files;
  const Polygons ball = to_polygons(testing_shapes::sphere(1, 300, 400));
  const auto file = files.write("ball.off", to_off(ball));
  IngestWatch watch;
  Workers workers(2);
  RawSurface raw = read_surface(file, files.directory(), watch);
  const Frame frame = frame_of(raw.box);
  const CheckedSurface checked = check_surface(std::move(raw), frame, watch, workers);
  const auto num_triangles = static_cast<double>(checked.facts.num_triangles);
  ASSERT_GT(num_triangles, 4 * kBucketCapacity);
  const auto bytes = static_cast<double>(checked.spill.bytes());
  EXPECT_LT(bytes, kIngestBytesPerTriangle * num_triangles);
  EXPECT_GT(bytes, 0.9 * kIngestBytesPerTriangle * num_triangles);
}

DiskOf disk_with(double free_bytes) {
  return [=](const std::filesystem::path&) { return Disk{1, free_bytes}; };
}

// Where the file says how much it holds, before a temporary file is made: there is no directory
// for one.
TEST(RawSurface, TooMuchForTheDiskIsRefused) {
  const SurfaceFiles files;
  for (const auto& [name, content] : in_every_format(cube())) {
    SCOPED_TRACE(name);
    const auto file = files.write(name, content);
    const bool has_count =
        name != "ascii.stl" && name != "cube.obj" && name != "cube.glb" && name != "cube.gltf";
    const std::filesystem::path directory =
        has_count ? files.directory() / "missing" : files.directory();
    constexpr double kNeed = 12 * kIngestBytesPerTriangle;
    IngestWatch watch;
    std::string message;
    try {
      const double written = has_count ? 0 : 12 * sizeof(Triangle);
      read_surface(file, directory, watch, disk_with(kNeed - 1 - written));
    } catch (const InputError& error) {
      message = error.what();
    }
    EXPECT_NE(message.find("has 12 triangles"), std::string::npos) << message;
    EXPECT_NE(message.find(
                  fmt::format("{} would take about {:.3g} GB", directory.string(), 1e-9 * kNeed)),
              std::string::npos)
        << message;
    EXPECT_NE(message.find(" GB are free"), std::string::npos) << message;
    EXPECT_NO_THROW(read_surface(file, files.directory(), watch, disk_with(kNeed)));
  }
}

TEST(RawSurface, FacesMayComeBeforeTheirVertices) {
  Polygons boxes;
  for (int i = 0; i < 8000; ++i)
    boxes.append(box_of_triangles({2.0 * i, 0, 0}, {2.0 * i + 1, 1, 1}));
  std::string vertices, faces;
  for (const Point& p : boxes.vertices) vertices += fmt::format("v {} {} {}\n", p.x, p.y, p.z);
  for (const auto& f : boxes.faces)
    faces += fmt::format("f {} {} {}\n", f[0] + 1, f[1] + 1, f[2] + 1);
  const SurfaceFiles files;
  EXPECT_EQ(files.read("faces_first.obj", faces + vertices).pieces,
            files.read("vertices_first.obj", vertices + faces).pieces);
}

}  // namespace
}  // namespace locvol
