// Surfaces that enclose nothing, taken in by winding numbers.
#include <gtest/gtest.h>

#include <cstdint>
#include <random>
#include <string>
#include <utility>

#include "engine/ingest/surface_input.h"
#include "engine/shared/memory_budget.h"
#include "tests/engine/ingest/random_surfaces.h"
#include "tests/engine/ingest/surface_fixtures.h"
#include "tests/engine/ingest/surface_writers.h"

namespace locvol {
namespace {

// What is known of a surface, or why it is refused.
struct Taken {
  SurfaceFacts facts;
  std::string refusal;
};
Taken taken(const SurfaceFiles& files, const Polygons& shape, const WindingLaw& law,
            std::uint64_t capacity = kBucketCapacity, double precision = 0) {
  IngestWatch watch;
  Workers workers(2);
  try {
    RawSurface raw = read_surface(files.write("any.off", to_off(shape)), files.directory(), watch);
    raw.precision = precision;
    const Frame frame = frame_of(raw.box);
    return {check_surface(std::move(raw), frame, watch, workers, capacity, IngestShare(),
                          std::nullopt, 0, 0, law)
                .facts,
            ""};
  } catch (const std::runtime_error& error) {
    return {{}, error.what()};
  }
}

constexpr std::uint64_t kMuch = std::uint64_t{4} << 30;
constexpr WindingLaw kWound{InsideRule::kWinding, 0.5, kMuch};

// Twelve triangles; `num` of them.
Polygons box(std::size_t num, const Point& at = {}) {
  Polygons s;
  for (int k = 0; k < 8; ++k)
    s.vertices.push_back(at + Point{k & 1 ? 2. : 0., k & 2 ? 2. : 0., k & 4 ? 2. : 0.});
  s.faces = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
             {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  s.faces.resize(num);
  return s;
}

bool has_note(const SurfaceFacts& facts, const std::string& part) {
  return std::ranges::any_of(facts.notes,
                             [&](const std::string& note) { return note.find(part) != note.npos; });
}

TEST(WindingInput, OfWhatEnclosesSomethingIsThatItself) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  Random random(seed);
  const SurfaceFiles files;
  int num_accepted = 0;
  for (const auto& [name, surface] : random_samples(random, files)) {
    SCOPED_TRACE(name);
    const Taken closed = taken(files, surface, {});
    if (!closed.refusal.empty()) continue;
    ++num_accepted;
    const Taken wound = taken(files, surface, kWound);
    EXPECT_EQ(wound.refusal, "");
    EXPECT_EQ(wound.facts.num_triangles, closed.facts.num_triangles);
    EXPECT_EQ(wound.facts.volume, closed.facts.volume);
    EXPECT_EQ(wound.facts.notes, closed.facts.notes);
  }
  EXPECT_GT(num_accepted, 0);
}

TEST(WindingInput, TakesWhatIsOpenOverlapsOrIsDoubled) {
  const SurfaceFiles files;
  const Polygons open = box(10);
  EXPECT_NE(taken(files, open, {}).refusal.find("--inside winding"), std::string::npos);
  for (const std::uint64_t capacity : {kBucketCapacity, std::uint64_t{12}}) {
    const Taken closed = taken(files, open, kWound, capacity);
    EXPECT_EQ(closed.refusal, "");
    EXPECT_NEAR(closed.facts.volume, 8, 1e-2);
    EXPECT_TRUE(has_note(closed.facts, "closed 1 hole, the largest of 4 edges"));
    EXPECT_TRUE(has_note(closed.facts, "in doubt"));
    EXPECT_EQ(closed.facts.euler_characteristic, 2);

    Polygons two = box(12);
    two.append(box(12, {1, 1, 1}));
    EXPECT_NE(taken(files, two, {}, capacity).refusal.find("intersects itself"), std::string::npos);
    const Taken united = taken(files, two, kWound, capacity);
    EXPECT_EQ(united.refusal, "");
    EXPECT_NEAR(united.facts.volume, 15, 1e-9);
    EXPECT_EQ(united.facts.num_components, 1u);
    EXPECT_TRUE(has_note(united.facts, "along others"));

    // Where parts touch in an edge each is closed by itself.
    Polygons edge = box(12);
    edge.append(box(12, {2, 2, 0}));
    const Taken touching = taken(files, edge, kWound, capacity);
    EXPECT_EQ(touching.refusal, "");
    EXPECT_NEAR(touching.facts.volume, 16, 1e-9);
    EXPECT_EQ(touching.facts.num_components, 2u);
  }
}

// A refusal names what would do, by how much winding numbers would leave in doubt.
TEST(WindingInput, ARefusalTellsHowMuchIsInDoubt) {
  const SurfaceFiles files;
  constexpr WindingLaw kClosed{InsideRule::kClosed, 0, kMuch};
  for (const std::uint64_t capacity : {kBucketCapacity, std::uint64_t{12}}) {
    const std::string open = taken(files, box(11), kClosed, capacity).refusal;
    EXPECT_NE(open.find("locvol repair"), std::string::npos) << open;
    EXPECT_NE(open.find("--inside winding ("), std::string::npos) << open;
    EXPECT_NE(open.find("% of the box is in doubt)"), std::string::npos) << open;
    Polygons two = box(12);
    two.append(box(12, {1, 1, 1}));
    const std::string crossing = taken(files, two, kClosed, capacity).refusal;
    EXPECT_NE(crossing.find("--inside winding (0% of the box"), std::string::npos) << crossing;
    EXPECT_EQ(crossing.find("locvol wrap"), std::string::npos) << crossing;
    const std::string sheet = taken(files, box(3), kClosed, capacity).refusal;
    EXPECT_NE(sheet.find("locvol wrap"), std::string::npos) << sheet;
    EXPECT_NE(sheet.find("would be in doubt)"), std::string::npos) << sheet;
    EXPECT_EQ(sheet.find("--inside winding"), std::string::npos) << sheet;
  }
  const std::string unknown = taken(files, box(11), {}).refusal;
  EXPECT_EQ(unknown.find("in doubt"), std::string::npos) << unknown;
}

// What has something surely inside is more than sheets, however much of it is in doubt.
TEST(WindingInput, ARefusalOfAnOpenBoxNamesAllThatClosesIt) {
  const SurfaceFiles files;
  const std::string open =
      taken(files, box(10), {InsideRule::kClosed, 0, kMuch}, kBucketCapacity).refusal;
  EXPECT_NE(open.find("locvol repair"), std::string::npos) << open;
  EXPECT_NE(open.find("--inside winding (6"), std::string::npos) << open;
  EXPECT_NE(open.find("locvol wrap"), std::string::npos) << open;
  // Nothing is inside of two triangles that face away from each other.
  Polygons flat;
  flat.vertices = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0.1}};
  flat.faces = {{0, 1, 2}, {0, 2, 3}, {0, 2, 1}, {0, 3, 2}};
  const std::string nothing =
      taken(files, flat, {InsideRule::kClosed, 0, kMuch}, kBucketCapacity).refusal;
  EXPECT_NE(nothing.find("locvol wrap"), std::string::npos) << nothing;
  EXPECT_EQ(nothing.find("--inside winding"), std::string::npos) << nothing;
}

// What is cut from curved faces may cross by as much as that is coarse: no flaw of the file's.
TEST(WindingInput, FacetsOfCurvedFacesMayCross) {
  const SurfaceFiles files;
  constexpr WindingLaw kClosed{InsideRule::kClosed, 0.5, kMuch};
  constexpr double kPrecision = 1e-7;
  Polygons two = box(12);
  two.append(box(12, {1, 1, 1}));
  for (const std::uint64_t capacity : {kBucketCapacity, std::uint64_t{12}}) {
    EXPECT_NE(taken(files, two, kClosed, capacity).refusal.find("intersects itself"),
              std::string::npos);
    const Taken cut = taken(files, two, kClosed, capacity, kPrecision);
    EXPECT_EQ(cut.refusal, "");
    EXPECT_NEAR(cut.facts.volume, 15, 1e-9);
    EXPECT_TRUE(has_note(cut.facts, "cut from its curved faces cross"));
    // What is sound stays as it is, and what is open is told.
    const Taken sound = taken(files, box(12), kClosed, capacity, kPrecision);
    EXPECT_EQ(sound.facts.num_triangles, 12u);
    EXPECT_TRUE(sound.facts.notes.empty());
    EXPECT_NE(taken(files, box(11), kClosed, capacity, kPrecision).refusal.find("not closed"),
              std::string::npos);
  }
}

// Parts that touch in a vertex, one above the other, are none in the other.
TEST(WindingInput, PartsThatTouchInAVertexLieBesideEachOther) {
  const SurfaceFiles files;
  for (int axis = 0; axis < 3; ++axis) {
    Polygons both;
    for (const double center : {0.0, 2.0}) {
      Polygons octahedron;
      for (const double far : {1.0, -1.0})
        for (int along = 0; along < 3; ++along) {
          Point p;
          p[along] = far;
          p[axis] += center;
          octahedron.vertices.push_back(p);
        }
      octahedron.faces = {{0, 1, 2}, {1, 3, 2}, {3, 4, 2}, {4, 0, 2},
                          {1, 0, 5}, {3, 1, 5}, {4, 3, 5}, {0, 4, 5}};
      both.append(octahedron);
    }
    const Taken touching = taken(files, both, kWound);
    EXPECT_EQ(touching.refusal, "");
    EXPECT_NEAR(touching.facts.volume, 8.0 / 3, 1e-12) << "along " << axis;
  }
}

TEST(WindingInput, RefusesSheetsAndTooLittleMemory) {
  const SurfaceFiles files;
  Polygons square;
  square.vertices = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0.1}};
  square.faces = {{0, 1, 2}, {0, 2, 3}, {0, 2, 1}, {0, 3, 2}};
  const std::string refusal = taken(files, square, kWound).refusal;
  EXPECT_NE(refusal.find("wind around nothing"), std::string::npos) << refusal;
  EXPECT_NE(refusal.find("locvol wrap"), std::string::npos) << refusal;
  const std::string budget = taken(files, box(10), {InsideRule::kWinding, 0.5, 1000}).refusal;
  EXPECT_NE(budget.find("--memory"), std::string::npos) << budget;
}

}  // namespace
}  // namespace locvol
