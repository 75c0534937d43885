// What the sweep of shapes relies on: surfaces that are what they claim to be.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <ostream>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "tests/sweeps/shapes/blocks.h"
#include "tests/sweeps/shapes/damaged.h"
#include "tests/sweeps/shapes/families.h"
#include "tests/sweeps/shapes/prisms.h"
#include "tests/sweeps/shapes/shape_case.h"

namespace locvol::sweeps {

void PrintTo(const Family& family, std::ostream* out) { *out << family.name; }

namespace {

constexpr std::uint64_t kNumSeeds = 60;

using Indices = std::array<std::uint32_t, 3>;
using DirectedEdge = std::pair<std::uint32_t, std::uint32_t>;

std::map<DirectedEdge, int> directed_edges(const Shape& shape) {
  std::map<DirectedEdge, int> edges;
  for (const Indices& t : shape.triangles)
    for (std::size_t i = 0; i < 3; ++i) ++edges[{t[i], t[(i + 1) % 3]}];
  return edges;
}

// Each edge once in each direction: closed, and all triangles turn the same way.
bool is_closed(const Shape& shape) {
  const auto edges = directed_edges(shape);
  for (const auto& [edge, count] : edges)
    if (count != 1 || !edges.contains({edge.second, edge.first})) return false;
  return !edges.empty();
}

// The triangles at a vertex are one cycle: walking around it, one meets them all.
bool has_disks_at_vertices(const Shape& shape) {
  std::vector<std::map<std::uint32_t, std::uint32_t>> next(shape.vertices.size());
  for (const Indices& t : shape.triangles)
    for (std::size_t i = 0; i < 3; ++i) next[t[i]][t[(i + 1) % 3]] = t[(i + 2) % 3];
  for (const auto& around : next) {
    if (around.empty()) return false;  // a vertex of no triangle
    std::size_t num_met = 1;
    const std::uint32_t first = around.begin()->first;
    for (std::uint32_t at = around.at(first); at != first; at = around.at(at)) ++num_met;
    if (num_met != around.size()) return false;
  }
  return true;
}

Shape body_of(const Solid& solid, std::uint32_t body) {
  Shape shape{solid.shape.vertices, {}};
  for (std::size_t t = 0; t < solid.bodies.size(); ++t)
    if (solid.bodies[t] == body) shape.triangles.push_back(solid.shape.triangles[t]);
  return shape;
}

bool has_different_points(const Shape& shape) {
  const std::set<Point> points(shape.vertices.begin(), shape.vertices.end());
  return points.size() == shape.vertices.size();
}

int euler_characteristic(const Shape& shape) {
  return static_cast<int>(shape.vertices.size()) - static_cast<int>(shape.triangles.size() / 2);
}

int num_components(const Shape& shape) {
  std::vector<std::uint32_t> parent(shape.vertices.size());
  for (std::uint32_t i = 0; i < parent.size(); ++i) parent[i] = i;
  const auto root = [&](std::uint32_t i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
  };
  for (const Indices& t : shape.triangles)
    for (std::size_t i = 1; i < 3; ++i) parent[root(t[i])] = root(t[0]);
  int count = 0;
  for (std::uint32_t i = 0; i < parent.size(); ++i) count += parent[i] == i ? 1 : 0;
  return count;
}

void expect_surface(const Shape& shape) {
  EXPECT_TRUE(is_closed(shape));
  EXPECT_TRUE(has_disks_at_vertices(shape));
  EXPECT_TRUE(has_different_points(shape));
  EXPECT_GT(volume_of(shape), 0);  // oriented outwards
}

void expect_claims(const Solid& solid) {
  if (solid.volume) {
    // Thin walls are differences of large volumes.
    const Box box = box_of(solid.shape);
    const double whole = std::pow(max_norm(box.max - box.min), 3);
    EXPECT_NEAR(volume_of(solid.shape), *solid.volume, 1e-9 * *solid.volume + 1e-12 * whole);
  }
  if (solid.num_components) {
    EXPECT_EQ(num_components(solid.shape), *solid.num_components);
  }
  if (solid.genus && solid.num_components) {
    EXPECT_EQ(euler_characteristic(solid.shape), 2 * (*solid.num_components - *solid.genus));
  }
  EXPECT_GE(solid.thickness, 0);
  EXPECT_TRUE(std::isfinite(solid.thickness));
}

class FamilyTest : public testing::TestWithParam<Family> {};

TEST_P(FamilyTest, MakesSurfacesThatAreWhatTheyClaim) {
  for (std::uint64_t seed = 0; seed < kNumSeeds; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    Dice dice(seed);
    const Solid solid = GetParam().make(dice);
    expect_surface(solid.shape);
    expect_claims(solid);
    if (HasFailure()) break;
  }
}

INSTANTIATE_TEST_SUITE_P(Shapes, FamilyTest,
                         testing::ValuesIn(families().begin(), families().end()),
                         [](const auto& test) { return std::string(test.param.name); });

TEST(ShapeCases, AreClosedSurfacesAfterAllChanges) {
  for (std::uint64_t number = 0; number < 400; ++number) {
    SCOPED_TRACE("case " + std::to_string(number));
    const ShapeCase made = make_case(7, number);
    expect_surface(made.solid.shape);
    EXPECT_GT(made.size, 0);
    Dice dice(number);
    EXPECT_LT(MeshingWork(made.solid.shape, dice).num_cells(made.size), 600'000) << made.family;
    if (HasFailure()) break;
  }
}

TEST(ShapeCases, AreAFunctionOfSeedAndNumber) {
  for (std::uint64_t number = 0; number < 100; ++number) {
    SCOPED_TRACE("case " + std::to_string(number));
    const ShapeCase one = make_case(3, number), same = make_case(3, number);
    EXPECT_TRUE(one.solid.shape.vertices == same.solid.shape.vertices);
    EXPECT_TRUE(one.solid.shape.triangles == same.solid.shape.triangles);
    EXPECT_EQ(one.mesh_arguments(), same.mesh_arguments());
    EXPECT_EQ(one.changes, same.changes);
    EXPECT_FALSE(one.solid.shape.vertices == make_case(4, number).solid.shape.vertices);
  }
}

// Two cells along a diagonal, which would touch at an edge, or at a vertex.
TEST(Blocks, FillWhereTheSurfaceWouldTouchItself) {
  for (const std::size_t k : {std::size_t{0}, std::size_t{1}}) {
    Blocks blocks({{{0, 1, 3}, {0, 1, 3}, {0, 1, 3}}});
    blocks.set(0, 0, 0, true);
    blocks.set(1, 1, k, true);
    const Solid solid = blocks.solid();
    expect_surface(solid.shape);
    EXPECT_GT(*solid.volume, 1 + 4 * (k == 0 ? 1 : 2));
    EXPECT_NEAR(volume_of(solid.shape), *solid.volume, 1e-12);
    EXPECT_EQ(num_components(solid.shape), 1);
  }
}

TEST(Prisms, HaveTheVolumeOfAreaTimesHeight) {
  const Region region = {rectangle({0, 0}, {4, 2}), reversed(rectangle({1, 0.5}, {2, 1.5}))};
  EXPECT_DOUBLE_EQ(area(region), 7);
  const Solid solid = prism(region, 3, {{rectangle({3, 0.5}, {3.5, 1}), -2}});
  EXPECT_DOUBLE_EQ(volume_of(solid.shape), 20.5);
  EXPECT_EQ(euler_characteristic(solid.shape), 0);
}

TEST(Changes, KeepTheVolumeAndTheTopology) {
  Dice dice(1);
  const Shape shape = make_plate(dice).shape;
  const double volume = volume_of(shape);
  for (const Shape& changed :
       {subdivided(shape), with_split_edges(shape, 0.01, dice),
        rotated(shape, random_rotation(dice)), rotated(shape, simple_rotation(dice)),
        rotated(shape, random_permutation(dice))}) {
    expect_surface(changed);
    EXPECT_NEAR(volume_of(changed), volume, 1e-12 * volume);
    EXPECT_EQ(euler_characteristic(changed), euler_characteristic(shape));
  }
}

// Edges with another number of triangles than one in each direction.
std::size_t num_wrong_edges(const Shape& shape) {
  const auto edges = directed_edges(shape);
  std::size_t num = 0;
  for (const auto& [edge, count] : edges)
    num += count != 1 || !edges.contains({edge.second, edge.first});
  return num;
}

DamagedSurface damaged_sphere(std::string_view kind, double measure) {
  const auto made = damaged(testing_shapes::sphere(1, 30, 60), {kind, measure}, 7);
  EXPECT_TRUE(made.has_value());
  return made.value_or(DamagedSurface{});
}

TEST(Damages, AreAFunctionOfTheSeed) {
  const Shape sphere = testing_shapes::sphere(1, 30, 60);
  for (const Damage& damage : damages()) {
    const auto one = damaged(sphere, damage, 5), other = damaged(sphere, damage, 5);
    ASSERT_EQ(one.has_value(), other.has_value());
    if (!one) continue;
    EXPECT_EQ(one->shape.vertices, other->shape.vertices) << damage.name();
    EXPECT_EQ(one->shape.triangles, other->shape.triangles) << damage.name();
    for (const Shape& sound : one->sound) EXPECT_TRUE(is_closed(sound));
  }
}

TEST(Damages, AreWhatTheyClaimToBe) {
  const Shape sphere = testing_shapes::sphere(1, 30, 60);
  const std::size_t num = sphere.triangles.size();
  EXPECT_EQ(damaged_sphere("none", 0).shape.triangles, sphere.triangles);
  for (const std::size_t hole : {1, 10, 100}) {
    const DamagedSurface made = damaged_sphere("hole", static_cast<double>(hole));
    EXPECT_EQ(made.shape.triangles.size(), num - hole);
    EXPECT_GT(num_wrong_edges(made.shape), 2u);
    EXPECT_LE(num_wrong_edges(made.shape), hole + 2);  // in one place
    EXPECT_GT(made.lost_volume, 0);
  }
  EXPECT_FALSE(damaged(sphere, {"hole", 1000}, 7).has_value());  // more than a quarter
  const std::size_t lost = num - damaged_sphere("lost", 10).shape.triangles.size();
  EXPECT_NEAR(static_cast<double>(lost), 0.1 * static_cast<double>(num), 100);
  EXPECT_EQ(damaged_sphere("doubled", 100).shape.triangles.size(), 2 * num);
  EXPECT_GT(num_wrong_edges(damaged_sphere("flipped", 50).shape), num / 2);
  EXPECT_EQ(damaged_sphere("unwelded", 1e-5).shape.vertices.size(), 3 * num);
  EXPECT_TRUE(is_closed(damaged_sphere("noise", 0.1).shape));
  EXPECT_EQ(damaged_sphere("copies", 0.3).sound.size(), 2u);
}

// Each is closed by itself and turned outwards; what two have in common is the same triangles.
TEST(FamiliesOfBodies, AreClosedEachByItself) {
  for (const Family& family : families_of_bodies())
    for (std::uint64_t seed = 0; seed < kNumSeeds; ++seed) {
      SCOPED_TRACE(testing::Message() << family.name << ' ' << seed);
      Dice dice(seed);
      const Solid solid = family.make(dice);
      ASSERT_EQ(solid.bodies.size(), solid.shape.triangles.size());
      const std::uint32_t num = std::ranges::max(solid.bodies);
      EXPECT_GE(num, 2U);
      EXPECT_LE(num, 5U);
      EXPECT_TRUE(has_different_points(solid.shape));
      double sum = 0;
      for (std::uint32_t body = 1; body <= num; ++body) {
        const Shape shape = body_of(solid, body);
        EXPECT_TRUE(is_closed(shape)) << body;
        EXPECT_GT(volume_of(shape), 0) << body;
        if (family.name != "onion" || body == 1) sum += volume_of(shape);
      }
      EXPECT_NEAR(sum, solid.volume.value_or(sum), 1e-9 * sum);
    }
}

}  // namespace
}  // namespace locvol::sweeps
