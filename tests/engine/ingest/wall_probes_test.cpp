// Distances between parts of a surface that face each other: of shapes where they are known, and
// against all triangles one by one.
#include "engine/ingest/wall_probes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <span>

#include "engine/ingest/triangle_soup.h"
#include "tests/engine/closed_shapes.h"

namespace locvol {
namespace {

using namespace testing_shapes;

struct Looked {
  std::vector<WallProbe> probes;
  LineSights sights;
  FacingFacts facts;
};

Box box_of(const std::vector<Triangle>& triangles) {
  Box box = triangles.front().box();
  for (const Triangle& t : triangles) box = box.joined(t.box());
  return box;
}

Looked look(const std::vector<Triangle>& triangles) {
  Looked looked;
  ProbePicker picker;
  for (const Triangle& t : triangles) picker.add(t);
  looked.probes = picker.take();
  const WallProbes probes(looked.probes, box_of(triangles));
  const TriangleSoup soup = soup_of(triangles);
  const TriangleTree tree(soup.vertices, soup.triangles);
  looked.sights.resize(probes.num_lines());
  for (const LineHit& hit : probes.hits_in(kEverywhere, tree, soup.vertices, soup.triangles))
    looked.sights[hit.line].add(hit);
  looked.facts = facing_facts(looked.sights);
  return looked;
}

FacingFacts facing_of(const Shape& shape) { return look(shape.soup()).facts; }

double low(const FacingPlaces& places) {
  return std::exp2(static_cast<double>(places.step) / FacingPlaces::kStepsPerOctave);
}

// The part of the places that face something of the kind at about the distance, one or two steps.
double share(const FacingFacts& facts, std::uint32_t FacingPlaces::*kind, double distance) {
  double num = 0;
  for (const FacingPlaces& places : facts.places)
    if (std::abs(std::log(low(places) / distance)) < 0.05) num += places.*kind;
  return num / static_cast<double>(facts.num_places);
}

TEST(WallProbes, OfAPlateAreItsThicknessWhereverItIsFlat) {
  for (const double thickness : {0.001, 0.02, 0.4}) {
    const Shape plate = turned(box_shape({{0, 0, 0}, {5, 7, thickness}}));
    const FacingFacts facts = facing_of(plate);
    EXPECT_EQ(facts.num_places, ProbePicker::kNumProbes);
    const double sides = 2 * (5 + 7) * thickness, faces = 2 * 5 * 7;
    // But beside the rim, where lines that lean come out.
    const double narrow = 2 * 2 * (5 + 7) * 1.2 * thickness;
    EXPECT_LT(share(facts, &FacingPlaces::num_walls, thickness), faces / (faces + sides) + 0.01);
    EXPECT_GT(share(facts, &FacingPlaces::num_walls, thickness),
              (faces - narrow) / (faces + sides) - 0.01);
  }
}

TEST(WallProbes, OfAGapAreItsWidth) {
  const Box box{{0, 0, 0}, {4, 4, 3}};
  const FacingFacts facts =
      facing_of(turned(together(box_shape(box), translated(box_shape(box), {0, 0, 3.01}))));
  const double area = 2 * (2 * 16 + 4 * 12);
  EXPECT_NEAR(share(facts, &FacingPlaces::num_gaps, 0.01), 2 * 16 / area, 0.03);
  EXPECT_EQ(share(facts, &FacingPlaces::num_walls, 0.01), 0);
  // Seen across a box that is no wider than high, both are narrow all around.
  EXPECT_NEAR(share(facts, &FacingPlaces::num_rods, 4), 2 * 4 * 12 / area, 0.05);
}

TEST(WallProbes, OfAShellAreItsWallAndOfItsCavityNone) {
  const FacingFacts facts = facing_of(shell(2, 0.05, 40));
  EXPECT_GT(share(facts, &FacingPlaces::num_walls, 0.05), 0.95);
  for (const FacingPlaces& places : facts.places) {
    EXPECT_LT(low(places), 0.1);
    EXPECT_EQ(places.num_gaps + places.num_holes, 0);
  }
}

TEST(WallProbes, TellRodsAndHolesFromSheets) {
  const Shape rod = turned(box_shape({{0, 0, 0}, {0.1, 0.1, 9}}));
  EXPECT_GT(share(facing_of(rod), &FacingPlaces::num_rods, 0.1), 0.95);
  EXPECT_GT(share(facing_of(torus(3, 0.1, 300, 24)), &FacingPlaces::num_rods, 0.2), 0.9);
  EXPECT_GT(share(facing_of(sphere(0.5, 31, 64)), &FacingPlaces::num_rods, 1), 0.9);
  const Shape hole = pipe(3, 2.9, 20, 60);  // 0.1 in radius
  const double inner = 2 * std::numbers::pi * 0.1 * 20;
  const double outer = 2 * std::numbers::pi * (3 * 20 + 3 * 3);
  EXPECT_NEAR(share(facing_of(hole), &FacingPlaces::num_holes, 0.2), inner / (inner + outer), 0.01);
}

// Sheets face each other if they are within 32° of parallel.
TEST(WallProbes, OfAKnifeAreAsItsAngle) {
  const auto walls = [](double degrees) {
    double num = 0;
    for (const FacingPlaces& places :
         facing_of(turned(wedge(4, 8, degrees * std::numbers::pi / 180))).places)
      if (low(places) < 0.5) num += places.num_walls;
    return num;
  };
  EXPECT_GT(walls(10), 200);
  EXPECT_GT(walls(25), 20);
  EXPECT_EQ(walls(40), 0);
}

TEST(WallProbes, AreThoseOfTheTrianglesInAnyOrderAndAtAnyScale) {
  std::vector<Triangle> triangles = turned(torus(3, 0.5, 60, 20)).soup();
  const FacingFacts facts = look(triangles).facts;
  std::mt19937 random(7);
  std::ranges::shuffle(triangles, random);
  EXPECT_EQ(look(triangles).facts, facts);
  // Other places, for these are drawn by the corners' bits; but about as many of each kind.
  for (Triangle& t : triangles)
    for (Point& p : t.corners) p = 1e6 * p;
  const auto rods = [](const FacingFacts& of) {
    double num = 0;
    for (const FacingPlaces& places : of.places) num += places.num_rods;
    return num / static_cast<double>(of.num_places);
  };
  EXPECT_NEAR(rods(look(triangles).facts), rods(facts), 0.05);
}

TEST(WallProbes, ArePlacedEvenlyByArea) {
  // One triangle of half the area, and a thousand that share the rest.
  std::vector<Triangle> triangles{{0, {{{0, 0, 0}, {100, 0, 0}, {0, 10, 0}}}}};
  for (std::uint32_t i = 0; i < 1000; ++i) {
    const double x = i;
    triangles.push_back({i + 1, {{{x, 50, 0}, {x + 1, 50, 0}, {x, 51, 0}}}});
  }
  const Looked looked = look(triangles);
  ASSERT_EQ(looked.probes.size(), ProbePicker::kNumProbes);
  const auto num_on_first = std::ranges::count_if(
      looked.probes, [](const WallProbe& probe) { return probe.place.y < 20; });
  EXPECT_NEAR(static_cast<double>(num_on_first) / ProbePicker::kNumProbes, 0.5, 0.02);
  double sum = 0;  // of places in it, whose mean is the centroid
  for (const WallProbe& probe : looked.probes)
    if (probe.place.y < 20) sum += probe.place.x;
  EXPECT_NEAR(sum / static_cast<double>(num_on_first), 100.0 / 3, 1);
}

// A triangle's tree leaves out none that a line meets.
TEST(WallProbes, MeetWhatAllTrianglesOneByOneMeet) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(-1, 1);
  std::vector<Triangle> triangles;
  for (std::uint64_t id = 0; id < 300; ++id) {
    const Point at{unit(random), unit(random), unit(random)};
    Triangle t{id, {}};
    for (Point& p : t.corners) p = at + 0.3 * Point{unit(random), unit(random), unit(random)};
    triangles.push_back(t);
  }
  const Looked looked = look(triangles);
  const WallProbes probes(looked.probes, box_of(triangles));
  LineSights expected(probes.num_lines());
  for (const Triangle& t : triangles) {
    const TriangleSoup soup = soup_of(std::span(&t, 1));
    const TriangleTree tree(soup.vertices, soup.triangles);
    for (const LineHit& hit : probes.hits_in(kEverywhere, tree, soup.vertices, soup.triangles))
      expected[hit.line].add(hit);
  }
  for (std::size_t i = 0; i < expected.size(); ++i) {
    for (const bool is_ahead : {false, true}) {
      EXPECT_EQ(looked.sights[i].nearest(is_ahead).distance,
                expected[i].nearest(is_ahead).distance);
    }
    if (i % WallProbes::kNumLines != 0) continue;
    EXPECT_EQ(looked.sights[i].is_inside_ahead(), expected[i].is_inside_ahead());
  }
}

}  // namespace
}  // namespace locvol
