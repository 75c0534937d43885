// Points that are nearly one: which groups they form, what a surface becomes with them joined, when
// that is done, and what is said where it does not help. Held against all pairs of points.
#include "engine/ingest/surface_weld.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "engine/ingest/near_points.h"
#include "engine/shared/sorted_spill.h"
#include "tests/directories.h"
#include "tests/engine/ingest/random_surfaces.h"
#include "tests/engine/ingest/surface_fixtures.h"
#include "tests/skip_reasons.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

// ---- Groups of points, by all pairs ----

// By point, the smallest one of its group.
std::vector<std::size_t> smallest_by_all_pairs(const std::vector<Point>& points, double distance) {
  std::vector<std::size_t> smallest(points.size());
  for (std::size_t p = 0; p < points.size(); ++p) smallest[p] = p;
  for (std::size_t p = 0; p < points.size(); ++p)
    for (std::size_t q = 0; q < p; ++q) {
      if (!(distance_between(points[p], points[q]) < distance)) continue;
      const std::size_t a = smallest[p], b = smallest[q];
      for (std::size_t& s : smallest)
        if (s == a || s == b) s = std::min(a, b);
    }
  return smallest;
}

// Around few places, so that points lie as close to each other as to be joined; on lattices, so
// that some lie at the very distance.
std::vector<Point> random_points(Random& random, double distance) {
  std::vector<Point> points;
  const double scale = std::pow(10.0, uniform(random, -8, 8));
  const Point offset = random() % 2 ? Point{} : random_point(random, 1000 * distance);
  const int num_places = 1 + static_cast<int>(below(random, 20));
  const double spread = uniform(random, 0.3, 3) * distance;
  for (int place = 0; place < num_places; ++place) {
    const Point center = offset + random_point(random, random() % 2 ? 5 * distance : scale);
    const auto num = below(random, 12);
    for (std::uint32_t i = 0; i < num; ++i) points.push_back(center + random_point(random, spread));
  }
  for (int i = 0; i < 30; ++i)
    points.push_back({0.5 * distance * below(random, 8), distance * below(random, 3),
                      -0.25 * distance * below(random, 20)});
  std::ranges::sort(points);
  points.erase(std::ranges::unique(points).begin(), points.end());
  return points;
}

TEST(NearPoints, AreThoseOfAllPairs) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  Random random(seed);
  std::size_t num_joined = 0, num_alone = 0;
  for (int round = 0; round < 300; ++round) {
    const double distance = std::pow(10.0, uniform(random, -12, 3));
    const std::vector<Point> points = random_points(random, distance);
    const std::vector<std::size_t> expected = smallest_by_all_pairs(points, distance);
    const PointGroups found = near_groups(points, distance);
    ASSERT_EQ(found.of_point.size(), points.size());
    std::map<std::size_t, Box> boxes;
    std::map<std::size_t, std::uint32_t> counts;
    for (std::size_t p = 0; p < points.size(); ++p) {
      const auto box = boxes.try_emplace(expected[p], Box::around(points[p])).first;
      box->second = box->second.joined(points[p]);
      ++counts[expected[p]];
    }
    for (std::size_t p = 0; p < points.size(); ++p) {
      const PointGroup& group = found.groups[found.of_point[p]];
      ASSERT_EQ(group.first, expected[p]) << distance;
      ASSERT_EQ(group.box, boxes[expected[p]]);
      ASSERT_EQ(group.count, counts[expected[p]]);
      ++(group.count > 1 ? num_joined : num_alone);
    }
  }
  EXPECT_GT(num_joined, 1000U);
  EXPECT_GT(num_alone, 1000U);
}

TEST(NearPoints, AreFoundWhereverTheyLie) {
  const double tiny = std::numeric_limits<double>::denorm_min();
  const double most = 1e50, step = std::nextafter(most, 2 * most) - most;
  EXPECT_EQ(
      near_groups(std::vector<Point>{{-tiny, 0, 0}, {0, 0, 0}, {tiny, 0, 0}}, 1e-200).groups.size(),
      1U);
  EXPECT_EQ(near_groups(std::vector<Point>{{most, 0, 0}, {most + step, 0, 0}}, 1e-30).groups.size(),
            2U);
  EXPECT_EQ(
      near_groups(std::vector<Point>{{most, 0, 0}, {most + step, 0, 0}}, 1.5 * step).groups.size(),
      1U);
  EXPECT_EQ(near_groups(std::vector<Point>{{0, 0, 0}, {1, 0, 0}}, 1).groups.size(), 2U)
      << "closer, not as close";
}

// A row as long as can be, and a heap: neither takes quadratic time.
TEST(NearPoints, MayBeMany) {
  std::vector<Point> row, heap;
  Random random(3);
  for (int i = 0; i < 200'000; ++i) {
    row.push_back({0.9 * i, 0, 0});
    heap.push_back(random_point(random, 2));
  }
  std::ranges::sort(heap);
  EXPECT_EQ(near_groups(row, 1).groups.size(), 1U);
  EXPECT_EQ(near_groups(row, 0.8).groups.size(), row.size());
  EXPECT_EQ(near_groups(heap, 1).groups.size(), 1U);
}

// ---- Distances between edges ----

TEST(EdgeLengths, DistancesLieBetweenThem) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  Random random(seed);
  for (int round = 0; round < 300; ++round) {
    std::vector<double> lengths;
    EdgeLengths edges;
    const double most = std::pow(10.0, uniform(random, -6, 1));
    for (std::uint32_t i = below(random, 8); i-- > 0;) {
      const double length = std::pow(10.0, uniform(random, -12, 2));
      EdgeLengths others;
      for (int k = 0; k < 5; ++k) {
        lengths.push_back(length * uniform(random, 1, 1.4));
        (k % 2 ? others : edges).add(lengths.back());
      }
      edges.add(others);
    }
    std::vector<double> expected;
    std::ranges::sort(lengths);
    for (std::size_t i = 0; i <= lengths.size(); ++i) {
      const double below = i == 0 ? 1e-30 : lengths[i - 1];
      const double distance =
          std::min(i == lengths.size() ? most : std::min(lengths[i] / 10, most), most);
      if (distance > below && (expected.empty() || distance > expected.back()))
        expected.push_back(distance);
    }
    std::vector<double> found;
    double above = 0;
    while (const auto next = edges.next_distance(above, 1e-30, most))
      found.push_back(above = *next);
    EXPECT_EQ(found, expected);
    for (const double d : found)
      EXPECT_TRUE(std::ranges::none_of(
          lengths, [&](double l) { return d <= l && l < (1 - 1e-15) * 10 * d; }));
  }
}

// ---- Records ----

struct LongRecord {
  std::uint64_t key = 0;
  std::array<std::uint64_t, 15> more{};
};

TEST(SortedSpill, GivesBackAllInOrder) {
  const TempDir scratch;
  Random random(5);
  for (const std::size_t num : {0U, 1U, 1000U, 65'536U, 65'537U, 400'000U}) {  // 65,536 to a run
    SortedSpill<LongRecord, &LongRecord::key> spill(scratch / ".");
    std::vector<std::uint64_t> keys(num);
    for (std::size_t i = 0; i < num; ++i) keys[i] = 3 * i;
    std::ranges::shuffle(keys, random);
    for (const std::uint64_t key : keys) spill.append({key, {key + 1, 7}});
    spill.finish();
    EXPECT_EQ(spill.size(), num);
    std::uint64_t expected = 0;
    for (; !spill.is_empty(); spill.pop(), expected += 3) {
      ASSERT_EQ(spill.front().key, expected);
      ASSERT_EQ(spill.front().more[0], expected + 1);
    }
    EXPECT_EQ(expected, 3 * num);
  }
}

// ---- A surface with points joined, by all pairs ----

struct Expected {
  std::vector<Triangle> triangles;
  std::uint64_t num_joined = 0, num_collapsed = 0, num_copies = 0;
  double width = 0;
  std::optional<Point> too_wide;
};

std::array<Point, 3> sorted_corners(Triangle t) {
  std::ranges::sort(t.corners);
  return t.corners;
}

std::vector<Point> eligible(const std::vector<Triangle>& triangles, WeldPoints points) {
  std::map<std::pair<Point, Point>, std::set<Point>> beyond;  // by edge
  std::set<Point> all;
  for (const Triangle& t : triangles)
    for (std::size_t k = 0; k < 3; ++k) {
      const Point &a = t.corners[k], &b = t.corners[(k + 1) % 3];
      beyond[std::minmax(a, b)].insert(t.corners[(k + 2) % 3]);
      all.insert(a);
    }
  if (points == WeldPoints::kOfOpenEdges) {
    all.clear();
    for (const auto& [edge, apexes] : beyond)
      if (apexes.size() == 1) all.insert({edge.first, edge.second});
  }
  return {all.begin(), all.end()};
}

Expected by_all_pairs(const std::vector<Triangle>& triangles, WeldPoints which, double distance) {
  Expected expected;
  const std::vector<Point> points = eligible(triangles, which);
  const std::vector<std::size_t> smallest = smallest_by_all_pairs(points, distance);
  std::map<std::size_t, std::vector<std::size_t>> groups;
  for (std::size_t p = 0; p < points.size(); ++p) groups[smallest[p]].push_back(p);
  std::map<Point, Point> moves;
  for (const auto& [first, group] : groups) {
    if (group.size() == 1) continue;
    Box box = Box::around(points[first]);
    for (const std::size_t p : group) box = box.joined(points[p]);
    const double width = distance_between(box.min, box.max);
    if (width >= 2 * distance) {
      if (!expected.too_wide) expected.too_wide = points[first];
      continue;
    }
    expected.width = std::max(expected.width, width);
    for (const std::size_t p : group)
      if (p != first) moves[points[p]] = points[first];
  }
  expected.num_joined = moves.size();
  if (moves.empty()) return expected;
  std::set<std::array<Point, 3>> known;
  for (Triangle t : triangles) {
    const bool is_copy = !known.insert(sorted_corners(t)).second;
    for (Point& p : t.corners)
      if (moves.contains(p)) p = moves[p];
    const auto& [a, b, c] = t.corners;
    if (a == b || b == c || c == a) {
      ++expected.num_collapsed;
      continue;
    }
    if (is_copy) ++expected.num_copies;
    expected.triangles.push_back(t);
  }
  return expected;
}

class SurfaceWeld : public testing::Test {
 protected:
  // The triangles as read, and with points joined.
  struct Welded {
    std::vector<Triangle> before, after;
    WeldedSurface surface;
  };
  Welded welded(const std::filesystem::path& file, WeldPoints points, double distance,
                std::uint64_t capacity, int num_threads) const {
    IngestWatch watch;
    Workers workers(num_threads);
    RawSurface raw = read_surface(file, files_.directory(), watch);
    Welded result;
    result.before = raw.spill.load(raw.triangles.front());
    TriangleBuckets buckets(frame_of(raw.box), capacity);
    buckets.distribute(raw.spill, raw.triangles, raw.box, {}, false, watch);
    result.surface = welded_surface(raw.spill, buckets, points, distance, watch, workers);
    result.after = raw.spill.load(result.surface.triangles);
    return result;
  }

  InputSurface read(const Polygons& s, const std::optional<double>& weld = std::nullopt,
                    std::uint64_t capacity = kBucketCapacity) const {
    return read_whole_surface(files_.write("surface.off", to_off(s)), capacity, weld);
  }
  std::string refusal(const Polygons& s, const std::optional<double>& weld = std::nullopt,
                      std::uint64_t capacity = kBucketCapacity) const {
    try {
      read(s, weld, capacity);
      return {};
    } catch (const InputError& error) {
      return error.what();
    }
  }
  static std::string notes(const InputSurface& s) {
    return fmt::format("{}", fmt::join(s.facts.notes, "\n"));
  }
  static bool has(const std::string& text, const std::string& part) {
    return text.find(part) != std::string::npos;
  }

  SurfaceFiles files_;
};

TEST_F(SurfaceWeld, IsThatOfAllPairsHoweverItIsCut) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  Random random(seed);
  std::uint64_t num_joined = 0, num_collapsed = 0, num_copies = 0, num_wide = 0;
  for (int round = 0; round < 60; ++round) {
    Polygons sound = round % 2 ? random_voxels(random, 4, 1)
                               : to_polygons(testing_shapes::sphere(1, 5 + below(random, 5), 9));
    for (int i = 0; i < 3; ++i)
      sound.faces.push_back(sound.faces[below(random, sound.faces.size())]);
    const double reach = std::pow(10.0, uniform(random, -9, -0.5));
    Polygons loose = random() % 4 ? jittered(sound, reach, random) : sound;
    for (int i = 0; i < 3; ++i)
      loose.faces.push_back(loose.faces[below(random, loose.faces.size())]);
    const double distance = reach * std::pow(10.0, uniform(random, -0.5, 1.5));
    for (int i = 0; i < 5; ++i) {  // slivers
      const auto& [a, b] =
          std::pair(below(random, loose.vertices.size()), below(random, loose.vertices.size()));
      loose.faces.push_back({a, b, static_cast<std::uint32_t>(loose.vertices.size())});
      loose.vertices.push_back(loose.vertices[a] + random_point(random, 0.7 * distance));
    }
    const auto file = files_.write("surface.off", to_off(loose));
    for (const WeldPoints points : {WeldPoints::kAll, WeldPoints::kOfOpenEdges})
      for (const std::uint64_t capacity : {1'000'000U, 60U, 8U}) {
        const Welded found =
            welded(file, points, distance, capacity, 1 + static_cast<int>(below(random, 3)));
        const Expected expected = by_all_pairs(found.before, points, distance);
        ASSERT_EQ(found.surface.num_joined, expected.num_joined) << capacity;
        ASSERT_EQ(found.surface.width, expected.width) << capacity;
        ASSERT_EQ(found.surface.too_wide, expected.too_wide) << capacity;
        ASSERT_EQ(found.surface.num_collapsed, expected.num_collapsed) << capacity;
        ASSERT_EQ(found.surface.num_copies, expected.num_copies) << capacity;
        ASSERT_EQ(found.after, expected.triangles) << capacity;
        ASSERT_FALSE(found.surface.is_crowded);
        num_joined += expected.num_joined, num_collapsed += expected.num_collapsed;
        num_copies += expected.num_copies, num_wide += expected.too_wide.has_value();
      }
  }
  EXPECT_GT(num_joined, 1000U);
  EXPECT_GT(num_collapsed, 10U);
  EXPECT_GT(num_copies, 10U);
  EXPECT_GT(num_wide, 3U);
}

// ---- When points are joined ----

// As wide as 5 to 20; the shortest edges are 0.05 long.
std::vector<Polygons> sound_shapes(Random& random, const SurfaceFiles& files) {
  return {cube(), to_polygons(testing_shapes::torus(2, 0.5, 30, 15)), random_balls(random),
          manifold_voxels(random, files)};
}

double extent_of(const Polygons& s) {
  Box box = Box::around(s.vertices.front());
  for (const Point& p : s.vertices) box = box.joined(p);
  return max_norm(box.max - box.min);
}

TEST_F(SurfaceWeld, ClosesWhatIsOpenByRounding) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  Random random(seed);
  for (const Polygons& sound : sound_shapes(random, files_))
    for (const double reach : {1e-12, 1e-9, 1e-7}) {
      SCOPED_TRACE(testing::Message() << sound.faces.size() << " faces, " << reach);
      const double jitter = reach * extent_of(sound);
      const Polygons loose = jittered(sound, jitter, random);
      const InputSurface expected = read(sound), found = read(loose);
      EXPECT_EQ(found.facts.num_vertices, expected.facts.num_vertices);
      EXPECT_EQ(found.facts.num_triangles, expected.facts.num_triangles);
      EXPECT_EQ(found.facts.num_components, expected.facts.num_components);
      EXPECT_EQ(found.facts.euler_characteristic, expected.facts.euler_characteristic);
      EXPECT_NEAR(found.facts.volume, expected.facts.volume, 10 * reach * expected.facts.volume);
      expect_closed(found);
      ASSERT_EQ(found.pieces.size(), expected.pieces.size());
      for (std::size_t t = 0; t < found.pieces.size(); ++t) {
        EXPECT_EQ(found.pieces[t].id, expected.pieces[t].id);
        for (std::size_t k = 0; k < 3; ++k)
          EXPECT_LT(distance_between(found.pieces[t].corners[k], expected.pieces[t].corners[k]),
                    2 * jitter);
      }
      EXPECT_TRUE(has(notes(found), fmt::format("joined {} points with others up to ",
                                                loose.vertices.size() - sound.vertices.size())))
          << notes(found);
      EXPECT_TRUE(has(notes(found), "else it is not closed")) << notes(found);
      EXPECT_FALSE(has(notes(found), "left out")) << notes(found);
      for (const std::uint64_t capacity : {400U, 30U}) {
        const InputSurface pieces = read(loose, std::nullopt, capacity);
        EXPECT_EQ(pieces.facts, found.facts);
        EXPECT_EQ(pieces.pieces, found.pieces);
      }
      EXPECT_TRUE(has(refusal(loose, 0), "is not closed"));
    }
}

// Slivers whose ends are rounded differently are longer than the rounding of other points.
TEST_F(SurfaceWeld, JoinsWhatIsShorterThanOtherEdgesIfThatIsWhatItTakes) {
  Polygons s = cube();
  // Edge 0-1 is 0-8-1 in one of its triangles' place, with a sliver too thin to be told from it.
  s.vertices.push_back({1e-9, 1e-14, 0});
  s.faces.erase(s.faces.begin() + 4);  // {0, 1, 5}
  s.faces.push_back({8, 1, 5});
  s.faces.push_back({0, 8, 5});
  const InputSurface found = read(s);
  EXPECT_EQ(found.facts.num_vertices, 8U);
  EXPECT_EQ(found.facts.num_triangles, 12U);
  EXPECT_TRUE(has(notes(found), "joined 1 point with others up to 1e-09 away")) << notes(found);
  EXPECT_TRUE(has(notes(found), "dropped 1 triangle with two equal corners")) << notes(found);
}

TEST_F(SurfaceWeld, LeavesASoundSurfaceAsItIs) {
  // A plate thinner than what would be joined if it were open; and points of one component at a
  // tenth of that from another's.
  for (Polygons s : {box_of_triangles({0, 0, 0}, {1, 1, 1e-8}), cube()}) {
    s.append(box_of_triangles({1 + 1e-8, 0, 0}, {2, 1, 1}));
    const InputSurface found = read(s), as_it_is = read(s, 0);
    EXPECT_EQ(found.facts, as_it_is.facts);
    EXPECT_EQ(found.pieces, as_it_is.pieces);
    EXPECT_EQ(found.facts.num_components, 2U);
    EXPECT_EQ(found.facts.num_vertices, 16U);
  }
}

// Only points at open edges are joined unasked.
TEST_F(SurfaceWeld, LeavesWhatIsNotOpenAsItIs) {
  Random random(1);
  Polygons s = jittered(box_of_triangles({3, 0, 0}, {4, 1, 1}), 1e-12, random);
  s.append(box_of_triangles({0, 0, 0}, {1, 1, 1e-8}));
  const InputSurface found = read(s);
  EXPECT_EQ(found.facts.num_components, 2U);
  EXPECT_EQ(found.facts.num_vertices, 16U);
  EXPECT_NEAR(found.facts.volume, 1 + 1e-8, 1e-11);
}

TEST_F(SurfaceWeld, DoesNotTellZerosApart) {
  Polygons loose;
  Random random(2);
  for (const auto& f : cube().faces) {
    auto& own = loose.faces.emplace_back();
    for (const auto v : f) {
      own.push_back(static_cast<std::uint32_t>(loose.vertices.size()));
      Point p = cube().vertices[v];
      for (int axis = 0; axis < 3; ++axis)
        if (p[axis] == 0 && random() % 2) p[axis] = -0.0;
      loose.vertices.push_back(p);
    }
  }
  const InputSurface found = read(loose, 0);
  EXPECT_EQ(found.facts.num_vertices, 8U);
  EXPECT_EQ(found.pieces, read(cube()).pieces);
  for (const double weld : {1e-9, 0.1}) EXPECT_EQ(read(loose, weld).pieces, found.pieces);
}

// ---- What is said ----

TEST_F(SurfaceWeld, AHoleStaysOneAndTheMessageSaysWhatWasTried) {
  Random random(4);
  Polygons s = cube();
  s.faces.pop_back();
  EXPECT_TRUE(has(refusal(s), "3 edges belong to one triangle only")) << refusal(s);
  EXPECT_TRUE(has(refusal(s), "None of their ends are closer to each other than 1e-06"))
      << refusal(s);
  EXPECT_FALSE(has(refusal(s), "would close it")) << refusal(s);
  EXPECT_FALSE(has(refusal(s, 0), "weld")) << refusal(s, 0);
  const std::string loose = refusal(jittered(s, 1e-9, random));
  EXPECT_TRUE(has(loose, "33 edges belong to one triangle only")) << loose;
  EXPECT_TRUE(has(loose, "Joining their ends that are closer to each other than 1e-06")) << loose;
  EXPECT_TRUE(has(loose, "leaves 3 edges open, for example that from")) << loose;
  EXPECT_FALSE(has(loose, "would close it")) << loose;
}

TEST_F(SurfaceWeld, TheDistanceThatTheMessageNamesClosesIt) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  Random random(seed);
  for (const Polygons& sound : sound_shapes(random, files_)) {
    // More than what is joined unasked.
    const double reach = std::max(uniform(random, 1e-5, 1e-4), 3e-6 * extent_of(sound));
    const Polygons loose = jittered(sound, reach, random);
    const std::string message = refusal(loose);
    const std::string words = "--weld ", end = " would close it";
    const auto to = message.find(end);
    ASSERT_NE(to, std::string::npos) << message;
    const auto from = message.rfind(words, to) + words.size();
    const double length = std::stod(message.substr(from, to - from));
    EXPECT_LT(length, 5 * reach);
    for (const std::uint64_t capacity : {kBucketCapacity, std::uint64_t{30}}) {
      const InputSurface found = read(loose, length, capacity);
      EXPECT_EQ(found.facts.num_vertices, sound.vertices.size());
      EXPECT_EQ(found.facts.num_triangles, sound.faces.size());
      EXPECT_TRUE(has(notes(found), "(--weld)")) << notes(found);
      EXPECT_EQ(refusal(loose, std::nullopt, capacity), message);
    }
  }
}

// Corners of one vertex are farther apart than a tenth of the shortest edges.
TEST_F(SurfaceWeld, ALengthBelowTheEdgesIsNamedWhereATenthDoesNotClose) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  Random random(seed);
  Polygons bar = cube();
  for (Point& p : bar.vertices) p = {p.x, 0.015 * p.y, 0.015 * p.z};
  for (int trial = 0; trial < 20; ++trial) {
    const Polygons loose = jittered(bar, 0.0015, random);
    const std::string message = refusal(loose);
    const auto to = message.find(" would close it");
    ASSERT_NE(to, std::string::npos) << message;
    const auto from = message.rfind("--weld ", to) + 7;
    const InputSurface found = read(loose, std::stod(message.substr(from, to - from)));
    EXPECT_EQ(found.facts.num_vertices, 8U);
    EXPECT_EQ(found.facts.num_triangles, 12U);
  }
}

TEST_F(SurfaceWeld, AWallIsNotLostSilently) {
  // A shell whose sides have the same triangles: as one sheet they would be a ball.
  Polygons shell = to_polygons(testing_shapes::sphere(1, 12, 24));
  Polygons inner = shell;
  for (Point& p : inner.vertices) p = 0.999 * p;
  shell.append(inner);
  EXPECT_EQ(read(shell).facts.num_components, 2U);
  EXPECT_EQ(read(shell, 0.0009).facts.num_components, 2U);
  const std::string lost = refusal(shell, 0.0011);
  EXPECT_TRUE(has(lost, "joining points that are closer than 0.0011 (--weld) lays triangle"))
      << lost;
  // Copies that there were before are dropped as ever.
  shell.faces.push_back(shell.faces[5]);
  EXPECT_EQ(read(shell, 0.0009).facts.num_components, 2U);
  EXPECT_TRUE(has(refusal(shell, 0.0011), "lays triangle"));
  // A plate, and one whose sides are triangulated differently.
  Polygons plate = box_of_triangles({0, 0, 0}, {1, 1, 0.001});
  EXPECT_FALSE(refusal(plate, 0.0011).empty());
  plate.faces[0] = {0, 2, 1}, plate.faces[1] = {1, 2, 3};
  ASSERT_TRUE(refusal(plate).empty()) << refusal(plate);
  EXPECT_FALSE(refusal(plate, 0.0011).empty());
}

TEST_F(SurfaceWeld, ADistanceThatIsTooLargeIsRefused) {
  const Polygons sphere = to_polygons(testing_shapes::sphere(1, 30, 60));
  const std::string row = refusal(sphere, 0.2);
  EXPECT_TRUE(has(row, "more than twice as wide")) << row;
  EXPECT_EQ(refusal(sphere, 0.2, 50), row);
  EXPECT_TRUE(has(refusal(sphere, 100), "would leave nothing of it")) << refusal(sphere, 100);
  EXPECT_TRUE(refusal(sphere, 1e-3).empty());
  EXPECT_TRUE(refusal(sphere, 1e-300).empty());
}

// Debris, and a gap across a corner where joining would make what is no manifold.
TEST_F(SurfaceWeld, MakesNothingWorse) {
  Polygons s = cube();
  s.faces.pop_back();
  s.append(box_of_triangles({1 + 1e-9, 1 + 1e-9, 0}, {2, 2, 1}));
  s.faces.pop_back();
  const std::string message = refusal(s);
  EXPECT_TRUE(has(message, "is not closed: 6 edges")) << message;
  Polygons debris = cube();
  debris.append({{{5, 5, 5}, {5 + 1e-9, 5, 5}, {5, 5 + 1e-9, 5}}, {{0, 1, 2}}});
  const InputSurface found = read(debris);
  EXPECT_EQ(found.facts.num_triangles, 12U);
  EXPECT_TRUE(has(notes(found), "dropped 1 triangle with two equal corners")) << notes(found);
}

// ---- Models ----

class WeldedModels : public testing::Test {
 protected:
  void SetUp() override {
    if (kModels.empty()) GTEST_SKIP() << kNoModels;
  }
  const std::filesystem::path kModels = models_directory();
};

TEST_F(WeldedModels, FeaturetypeIsClosed) {
  for (const std::uint64_t capacity : {kBucketCapacity, std::uint64_t{100}}) {
    const InputSurface s = read_whole_surface(kModels / "reports" / "featuretype.stl", capacity);
    expect_closed(s);
    EXPECT_EQ(s.facts.num_triangles, 3476U);
    EXPECT_EQ(s.facts.num_components, 1U);
    ASSERT_FALSE(s.facts.notes.empty());
    EXPECT_TRUE(s.facts.notes.front().starts_with("joined 288 points with others up to"))
        << s.facts.notes.front();
  }
}

TEST_F(WeldedModels, CornersAMillionthApartAreJoinedOnRequest) {
  const auto file = kModels / "bad" / "nearly_duplicated_vertices_joint.off";
  std::string message;
  try {
    read_whole_surface(file);
  } catch (const InputError& error) {
    message = error.what();
  }
  const auto to = message.find(" would close it");
  ASSERT_NE(to, std::string::npos) << message;
  const auto from = message.rfind("--weld ", to) + 7;
  const InputSurface s =
      read_whole_surface(file, kBucketCapacity, std::stod(message.substr(from, to - from)));
  EXPECT_EQ(s.facts.num_vertices, 221U);
  EXPECT_EQ(s.facts.num_triangles, 446U);
  EXPECT_EQ(s.facts.euler_characteristic, -2);
  EXPECT_NEAR(s.facts.volume, 0.359494, 1e-6);
}

}  // namespace
}  // namespace locvol
