// Creases of surfaces, against a walk in memory, and those of shapes that people know.
#include "engine/ingest/surface_creases.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <numbers>
#include <set>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "engine/engine.h"
#include "engine/shared/compensated_sum.h"
#include "tests/engine/ingest/creased_surfaces.h"
#include "tests/engine/ingest/random_surfaces.h"
#include "tests/engine/ingest/surface_fixtures.h"
#include "tests/engine/store_contents.h"

namespace locvol {
namespace {

// ---- In memory ----

using Edge = std::array<Point, 2>;

// Of triangles with their sheets, none of which is a needle.
class Walk {
 public:
  Walk(const std::vector<Triangle>& triangles, const CreaseTrial& trial)
      : triangles_(triangles), trial_(trial) {
    for (const Triangle& t : triangles_)
      for (std::uint32_t k = 0; k < 3; ++k) {
        const Point &a = t.corners[k], &b = t.corners[(k + 1) % 3];
        uses_[{std::min(a, b), std::max(a, b)}].push_back({&t, k});
        const auto name = 3 * t.id + k;
        names_[a] = names_.contains(a) ? std::min(names_[a], name) : name;
      }
    for (const auto& [edge, uses] : uses_)
      if (is_sharp(uses)) found_.insert(edge);
    find_tips();
    drop_noise();
    for (const Edge& edge : found_)
      for (const Point& p : edge) at_[p].push_back(edge);
  }

  Creased creases() {
    Creased result;
    result.surface.triangles = triangles_;
    std::map<std::uint64_t, Point> corners;
    for (const Point& p : tips_) corners[names_[p]] = p;
    for (const auto& [p, edges] : at_)
      if (!goes_on(p, edges)) corners[names_[p]] = p;
    for (const auto& [name, p] : corners) {
      ids_[p] = static_cast<std::uint32_t>(ids_.size() + 1);
      result.surface.corners.push_back({p, ids_[p]});
    }
    std::map<std::uint64_t, Edge> by_name;
    for (const Edge& edge : found_) by_name[name_of(edge)] = edge;
    std::map<Edge, CreaseId> crease_of;
    for (const auto& [name, first] : by_name) {
      if (crease_of.contains(first)) continue;
      CreaseFacts& facts = result.sheets.creases.emplace_back();
      facts.sheets = sheets_of(first);
      const auto id = static_cast<CreaseId>(result.sheets.creases.size());
      std::vector<Edge> waiting = {first};
      std::vector<std::uint32_t> ends;
      while (!waiting.empty()) {
        const Edge edge = waiting.back();
        waiting.pop_back();
        if (!crease_of.emplace(edge, id).second) continue;
        ++facts.num_edges;
        facts.length += norm(edge[1] - edge[0]);
        for (const Point& p : edge) {
          if (ids_.contains(p))
            ends.push_back(ids_[p]);
          else
            for (const Edge& next : at_[p]) waiting.push_back(next);
        }
      }
      std::ranges::sort(ends);
      EXPECT_TRUE(ends.empty() || ends.size() == 2);
      if (ends.size() == 2) facts.corners = {ends[0], ends[1]};
    }
    for (const Edge& edge : found_)
      result.surface.creases.push_back({edge,
                                        {ids_.contains(edge[0]), ids_.contains(edge[1])},
                                        sheets_of(edge),
                                        crease_of[edge]});
    result.sheets.num_corners = corners.size();
    return result;
  }

 private:
  struct Use {
    const Triangle* triangle;
    std::uint32_t k;
  };

  static double degrees_between(const Point& a, const Point& b) {
    return std::atan2(norm(cross(a, b)), dot(a, b)) * 180 / std::numbers::pi;
  }
  static Point normal(const Triangle& t) {
    return cross(t.corners[1] - t.corners[0], t.corners[2] - t.corners[0]);
  }
  bool is_sharp(const std::vector<Use>& uses) const {
    const auto& [one, other] = std::pair(uses.at(0), uses.at(1));
    if (one.triangle->sheet != other.triangle->sheet) return true;
    const bool is_turned = one.triangle->corners[one.k] == other.triangle->corners[other.k];
    return degrees_between(normal(*one.triangle),
                           (is_turned ? -1.0 : 1.0) * normal(*other.triangle)) > trial_.sharp_angle;
  }
  std::array<SheetId, 2> sheets_of(const Edge& edge) const {
    const auto& uses = uses_.at(edge);
    const auto [least, most] = std::minmax(uses[0].triangle->sheet, uses[1].triangle->sheet);
    return {least, most};
  }
  std::uint64_t name_of(const Edge& edge) const {
    const auto& uses = uses_.at(edge);
    return std::min(3 * uses[0].triangle->id + uses[0].k, 3 * uses[1].triangle->id + uses[1].k);
  }
  static bool goes_on(const Point& p, const std::vector<Edge>& edges) {
    if (edges.size() != 2) return false;
    const auto way = [&](const Edge& edge) { return edge[0] == p ? edge[1] - p : edge[0] - p; };
    return degrees_between(way(edges[0]), -1.0 * way(edges[1])) <= 45;
  }
  // By triangle, 1 or -1: those that hang together face the same way.
  std::map<std::uint64_t, double> ways() const {
    std::map<std::uint64_t, double> ways;
    for (const Triangle& first : triangles_) {
      if (!ways.emplace(first.id, 1).second) continue;
      std::vector<const Triangle*> waiting = {&first};
      while (!waiting.empty()) {
        const Triangle& t = *waiting.back();
        waiting.pop_back();
        for (std::uint32_t k = 0; k < 3; ++k) {
          const Point &a = t.corners[k], &b = t.corners[(k + 1) % 3];
          for (const Use& use : uses_.at({std::min(a, b), std::max(a, b)})) {
            const bool is_turned = use.triangle->corners[use.k] == a;
            const double way = is_turned ? -ways[t.id] : ways[t.id];
            if (use.triangle != &t && ways.emplace(use.triangle->id, way).second)
              waiting.push_back(use.triangle);
          }
        }
      }
    }
    return ways;
  }
  void find_tips() {
    std::map<std::uint64_t, double> way_of = ways();
    std::map<Point, std::pair<Point, double>> sums;
    std::map<Point, std::pair<double, double>> lengths;  // of sides, and how many
    for (const Triangle& t : triangles_)
      for (std::size_t k = 0; k < 3; ++k) {
        const Point& p = t.corners[k];
        const double angle =
            degrees_between(t.corners[(k + 1) % 3] - p, t.corners[(k + 2) % 3] - p);
        auto& [length, num_sides] = lengths[p];
        length += norm(t.corners[(k + 1) % 3] - p) + norm(t.corners[(k + 2) % 3] - p);
        num_sides += 2;
        auto& [sum, angles] = sums[p];
        sum = sum + way_of[t.id] * angle / norm(normal(t)) * normal(t);
        angles += angle;
      }
    for (const Edge& edge : found_)
      for (const Point& p : edge) sums.erase(p);
    const double cosine = std::cos(trial_.sharp_angle * std::numbers::pi / 180);
    for (const auto& [p, sum] : sums)
      if (norm(sum.first) < cosine * sum.second &&
          lengths[p].first >= 0.25 * trial_.least_extent * lengths[p].second)
        tips_.push_back(p);
  }
  void drop_noise() {
    std::map<Point, std::vector<Edge>> at;
    for (const Edge& edge : found_)
      if (sheets_of(edge)[0] == sheets_of(edge)[1])
        for (const Point& p : edge) at[p].push_back(edge);
    std::map<Point, std::vector<Edge>> all_at;
    for (const Edge& edge : found_)
      for (const Point& p : edge) all_at[p].push_back(edge);
    std::set<Edge> known;
    for (const auto& [p, edges] : at) {
      std::vector<Edge> waiting = edges, component;
      Box box = Box::around(p);
      double length = 0, num_ends = 0;
      while (!waiting.empty()) {
        const Edge edge = waiting.back();
        waiting.pop_back();
        if (!known.insert(edge).second) continue;
        component.push_back(edge);
        box = box.joined(edge[0]).joined(edge[1]);
        length += norm(edge[1] - edge[0]);
        for (const Point& q : edge) num_ends += !goes_on(q, all_at[q]);
        for (const Point& q : edge) waiting.insert(waiting.end(), at[q].begin(), at[q].end());
      }
      if (norm(box.max - box.min) < trial_.least_extent ||
          2 * length < trial_.least_extent * num_ends)
        for (const Edge& edge : component) found_.erase(edge);
    }
  }

  std::vector<Triangle> triangles_;
  CreaseTrial trial_;
  std::map<Edge, std::vector<Use>> uses_;
  std::map<Point, std::uint64_t> names_;
  std::set<Edge> found_;
  std::map<Point, std::vector<Edge>> at_;
  std::map<Point, std::uint32_t> ids_;
  std::vector<Point> tips_;
};

void expect_same(const Creased& found, const Creased& expected) {
  EXPECT_EQ(found.surface.triangles, expected.surface.triangles);
  EXPECT_EQ(found.surface.creases, expected.surface.creases);
  EXPECT_EQ(found.surface.corners, expected.surface.corners);
  EXPECT_EQ(found.sheets.num_corners, expected.sheets.num_corners);
  ASSERT_EQ(found.sheets.creases.size(), expected.sheets.creases.size());
  for (std::size_t c = 0; c < found.sheets.creases.size(); ++c) {
    CreaseFacts one = found.sheets.creases[c], other = expected.sheets.creases[c];
    EXPECT_NEAR(one.length, other.length, 1e-12 * one.length);
    one.length = other.length;
    EXPECT_EQ(one, other) << c;
  }
}

TEST(SurfaceCreases, AreTheSameForAnyCellsAndThreadsAndThoseOfAWalk) {
  const SurfaceFiles files;
  Random random(11);
  for (int trial = 0; trial < 8; ++trial) {
    SCOPED_TRACE(trial);
    Polygons shape = trial % 2 == 0 ? manifold_voxels(random, files) : random_balls(random);
    shuffle(shape, random);
    const auto file = files.write("shape.off", to_off(shape));
    // Edges of balls are noise but for some; those of voxels are long.
    const CreaseTrial whole{.sharp_angle = trial % 2 == 0 ? 40 : uniform(random, 5, 25),
                            .least_area = trial % 4 == 1 ? 0.1 : 0.0,
                            .least_extent = trial < 4 ? 0 : uniform(random, 0.2, 4)};
    const Creased found = creases_in(file, whole);
    EXPECT_FALSE(found.surface.creases.empty() && trial % 2 == 0);
    const Creased expected = Walk(found.surface.triangles, whole).creases();
    expect_same(found, expected);
    for (const std::uint64_t capacity : {20, 300}) {
      CreaseTrial cut = whole;
      cut.bucket_capacity = capacity;
      cut.num_threads = capacity == 300 ? 3 : 1;
      const Creased other = creases_in(file, cut);
      EXPECT_EQ(other.surface, found.surface);
      EXPECT_EQ(other.sheets, found.sheets);
    }
  }
}

// Rough balls have many narrow parts; some cells are a few triangles each.
TEST(SurfaceCreases, AreTheSameForAnyCellsWhereThereAreStrips) {
  const SurfaceFiles files;
  Random random(12);
  int num_with_strips = 0;
  for (int trial = 0; trial < 6; ++trial) {
    SCOPED_TRACE(trial);
    Polygons shape = random_balls(random);
    shuffle(shape, random);
    const auto file = files.write("shape.off", to_off(shape));
    CreaseTrial with{.sharp_angle = uniform(random, 5, 25)};
    const Creased without = creases_in(file, with);
    with.least_width = uniform(random, 0.1, 1);
    const Creased found = creases_in(file, with);
    num_with_strips += found.surface.creases != without.surface.creases;
    for (const std::uint64_t capacity : {20, 300}) {
      with.bucket_capacity = capacity;
      const Creased other = creases_in(file, with);
      EXPECT_EQ(other.surface, found.surface);
      EXPECT_EQ(other.sheets, found.sheets);
    }
  }
  EXPECT_GE(num_with_strips, 3);
}

TEST(SurfaceCreases, ABoxHasTwelveAndEightCorners) {
  const SurfaceFiles files;
  const Creased found =
      creases_in(files.write("box.off", to_off(box_of_triangles({0, 0, 0}, {3, 2, 1}))));
  ASSERT_EQ(found.sheets.creases.size(), 12U);
  EXPECT_EQ(found.sheets.num_corners, 8U);
  std::map<std::uint32_t, int> at_corners;
  double length = 0;
  for (const CreaseFacts& crease : found.sheets.creases) {
    EXPECT_EQ(crease.num_edges, 1U);
    EXPECT_NE(crease.sheets[0], crease.sheets[1]);
    for (const std::uint32_t corner : crease.corners) ++at_corners[corner];
    length += crease.length;
  }
  EXPECT_EQ(length, 4 * (3 + 2 + 1));
  for (std::uint32_t corner = 1; corner <= 8; ++corner) EXPECT_EQ(at_corners[corner], 3);
  EXPECT_TRUE(std::ranges::all_of(found.surface.creases, [](const CreaseEdge& edge) {
    return edge.is_corner[0] && edge.is_corner[1];
  }));
  const Creased none = creases_in(
      files.write("box.off", to_off(box_of_triangles({0, 0, 0}, {3, 2, 1}))), {.sharp_angle = 0});
  EXPECT_TRUE(none.sheets.creases.empty());
  EXPECT_TRUE(none.surface.creases.empty() && none.surface.corners.empty());
}

// Around one face that is missing, its edges are creases as before; around two that meet, none is
// where a wide hole is closed, and no tip either.
TEST(SurfaceCreases, AreNotAtWideHolesWithBentRims) {
  const SurfaceFiles files;
  const auto length_without = [&](int num_faces) {
    Polygons box = box_of_triangles({0, 0, 0}, {3, 2, 1});
    const auto is_of_face = [&](const auto& face, auto lies_there) {
      return std::ranges::all_of(face, [&](auto v) { return lies_there(box.vertices[v]); });
    };
    std::erase_if(box.faces, [&](const auto& face) {
      return is_of_face(face, [](const Point& p) { return p.z == 1; }) ||
             (num_faces == 2 && is_of_face(face, [](const Point& p) { return p.y == 2; }));
    });
    const Creased found =
        creases_in(files.write("open.off", to_off(box)),
                   {.winding = {InsideRule::kWinding, 0.3, std::uint64_t{1} << 30}});
    double length = 0;
    for (const CreaseFacts& crease : found.sheets.creases) length += crease.length;
    EXPECT_EQ(found.sheets.num_corners, num_faces == 1 ? 8U : 6U);
    return length;
  };
  EXPECT_DOUBLE_EQ(length_without(1), 4 * (3 + 2 + 1));
  EXPECT_DOUBLE_EQ(length_without(2), 3 + 2 * 2 + 2 * 1);
}

// A block of two terraces. The riser between them has a height of `rise` at one end, and of `least`
// at the other, 4 away: at 0 it is a point.
Polygons terraces(double least, double rise) {
  Polygons block;
  for (const auto& [z, its] : {std::pair(0.0, least), std::pair(4.0, rise)})
    for (const Point& p :
         {Point{0, 0, z}, {3, 0, z}, {3, 1, z}, {1.5, 1, z}, {1.5, 1 + its, z}, {0, 1 + its, z}})
      block.vertices.push_back(p);
  block.faces = {{5, 4, 3, 2, 1, 0}, {6, 7, 8, 9, 10, 11}};
  for (std::uint32_t k = 0; k < 6; ++k) {
    const std::uint32_t next = (k + 1) % 6;
    block.faces.push_back({k, next, next + 6, k + 6});
  }
  return block;
}

// Where a strip ends in a point, or is narrower than points can be near each other; else both of
// its creases can be kept.
TEST(SurfaceCreases, AreNotOnBothSidesOfAStripThatEndsInAPoint) {
  const SurfaceFiles files;
  constexpr double kRise = 0.02;
  for (const std::uint64_t capacity : {kBucketCapacity, std::uint64_t{4}}) {
    const auto creases = [&](double least, double least_width) {
      const Creased found = creases_in(files.write("block.off", to_off(terraces(least, kRise))),
                                       {.bucket_capacity = capacity, .least_width = least_width});
      CompensatedSum length;
      for (const CreaseFacts& crease : found.sheets.creases) length.add(crease.length);
      EXPECT_EQ(found.sheets.creases.size(),
                (found.sheets.sheets.size() == 8 ? 17U : 16U) + (least > 0));
      return std::pair(found.sheets.sheets.size(), length.value());
    };
    const double slant = std::hypot(4, kRise), width = 4 * kRise / (4 + slant + kRise);
    const double length = 4 * 4 + 2 * slant + 2 * (3 + 1) + (3 + 1) + (3 + 1 + 2 * kRise);
    const auto [num, all] = creases(0, 0.99 * width);
    EXPECT_EQ(num, 8U);
    EXPECT_NEAR(all, length, 1e-12);
    const auto [num_left, kept] = creases(0, 1.01 * width);
    EXPECT_EQ(num_left, 7U);
    EXPECT_NEAR(kept, length - slant, 1e-12);
    const auto [num_of_both, both] = creases(kRise, 2 * kRise);
    EXPECT_EQ(num_of_both, 8U);
    EXPECT_NEAR(both, 6 * 4 + 2 * (2 * 3 + 2 * (1 + kRise)), 1e-12);
    // Narrower than the floor, which is a third of that width.
    const auto [num_of_one, one] = creases(kRise, 4 * kRise);
    EXPECT_EQ(num_of_one, 7U);
    EXPECT_NEAR(one, both - 4, 1e-12);
  }
}

// A block of two terraces, and the riser between them, a sheet that is wide where z is small, and
// ends in a tongue: of `rise` at z = 5, and a point at z = 9.
Polygons block_with_tongue(double rise) {
  Polygons block;
  for (const auto& [z, its] : {std::pair(0.0, 1.0), {1.0, 1.0}, {5.0, rise}, {9.0, 0.0}})
    for (const Point& p :
         {Point{0, 0, z}, {3, 0, z}, {3, 1, z}, {1.5, 1, z}, {1.5, 1 + its, z}, {0, 1 + its, z}})
      block.vertices.push_back(p);
  block.faces = {{5, 4, 3, 2, 1, 0}, {18, 19, 20, 21, 22, 23}};
  for (std::uint32_t first : {0U, 6U, 12U})
    for (std::uint32_t k = 0; k < 6; ++k) {
      const std::uint32_t next = (k + 1) % 6;
      block.faces.push_back({first + k, first + next, first + next + 6, first + k + 6});
    }
  return block;
}

TEST(SurfaceCreases, AreNotOnBothSidesOfATongue) {
  const SurfaceFiles files;
  constexpr double kRise = 0.02;
  const double slope = std::hypot(4, 1 - kRise), slant = std::hypot(4, kRise);
  for (const std::uint64_t capacity : {kBucketCapacity, std::uint64_t{4}}) {
    const auto length = [&](double least_width) {
      const Creased found = creases_in(files.write("block.off", to_off(block_with_tongue(kRise))),
                                       {.bucket_capacity = capacity, .least_width = least_width});
      EXPECT_EQ(found.sheets.sheets.size(), 8U);
      CompensatedSum sum;
      for (const CreaseFacts& crease : found.sheets.creases) sum.add(crease.length);
      return sum.value();
    };
    // Where z is 0 and 9, where x is 0, and 3, and at the foot of the riser; and at its top.
    const double others =
        (3 + 1 + 1.5 + 1 + 1.5 + 2) + (3 + 1 + 3 + 1) + 9 + (1 + slope + slant) + 2 * 9 + 9;
    EXPECT_NEAR(length(0), others + 1 + slope + slant, 1e-12);
    EXPECT_NEAR(length(kRise / 2), others + 1 + slope + slant, 1e-12);
    EXPECT_NEAR(length(2 * kRise), others + 1 + slope + kRise, 1e-12);
  }
}

// The sides of a slender wedge are as narrow, and pointed; but the surface turns away all around.
TEST(SurfaceCreases, AreOnBothSidesOfASlenderWedge) {
  const SurfaceFiles files;
  Polygons wedge;
  wedge.vertices = {{0, 0, 0}, {4, 0, 0}, {4, 3, 0}, {0, 3, 0}, {4, 0, 0.02}, {4, 3, 0.02}};
  wedge.faces = {{3, 2, 1, 0}, {0, 1, 4}, {3, 5, 2}, {1, 2, 5, 4}, {0, 4, 5, 3}};
  const Creased found = creases_in(files.write("wedge.off", to_off(wedge)), {.least_width = 0.1});
  EXPECT_EQ(found.sheets.sheets.size(), 5U);
  EXPECT_EQ(found.sheets.creases.size(), 9U);
}

TEST(SurfaceCreases, TooManyAreNone) {
  const SurfaceFiles files;
  const auto file = files.write("box.off", to_off(box_of_triangles({0, 0, 0}, {3, 2, 1})));
  for (const std::uint64_t capacity : {kBucketCapacity, std::uint64_t{4}}) {
    EXPECT_TRUE(creases_in(file, {.bucket_capacity = capacity, .most = 12}).notes.empty());
    const Creased none = creases_in(file, {.bucket_capacity = capacity, .most = 11});
    EXPECT_TRUE(none.sheets.creases.empty());
    EXPECT_TRUE(none.surface.creases.empty() && none.surface.corners.empty());
    EXPECT_EQ(none.notes.back(), "took no creases, for there would be more than 11");
  }
}

// A box of 3 × 2 × 1 has an area of 22 and edges that are 24 long.
TEST(SurfaceCreases, TooCloseAreNone) {
  const SurfaceFiles files;
  const auto file = files.write("box.off", to_off(box_of_triangles({0, 0, 0}, {3, 2, 1})));
  const double distance = 22.0 / 24;
  for (const std::uint64_t capacity : {kBucketCapacity, std::uint64_t{4}}) {
    const Creased all =
        creases_in(file, {.least_distance = 0.99 * distance, .bucket_capacity = capacity});
    EXPECT_TRUE(all.notes.empty());
    EXPECT_EQ(all.sheets.creases.size(), 12U);
    const Creased none =
        creases_in(file, {.least_distance = 1.01 * distance, .bucket_capacity = capacity});
    EXPECT_TRUE(none.sheets.creases.empty());
    EXPECT_TRUE(none.surface.creases.empty() && none.surface.corners.empty());
    EXPECT_EQ(none.notes.back(),
              "took no creases, for they are 0.917 apart on average, too close for this size: one "
              "below 18.3 keeps them");
  }
}

// Of n sides, from z = 0 to 1, with these radii there; of a radius of 0, a tip.
Polygons frustum(std::uint32_t n, double lower, double upper) {
  Polygons shape;
  for (std::uint32_t i = 0; i < n; ++i)
    for (const auto& [radius, z] : {std::pair(lower, 0.0), std::pair(upper, 1.0)})
      shape.vertices.push_back({radius * std::cos(2 * std::numbers::pi * i / n),
                                radius * std::sin(2 * std::numbers::pi * i / n), z});
  shape.vertices.push_back({0, 0, 0});
  shape.vertices.push_back({0, 0, 1});
  for (std::uint32_t i = 0; i < n; ++i) {
    const std::uint32_t a = 2 * i, b = 2 * ((i + 1) % n), top = upper > 0 ? b + 1 : 2 * n + 1;
    shape.faces.push_back({a, b, top});
    shape.faces.push_back({b, a, 2 * n});
    if (upper == 0) continue;
    shape.faces.push_back({a, b + 1, a + 1});
    shape.faces.push_back({a + 1, b + 1, 2 * n + 1});
  }
  return shape;
}

TEST(SurfaceCreases, OfACylinderAreClosed) {
  const SurfaceFiles files;
  const Creased found = creases_in(files.write("round.off", to_off(frustum(40, 1, 1))));
  ASSERT_EQ(found.sheets.creases.size(), 2U);
  EXPECT_EQ(found.sheets.num_corners, 0U);
  for (const CreaseFacts& crease : found.sheets.creases) {
    EXPECT_TRUE(crease.is_closed());
    EXPECT_EQ(crease.num_edges, 40U);
    EXPECT_NEAR(crease.length, 2 * std::numbers::pi, 0.01);
  }
}

TEST(SurfaceCreases, TheTipOfAConeIsACorner) {
  const SurfaceFiles files;
  for (const std::uint64_t capacity : {kBucketCapacity, std::uint64_t{8}}) {
    const Creased found = creases_in(files.write("cone.off", to_off(frustum(40, 0.5, 0))),
                                     {.bucket_capacity = capacity});
    ASSERT_EQ(found.sheets.creases.size(), 1U);
    EXPECT_TRUE(found.sheets.creases[0].is_closed());
    ASSERT_EQ(found.surface.corners.size(), 1U);
    EXPECT_EQ(found.surface.corners[0], (CornerPoint{{0, 0, 1}, 1}));
  }
  // As a roof that leans by 35 degrees.
  const Creased flat = creases_in(files.write("flat.off", to_off(frustum(40, 1.43, 0))));
  EXPECT_EQ(flat.sheets.creases.size(), 1U);
  EXPECT_EQ(flat.sheets.num_corners, 0U);
}

TEST(SurfaceCreases, WhatIsSmoothHasNone) {
  const SurfaceFiles files;
  const Creased found =
      creases_in(files.write("ball.off", to_off(to_polygons(testing_shapes::sphere(1, 20, 30)))));
  EXPECT_EQ(found.sheets, SurfaceSheets());
  EXPECT_TRUE(found.surface.creases.empty() && found.surface.corners.empty());
}

// Half of the edge of a wedge that fades out ends within a sheet.
TEST(SurfaceCreases, ThoseWithinASheetAreNoiseIfTheyAreShort) {
  const SurfaceFiles files;
  // A roof over z = 0 whose ridge falls to the flat roof at x = 4, from 1 at x = 0.
  Polygons shape;
  const int n = 8;
  for (int i = 0; i <= n; ++i) {
    const double x = 4.0 * i / n;
    shape.vertices.push_back({x, 0, 1});
    shape.vertices.push_back({x, 1, 2 - x / 4});
    shape.vertices.push_back({x, 2, 1});
    shape.vertices.push_back({x, 0, 0});
    shape.vertices.push_back({x, 2, 0});
  }
  const auto quad = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t d) {
    shape.faces.push_back({a, b, c});
    shape.faces.push_back({a, c, d});
  };
  for (std::uint32_t i = 0; i < 5 * n; i += 5) {
    quad(i, i + 5, i + 6, i + 1);
    quad(i + 1, i + 6, i + 7, i + 2);
    quad(i + 2, i + 7, i + 9, i + 4);
    quad(i + 3, i + 8, i + 5, i);
    quad(i + 4, i + 9, i + 8, i + 3);
  }
  for (const std::uint32_t i : {0U, 5U * n}) {
    const auto side = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
      if (i == 0)
        shape.faces.push_back({a, b, c});
      else
        shape.faces.push_back({a, c, b});
    };
    side(i, i + 1, i + 3);
    side(i + 3, i + 1, i + 4);
    side(i + 1, i + 2, i + 4);
  }
  const auto file = files.write("roof.off", to_off(shape));
  const auto ridge_of = [](const Creased& found) {
    double length = 0;
    for (const CreaseEdge& edge : found.surface.creases)
      if (edge.ends[0].y == 1 && edge.ends[1].y == 1)
        length += edge.is_within_sheet() ? norm(edge.ends[1] - edge.ends[0]) : 100;
    return length;
  };
  const Creased found = creases_in(file);
  const double length = ridge_of(found);
  EXPECT_GT(length, 1);
  EXPECT_LT(length, 4);
  EXPECT_EQ(ridge_of(creases_in(file, {.least_extent = length - 0.01})), length);
  EXPECT_EQ(ridge_of(creases_in(file, {.least_extent = length + 0.01})), 0);
  EXPECT_EQ(ridge_of(creases_in(file, {.least_extent = length - 0.01, .bucket_capacity = 8})),
            length);
  EXPECT_EQ(ridge_of(creases_in(file, {.least_extent = length + 0.01, .bucket_capacity = 8})), 0);
}

// Leaves that were split, too.
TEST(SurfaceCreases, LeavesOfAFinishedRunHaveThoseThatMeetThem) {
  const SurfaceFiles files;
  MeshOptions options;
  options.input = files.write("cone.off", to_off(frustum(40, 0.5, 0)));
  options.store = files.directory() / "store";
  options.size = {0.05, false};
  options.leaf_capacity = 100;
  options.init = Initialization::kPaper;  // begins with few leaves
  mesh(options, {});
  const Contents contents = contents_of(options.store);
  LeafSurface all;
  for (const auto& [key, leaf] : contents.leaves) all.append(leaf.surface);
  all.unite();
  EXPECT_EQ(all.creases.size(), 40U);
  EXPECT_EQ(all.corners.size(), 1U);
  EXPECT_GT(contents.leaves.size(), 20U);
  for (const auto& [key, leaf] : contents.leaves)
    expect_in_cells(all, contents.run.frame.box(key), leaf.surface);
}

}  // namespace
}  // namespace locvol
