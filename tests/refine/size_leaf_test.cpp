#include "refine/size_leaf.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "octree/octree.h"
#include "refine/domain/surface_part.h"
#include "tests/refine/brute_force.h"
#include "tests/refine/domain_pieces.h"
#include "tests/refine/shapes.h"

namespace locvol {
namespace {

using namespace shapes;
using brute_force::distance;
using brute_force::is_inside;

// A surface in leaves of one level.
class World {
 public:
  World(const Mesh& mesh, double size, double growth, int level,
        const std::vector<SizeShape>& shapes = {})
      : mesh_(mesh),
        law_{.surface = size, .growth = growth},
        shapes_(shapes),
        frame_(Frame::around(bounding_box(mesh), size, 1.75 * size)),
        octree_(LinearOctree::uniform(level)),
        far_(frame_) {
    for (const SizeShape& shape : shapes) law_.least = std::min(law_.least, shape.size);
    for (const MortonKey leaf : octree_.leaves()) {
      if (const LeafSurface met = surface_in(leaf); !met.is_empty()) far_.add(leaf, met);
    }
    far_.finish();
  }

  std::vector<SizeCube> sizes(MortonKey leaf) const {
    const double exact_distance = kExactDistance * law_.surface;
    const Box region = frame_.box(leaf).expanded(exact_distance);
    return size_leaf({law_, exact_distance, frame_, leaf, piece_around(region, mesh_), shapes_},
                     far_);
  }
  SizeCubes all() const {
    SizeCubes sizes{law_, frame_, {}};
    for (const MortonKey leaf : octree_.leaves()) {
      const std::vector<SizeCube> some = this->sizes(leaf);
      sizes.cubes.insert(sizes.cubes.end(), some.begin(), some.end());
    }
    return sizes;
  }
  LeafSurface surface_in(MortonKey leaf) const { return part_in(frame_.box(leaf), {mesh_}); }
  const Mesh& mesh() const { return mesh_; }
  const LinearOctree& octree() const { return octree_; }
  const Frame& frame() const { return frame_; }
  const SizeLaw& law() const { return law_; }
  const FarSurface& far() const { return far_; }
  double leaf_side() const { return frame_.side(octree_.leaves().front().level()); }

 private:
  Mesh mesh_;
  SizeLaw law_;
  std::vector<SizeShape> shapes_;
  Frame frame_;
  LinearOctree octree_;
  FarSurface far_;
};

std::vector<World> worlds() {
  std::vector<World> some;
  some.emplace_back(icosphere({0, 0, 0}, 1, 3), 0.08, 0.2, 2);
  some.emplace_back(box({{0, 0, 0}, {1, 0.7, 1.3}}), 0.06, 0.3, 1);
  some.emplace_back(torus(1, 0.4, 40, 20), 0.08, 0.1, 2);
  return some;
}

TEST(SizeLeaf, CubesCoverTheRoot) {
  for (const World& world : worlds()) {
    std::vector<MortonKey> keys;
    for (const SizeCube& cube : world.all().cubes) keys.push_back(cube.key);
    EXPECT_NO_THROW(LinearOctree{keys});
  }
}

// Never much above what it stands for, and seldom below: the surface is met to a percent.
TEST(SizeLeaf, InterpolatesTheDistanceFromTheSurface) {
  Random random(3);
  for (const World& world : worlds()) {
    const SizeField field(world.all());
    double most_above = 0, below = 0;
    int num_deep = 0;
    constexpr int kNum = 1500;
    int num = 0;
    while (num < kNum) {
      const Point p = uniform_in(random, bounding_box(world.mesh()));
      if (!is_inside(p, world.mesh())) {
        EXPECT_LE(field.at(p), 1.05 * world.law().surface);
        EXPECT_LE(field.least_depth(p), 0);
        continue;
      }
      ++num;
      const double depth = distance(p, world.mesh());
      EXPECT_LE(field.least_depth(p), depth);
      num_deep += field.least_depth(p) > 0;
      const double exact = world.law().at_distance(depth);
      most_above = std::max(most_above, field.at(p) / exact - 1);
      below += 1 - field.at(p) / exact;
    }
    EXPECT_LT(most_above, 0.03);
    EXPECT_LT(std::abs(below / kNum), 0.02);
    EXPECT_GT(num_deep, kNum / 50);
  }
}

TEST(SizeLeaf, CubesAreAsLargeAsTheLatticesCellsMayBe) {
  const double radius = std::sqrt(5.0) / 4;
  for (const World& world : worlds()) {
    const SizeField field(world.all());
    int num_halvable = 0, num_inside = 0;
    for (const SizeCube& cube : world.all().cubes) {
      if (std::ranges::any_of(cube.distance, [](float d) { return d < 0; })) continue;
      const Box box = world.frame().box(cube.key);
      const double side = box.max.x - box.min.x;
      ++num_inside;
      // At the centers of the cells' circumballs: on the cube's faces.
      for (int axis = 0; axis < 3; ++axis)
        for (const double face : {0.0, 1.0})
          for (const auto& [u, v] : {std::pair{0.25, 0.5}, {0.75, 0.5}, {0.5, 0.25}, {0.5, 0.75}}) {
            Point p = box.min;
            p[axis] += face * side * 0.999999;
            p[(axis + 1) % 3] += u * side;
            p[(axis + 2) % 3] += v * side;
            EXPECT_LT(radius * side, 1.03 * field.at(p));
          }
      num_halvable += field.at(box.center()) > 2.6 * radius * side * (1 + world.law().growth);
    }
    EXPECT_GT(num_inside, 100);
    EXPECT_EQ(num_halvable, 0) << "twice as large would do";
  }
}

// Cubes that touch differ by one level at most: what the lattice's cells between them rely on.
TEST(SizeLeaf, CubesInsideAreBalanced) {
  for (const World& world : worlds()) {
    const std::vector<SizeCube> cubes = world.all().cubes;
    std::vector<MortonKey> keys;
    for (const SizeCube& cube : cubes) keys.push_back(cube.key);
    const LinearOctree octree(keys);
    for (const SizeCube& cube : cubes) {
      if (std::ranges::any_of(cube.distance, [](float d) { return d < 0; })) continue;
      for (const MortonKey other :
           octree.leaves_within(world.frame(), world.frame().box(cube.key), 0))
        EXPECT_LE(other.level(), cube.key.level() + 1);
    }
  }
}

// Leaves find the same distances at the corners that they share.
TEST(SizeLeaf, LeavesAgreeOnTheirCorners) {
  for (const World& world : worlds()) {
    std::map<std::array<double, 3>, float> known;
    double largest = 0;
    for (const SizeCube& cube : world.all().cubes) {
      const Box box = world.frame().box(cube.key);
      for (std::size_t k = 0; k < 8; ++k) {
        const std::array corner{(k & 1 ? box.max : box.min).x, (k & 2 ? box.max : box.min).y,
                                (k & 4 ? box.max : box.min).z};
        const float d = cube.distance[k];
        const auto [place, is_new] = known.emplace(corner, d);
        if (!is_new && d > 0)
          largest = std::max<double>(largest, std::abs(place->second - d) /
                                                  world.law().at_distance(static_cast<double>(d)));
      }
    }
    EXPECT_LT(largest, 0.05);
  }
}

// Of all kinds, inside, across the surface and outside.
std::vector<SizeShape> some_shapes() {
  return {{ShapeKind::kBall, 0.03, {0.3, 0.2, 0.1}, {}, 0.15},
          {ShapeKind::kBall, 0.01, {1, 0, 0}, {}, 0},
          {ShapeKind::kBox, 0.04, {-0.5, -1.2, -0.1}, {-0.2, -0.8, 0.1}},
          {ShapeKind::kSegment, 0.02, {0, 0, 0.2}, {0.1, 0.2, 1.3}, 0},
          {ShapeKind::kBall, 0.05, {-0.6, 0.4, 0.1}, {}, 0.1}};
}

// Near shapes nothing is too large, for nothing would find that out; and little too small.
TEST(SizeLeaf, KeepsToTheSizesOfShapes) {
  Random random(5);
  const World world(icosphere({0, 0, 0}, 1, 3), 0.12, 0.2, 1, some_shapes());
  const SizeField field(world.all());
  double below = 0;
  int num = 0, num_small = 0;
  while (num < 3000) {
    const Point p = uniform_in(random, bounding_box(world.mesh()));
    if (!is_inside(p, world.mesh())) continue;
    ++num;
    const double of_shapes = size_from(some_shapes(), world.law().growth, p);
    const double of_surface = world.law().at_distance(distance(p, world.mesh()));
    EXPECT_LE(field.at(p), 1.002 * of_shapes) << p.x << ' ' << p.y << ' ' << p.z;
    EXPECT_LE(field.at(p), 1.03 * std::min(of_surface, of_shapes));
    EXPECT_GE(field.at(p), field.least());
    below += 1 - field.at(p) / std::min(of_surface, of_shapes);
    num_small += of_shapes < 0.7 * of_surface;
  }
  EXPECT_LT(below / num, 0.04);
  EXPECT_GT(num_small, num / 10);
  EXPECT_EQ(field.least(), 0.01);
}

TEST(SizeLeaf, FindsTheSizesOfManyShapesAsOfEachAlone) {
  Random random(6);
  std::vector<SizeShape> many;
  for (int n = 0; n < 40; ++n)
    many.push_back({ShapeKind::kBall,
                    0.03 + 0.01 * (n % 5),
                    uniform_in(random, {{-1, -1, -1}, {1, 1, 1}}),
                    {},
                    0.05 * (n % 3)});
  const World world(icosphere({0, 0, 0}, 1, 2), 0.2, 0.3, 0, many);
  const SizeField field(world.all());
  for (int n = 0; n < 1000; ++n) {
    const Point p = uniform_in(random, {{-0.6, -0.6, -0.6}, {0.6, 0.6, 0.6}});
    double exact = world.law().at_distance(distance(p, world.mesh()));
    for (const SizeShape& shape : many)
      exact = std::min(exact, shape.size + 0.3 * distance_to(shape, p));
    EXPECT_LE(field.at(p), 1.02 * exact);
    EXPECT_GE(field.at(p), 0.75 * exact);
  }
}

TEST(FarSurface, TellsHowFarTheSurfaceIs) {
  Random random(4);
  for (const World& world : worlds()) {
    const double part = world.leaf_side() / 16;
    int num = 0;
    double sum = 0;
    for (int i = 0; i < 2000; ++i) {
      const Point p = uniform_in(random, bounding_box(world.mesh()).expanded(0.5));
      const double exact = distance(p, world.mesh());
      if (exact < 2 * part) continue;
      const FarPoints around = world.far().around(Box::around(p));
      const double found = around.distance(p, 100);
      EXPECT_NEAR(found, exact, std::max(0.5 * part, 0.05 * exact));
      EXPECT_EQ(around.distance(p, 0.5 * exact), 0.5 * exact);
      ++num;
      sum += found / exact - 1;
    }
    EXPECT_NEAR(sum / num, 0, 0.03);
  }
}

// Leaves of several processes, each of which is told what it needs of the others'.
TEST(FarSurface, OfPartsIsThatOfTheWhole) {
  Random random(5);
  for (const World& world : worlds()) {
    const std::span<const MortonKey> leaves = world.octree().leaves();
    constexpr std::size_t kNumParts = 3;
    std::vector<FarSurface> parts(kNumParts, FarSurface(world.frame()));
    std::vector<std::vector<Box>> places(kNumParts);
    for (std::size_t i = 0; i < leaves.size(); ++i) {
      const std::size_t part = i * kNumParts / leaves.size();
      places[part].push_back(world.frame().box(leaves[i]));
      if (const LeafSurface met = world.surface_in(leaves[i]); !met.is_empty())
        parts[part].add(leaves[i], met);
    }
    for (FarSurface& part : parts) part.finish();
    std::vector<FarSurface> whole = parts;
    std::size_t num_told = 0;
    for (std::size_t to = 0; to < kNumParts; ++to)
      for (std::size_t from = 0; from < kNumParts; ++from) {
        if (from == to) continue;
        const std::vector<FarPoint> told = parts[from].seen_from(places[to]);
        num_told += told.size();
        whole[to].add_told(told);
      }
    EXPECT_GT(num_told, 100U);
    for (std::size_t part = 0; part < kNumParts; ++part)
      for (const Box& place : places[part]) {
        const FarPoints expected = world.far().around(place), found = whole[part].around(place);
        ASSERT_EQ(found.size(), expected.size());
        for (int n = 0; n < 10; ++n) {
          const Point p = uniform_in(random, place);
          EXPECT_EQ(found.distance(p, 100), expected.distance(p, 100));
        }
      }
  }
}

}  // namespace
}  // namespace locvol
