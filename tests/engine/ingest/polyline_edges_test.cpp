// Edges that polylines make sharp: against those by angle, and those that were picked.
#include "engine/ingest/polyline_edges.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <map>
#include <numbers>
#include <random>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "engine/shared/input_error.h"
#include "tests/engine/ingest/creased_surfaces.h"
#include "tests/engine/ingest/random_surfaces.h"
#include "tests/engine/ingest/surface_fixtures.h"

namespace locvol {
namespace {

using PolylinePoints = std::vector<Point>;

std::string polyline_text(const std::vector<PolylinePoints>& polylines, int num_digits = 17) {
  std::string text;
  for (const PolylinePoints& polyline : polylines) {
    text += std::to_string(polyline.size());
    for (const Point& p : polyline)
      text += fmt::format("  {:.{}g} {:.{}g} {:.{}g}", p.x, num_digits, p.y, num_digits, p.z,
                          num_digits);
    text += '\n';
  }
  return text;
}

std::set<EdgeEnds> ends_of_creases(const Creased& found) {
  std::set<EdgeEnds> ends;
  for (const CreaseEdge& edge : found.surface.creases) ends.insert(edge.ends);
  return ends;
}

// Straight runs of edges along an axis become one piece; the edges are of length 1.
std::vector<PolylinePoints> straight_runs(const std::set<EdgeEnds>& edges) {
  std::vector<PolylinePoints> runs;
  for (const EdgeEnds& first : edges) {
    const Point step = first[1] - first[0];
    if (edges.contains({first[0] - step, first[0]})) continue;
    Point end = first[1];
    while (edges.contains({end, end + step})) end = end + step;
    runs.push_back({first[0], end});
  }
  return runs;
}

void expect_as_by_angle(const Creased& found, const Creased& by_angle) {
  EXPECT_EQ(found.surface, by_angle.surface);
  EXPECT_EQ(found.sheets, by_angle.sheets);
}

TEST(PolylineEdges, AllOfThoseByAngleMakeTheSameCreasesAndSheets) {
  const SurfaceFiles files;
  Random random(5);
  for (int trial = 0; trial < 3; ++trial) {
    SCOPED_TRACE(trial);
    Polygons shape = manifold_voxels(random, files);
    shuffle(shape, random);
    const auto file = files.write("shape.off", to_off(shape));
    const Creased by_angle = creases_in(file);
    const std::set<EdgeEnds> edges = ends_of_creases(by_angle);
    ASSERT_GT(edges.size(), 100U);
    std::vector<PolylinePoints> one_by_one;
    for (const EdgeEnds& edge : edges)
      one_by_one.push_back(random() % 2 ? PolylinePoints{edge[0], edge[1]}
                                        : PolylinePoints{edge[1], edge[0]});
    std::ranges::shuffle(one_by_one, random);
    const auto runs = straight_runs(edges);
    EXPECT_LT(2 * runs.size(), edges.size());
    for (const auto& [polylines, name] :
         {std::pair(one_by_one, "one by one"), std::pair(runs, "straight runs")}) {
      SCOPED_TRACE(name);
      for (const std::uint64_t capacity : {kBucketCapacity, std::uint64_t{300}, std::uint64_t{20}})
        expect_as_by_angle(
            creases_in(file, {.sharp_angle = 0,
                              .bucket_capacity = capacity,
                              .num_threads = capacity == 300 ? 3 : 1,
                              .polylines = files.write("given.txt", polyline_text(polylines))}),
            by_angle);
    }
    // Beside those by angle they change nothing.
    expect_as_by_angle(
        creases_in(file, {.polylines = files.write("given.txt", polyline_text(runs))}), by_angle);
  }
}

TEST(PolylineEdges, AreAnyThatAreGivenWhateverTheCells) {
  const SurfaceFiles files;
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  Random random(seed);
  for (int trial = 0; trial < 4; ++trial) {
    SCOPED_TRACE(trial);
    const Polygons shape = random_balls(random);
    const auto file = files.write("shape.off", to_off(shape));
    std::set<EdgeEnds> edges;
    std::vector<PolylinePoints> polylines;
    for (int n = 0; n < 300; ++n) {
      const auto& face = shape.faces[below(random, shape.faces.size())];
      // Along one or two of its edges.
      PolylinePoints points;
      for (std::size_t k = 0; k < 2 + random() % 2; ++k) {
        points.push_back(shape.vertices[face[k]]);
        if (k > 0) edges.insert(ends_of(points[k - 1], points[k]));
      }
      polylines.push_back(points);
    }
    // With six digits they are close to vertices only.
    const auto given = files.write("given.txt", polyline_text(polylines, trial % 2 ? 6 : 17));
    CreaseTrial whole{.sharp_angle = 0, .least_extent = 3, .polylines = given};
    const Creased found = creases_in(file, whole);
    EXPECT_EQ(ends_of_creases(found), edges);
    for (const std::uint64_t capacity : {15, 200}) {
      CreaseTrial cut = whole;
      cut.bucket_capacity = capacity;
      cut.num_threads = 2;
      const Creased other = creases_in(file, cut);
      EXPECT_EQ(other.surface, found.surface);
      EXPECT_EQ(other.sheets, found.sheets);
    }
    // Noise by angle goes, what is given stays.
    const CreaseTrial by_angle{.sharp_angle = 20, .least_extent = 0.5};
    CreaseTrial both = by_angle;
    both.polylines = given;
    const std::set<EdgeEnds> all = ends_of_creases(creases_in(file, both));
    EXPECT_TRUE(std::ranges::includes(all, edges));
    EXPECT_GE(all.size(), edges.size());
  }
}

// A ball of rings; those in the middle lie at z = 0.
class BallWithPolylines : public testing::Test {
 protected:
  static constexpr std::uint32_t kRings = 15, kAround = 32;

  // Of the middle ring, from its first vertex on.
  PolylinePoints around(std::uint32_t num_edges) const {
    PolylinePoints points;
    for (std::uint32_t j = 0; j <= num_edges; ++j)
      points.push_back(ball_.vertices[1 + (kRings / 2) * kAround + j % kAround]);
    return points;
  }
  Creased creases_of(const std::vector<PolylinePoints>& polylines,
                     std::uint64_t bucket_capacity = kBucketCapacity) const {
    return creases_in(file_, {.bucket_capacity = bucket_capacity,
                              .polylines = files_.write("given.txt", polyline_text(polylines))});
  }

  SurfaceFiles files_;
  Polygons ball_ = to_polygons(testing_shapes::sphere(1, kRings, kAround));
  std::filesystem::path file_ = files_.write("ball.off", to_off(ball_));
};

TEST_F(BallWithPolylines, PartsItAtItsEquator) {
  for (const std::uint64_t capacity : {kBucketCapacity, std::uint64_t{30}}) {
    const Creased found = creases_of({around(kAround)}, capacity);
    ASSERT_EQ(found.sheets.sheets.size(), 2U);
    EXPECT_NEAR(found.sheets.sheets[0].area, found.sheets.sheets[1].area, 1e-9);
    ASSERT_EQ(found.sheets.creases.size(), 1U);
    const CreaseFacts& crease = found.sheets.creases[0];
    EXPECT_TRUE(crease.is_closed());
    EXPECT_EQ(crease.num_edges, kAround);
    EXPECT_EQ(crease.sheets, (std::array<SheetId, 2>{1, 2}));
    EXPECT_EQ(found.sheets.num_corners, 0U);
  }
}

TEST_F(BallWithPolylines, LeavesItOneSheetWhereOneEndsWithin) {
  for (const std::uint64_t capacity : {kBucketCapacity, std::uint64_t{30}}) {
    const Creased found = creases_of({around(kAround / 2)}, capacity);
    EXPECT_EQ(found.sheets.sheets.size(), 0U);  // one, without a name
    ASSERT_EQ(found.sheets.creases.size(), 1U);
    const CreaseFacts& crease = found.sheets.creases[0];
    EXPECT_EQ(crease.corners, (std::array<std::uint32_t, 2>{1, 2}));
    EXPECT_EQ(crease.sheets, (std::array<SheetId, 2>{1, 1}));
    EXPECT_EQ(crease.num_edges, kAround / 2);
    EXPECT_EQ(found.sheets.num_corners, 2U);
  }
}

TEST_F(BallWithPolylines, MayRepeatPointsAndEdges) {
  PolylinePoints doubled;
  for (const Point& p : around(kAround)) doubled.insert(doubled.end(), 2, p);
  const Creased found = creases_of({doubled, around(5), around(9)});
  EXPECT_EQ(found.sheets, creases_of({around(kAround)}).sheets);
}

// ---- What is wrong

class BadPolylines : public BallWithPolylines {
 protected:
  void expect_refused(const std::string& text, const std::vector<std::string>& words) const {
    for (const std::uint64_t capacity : {kBucketCapacity, std::uint64_t{4}}) {
      try {
        creases_in(box_, {.bucket_capacity = capacity, .polylines = files_.write("bad.txt", text)});
        ADD_FAILURE() << "not refused: " << text;
      } catch (const InputError& error) {
        const std::string what = error.what();
        EXPECT_NE(what.find("bad.txt"), std::string::npos) << what;
        for (const std::string& word : words) EXPECT_NE(what.find(word), std::string::npos) << what;
      }
    }
  }

  std::filesystem::path box_ =
      files_.write("box.off", to_off(box_of_triangles({0, 0, 0}, {3, 2, 1})));
};

TEST_F(BadPolylines, OfPointsThatAreNoVertices) {
  expect_refused("# a comment\n2 0 0 0  3 0 0\n\n3 0 2 0  3 2 0  3 1.9 0.2\n",
                 {"line 4", "(3, 1.9, 0.2) is no vertex", "the closest one, (3, 2, 0), is 0.224"});
  expect_refused("2 0 0 0  3.0001 0 0\n", {"line 1", "(3.0001, 0, 0)", "is 0.0001 away"});
  expect_refused("2 0 0 0  1e300 0 0\n", {"line 1", "no vertex"});
}

TEST_F(BadPolylines, OfPiecesThatRunAlongNoEdges) {
  // Across the face at z = 0, whose other diagonal is an edge.
  expect_refused("2 3 0 0  0 2 0\n", {"line 1", "(3, 0, 0) to (0, 2, 0) runs along no edges"});
  expect_refused("2 0 0 0  3 2 1\n", {"runs along no edges"});
}

TEST_F(BadPolylines, OfPiecesThatLeaveTheEdges) {
  // Two cubes a cube apart, and a piece along edges of both.
  box_ = files_.write("cubes.off", to_off(voxels({{0, 0, 0}, {2, 0, 0}})));
  expect_refused("2 0 0 0  1 0 0\n2 0 1 0  3 1 0\n",
                 {"line 2: the straight piece from (0, 1, 0) to (3, 1, 0) runs along edges of the "
                  "surface to (1, 1, 0) alone"});
}

TEST_F(BadPolylines, InFilesThatAreNone) {
  for (const auto& [text, words] : std::vector<std::pair<std::string, std::string>>{
           {"", "holds no polyline"},
           {"# nothing\n", "holds no polyline"},
           {"2 0 0 0 3 0\n", "line 1: a polyline of 2 points has 5 coordinates"},
           {"2 0 0 0\n3 0 0\n", "line 1: a polyline of 2 points has 3 coordinates"},
           {"\n2 0 0 0 3 0 0 1\n", "line 2: a polyline of 2 points goes on with \"1\""},
           {"1 0 0 0\n", "line 1: a polyline of 1 points"},
           {"-2 0 0 0 3 0 0\n", "line 1: a polyline of -2 points"},
           {"2 0 0 zero 3 0 0\n", "line 1"},
           {"2 0 0 nan 3 0 0\n", "line 1"},
           {"v 0 0 0\n", "line 1"},
           {"99999999999999999999 0 0 0\n", "line 1"}})
    expect_refused(text, {words});
}

// Or memory would not be bounded.
TEST_F(BadPolylines, ThatRepeatEdgesWithoutEnd) {
  std::string often, too_often;
  for (int n = 0; n < 200; ++n) (n < 50 ? often : too_often) += "2 0 0 0  3 0 0\n";
  EXPECT_EQ(creases_in(box_, {.sharp_angle = 0, .polylines = files_.write("ok.txt", often)})
                .sheets.creases.size(),
            1U);
  expect_refused(often + too_often, {"again and again"});
}

TEST_F(BadPolylines, ThatAreOthersByNow) {
  const auto file = files_.write("bad.txt", "2 0 0 0  3 0 0\n");
  EXPECT_THROW(creases_in(box_, {.polylines = file, .digest = "00"}), InputError);
}

TEST_F(BadPolylines, ThatMakeTooManyCreases) {
  const auto file = files_.write("bad.txt", "2 0 0 0  3 0 0\n2 3 0 0  3 2 0\n");
  const Creased few = creases_in(box_, {.most = 3, .polylines = file});
  EXPECT_EQ(few.sheets.creases.size(), 2U);
  EXPECT_EQ(few.notes.back(),
            "took no creases but those that are given, for there would be more than 3");
  EXPECT_THROW(creases_in(box_, {.sharp_angle = 0, .most = 2, .polylines = file}), InputError);
}

// Whatever a damaged file says, it is read or refused.
TEST_F(BadPolylines, ThatAreDamaged) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  Random random(seed);
  const std::string sound = "5 0 0 0  3 0 0  3 2 0  0 2 0  0 0 0  # below\n2  3 2 1  0 2 1\n";
  constexpr std::string_view kBytes("0123456789 \n\r\t-+.eE#\0\xff", 22);
  int num_read = 0, num_refused = 0;
  for (int trial = 0; trial < 400; ++trial) {
    std::string text = sound;
    for (std::uint32_t n = 0; n < 1 + below(random, 3); ++n) {
      const std::size_t at = below(random, text.size());
      if (random() % 3 == 0)
        text.erase(at, 1 + below(random, 9));
      else if (random() % 2)
        text[at] = kBytes[below(random, kBytes.size())];
      else
        text.insert(at, text.substr(below(random, text.size()), 1 + below(random, 30)));
    }
    try {
      creases_in(box_, {.sharp_angle = 0, .polylines = files_.write("bad.txt", text)});
      ++num_read;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find("bad.txt"), std::string::npos) << error.what();
      ++num_refused;
    }
  }
  EXPECT_GT(num_read, 5);
  EXPECT_GT(num_refused, 50);
}

// ---- The file

TEST(PolylineFile, IsKnownByItsPolylinesAlone) {
  const SurfaceFiles files;
  const auto digest = [&](const std::string& text) {
    return survey_polylines(files.write("lines.txt", text));
  };
  const std::string one = digest("2 0 0 0 1 0 0\n3 1 0 0 1 1 0 1 1 1\n");
  EXPECT_EQ(one.size(), 16U);
  EXPECT_EQ(digest("# same\n2\t0 -0.0 0e5 +1.0 0 0 # x\r\n\r\n3 1 0 0 1 1 0 10e-1 1 1"), one);
  EXPECT_NE(digest("2 0 0 0 1 0 0\n3 1 0 0 1 1 0 1 1 2\n"), one);
  EXPECT_NE(digest("2 0 0 0 1 0 0\n2 1 0 0 1 1 0\n2 1 1 0 1 1 1\n"), one);
  EXPECT_EQ(survey_polylines({}), "");
  EXPECT_THROW(survey_polylines(files.directory() / "absent.txt"), InputError);
}

}  // namespace
}  // namespace locvol
