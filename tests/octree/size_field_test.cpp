#include "octree/size_field.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <span>
#include <vector>

#include "octree/near_cubes.h"
#include "octree/octree.h"

namespace locvol {
namespace {

const Frame kPlaneFrame({-1, -2, 3}, 0x1p-18);  // a root of side 8

Point random_point(std::mt19937_64& random, const Box& box) {
  Point p;
  for (int axis = 0; axis < 3; ++axis)
    p[axis] = std::uniform_real_distribution<double>(box.min[axis], box.max[axis])(random);
  return p;
}

// Cubes of several levels whose corners have the distance to a plane, which is linear.
SizeCubes cubes_at_a_plane(const Point& normal, double offset) {
  LinearOctree octree = LinearOctree::uniform(2);
  octree.split(octree.leaves()[5]);
  octree.split(octree.leaves()[7]);
  SizeCubes sizes{.law = {.surface = 0.5, .growth = 0.2}, .frame = kPlaneFrame, .cubes = {}};
  for (const MortonKey key : octree.leaves()) {
    SizeCube cube{.key = key};
    const Box box = kPlaneFrame.box(key);
    for (std::size_t k = 0; k < 8; ++k) {
      const Point corner{(k & 1 ? box.max : box.min).x, (k & 2 ? box.max : box.min).y,
                         (k & 4 ? box.max : box.min).z};
      cube.distance[k] = static_cast<float>(dot(normal, corner) - offset);
    }
    sizes.cubes.push_back(cube);
  }
  return sizes;
}

TEST(SizeField, IsTheSameEverywhereUnlessItGrows) {
  const SizeField field(0.25);
  EXPECT_TRUE(field.is_uniform());
  EXPECT_EQ(field.at({3, 4, 5}), 0.25);
  EXPECT_EQ(field.reach_of_balls({0, 0, 0}, 2.25), 2.25 * 0.25);
  EXPECT_EQ(field.largest(), 0.25);
}

TEST(SizeField, GrowsWithTheDistanceFromAPlaneAndNotOutside) {
  const Point normal = 1 / std::sqrt(14.0) * Point{1, 2, 3};
  const double offset = dot(normal, kPlaneFrame.root_box().center());
  const SizeCubes sizes = cubes_at_a_plane(normal, offset);
  const SizeField field(sizes);
  std::mt19937_64 random(7);
  for (int i = 0; i < 2000; ++i) {
    const Point p = random_point(random, kPlaneFrame.root_box());
    const double depth = dot(normal, p) - offset;
    const double expected = 0.5 + 0.2 * std::max(0.0, depth);
    EXPECT_NEAR(field.at(p), expected, 1e-5);
    EXPECT_NEAR(size_at(sizes.law, sizes.frame, sizes.cubes, p), field.at(p), 1e-12);
    EXPECT_LE(field.at(p), field.largest());
  }
}

// Of cubes in a row of sizes that lie anywhere, some missing.
TEST(SizeField, FindsTheSameCubesAsASearch) {
  std::mt19937_64 random(9);
  const SizeCubes all = cubes_at_a_plane({0.6, 0, 0.8}, 2);
  for (int round = 0; round < 20; ++round) {
    SizeCubes some = all;
    std::erase_if(some.cubes, [&](const SizeCube&) { return random() % 3 == 0; });
    const SizeField field(some);
    for (int i = 0; i < 300; ++i) {
      const Point p = random_point(random, kPlaneFrame.root_box().expanded(0.1));
      EXPECT_NEAR(field.at(p), size_at(some.law, some.frame, some.cubes, p), 1e-12);
      const double h = field.at(p);
      EXPECT_TRUE(field.is_below(0.999 * h * h, 1, p));
      EXPECT_FALSE(field.is_below(1.001 * h * h, 1, p));
    }
  }
}

// All that are near come in order, and of a box in a corner of the root not many others.
TEST(NearCubes, AreAllThatAreNear) {
  std::mt19937_64 random(13);
  const SizeCubes all = cubes_at_a_plane({0.6, 0, 0.8}, 2);
  const Box root = kPlaneFrame.root_box();
  for (int round = 0; round < 100; ++round) {
    const Box box = Box::around(random_point(random, root)).expanded(0.1);
    const double distance = std::uniform_real_distribution<double>(0, 3)(random);
    std::vector<MortonKey> visited, near;
    for_each_cube_near(kPlaneFrame, MortonKey::root(), all.cubes, box, distance,
                       [&](const SizeCube& cube) { visited.push_back(cube.key); });
    for (const SizeCube& cube : all.cubes)
      if (box.squared_distance(kPlaneFrame.box(cube.key)) <= distance * distance)
        near.push_back(cube.key);
    EXPECT_TRUE(std::ranges::is_sorted(visited));
    EXPECT_TRUE(std::ranges::includes(visited, near));
  }
  std::size_t num_visited = 0;
  for_each_cube_near(kPlaneFrame, MortonKey::root(), all.cubes, Box::around(root.min), 0.1,
                     [&](const SizeCube&) { ++num_visited; });
  EXPECT_LE(num_visited, all.cubes.size() / 4);
}

// A leaf may be smaller than the cube that it lies in.
TEST(NearCubes, MayLieAroundTheNode) {
  const SizeCubes all = cubes_at_a_plane({0.6, 0, 0.8}, 2);
  const MortonKey leaf = all.cubes[3].key.child(2).child(5);
  int num_visited = 0;
  for_each_cube_near(kPlaneFrame, leaf, std::span(all.cubes).subspan(3, 1), kPlaneFrame.box(leaf),
                     0, [&](const SizeCube&) { ++num_visited; });
  EXPECT_EQ(num_visited, 1);
}

TEST(SizeField, StopsAtItsBound) {
  SizeCubes sizes = cubes_at_a_plane({0, 0, 1}, 3);
  sizes.law.most = 0.75;
  const SizeField field(sizes);
  EXPECT_EQ(field.at({1, 1, 10.5}), 0.75);
  EXPECT_EQ(field.largest(), 0.75);
  EXPECT_NEAR(field.at({1, 1, 3.5}), 0.6, 1e-6);
}

// What h would be if it grew on, over its bound.
TEST(SizeField, HasRoomWhereItIsBounded) {
  std::mt19937_64 random(5);
  SizeCubes sizes = cubes_at_a_plane({0.6, 0, 0.8}, 3);
  sizes.law.most = 0.9, sizes.law.least = 0.1;
  for (SizeCube& cube : sizes.cubes) cube.less.fill(0.05F);
  ASSERT_TRUE(sizes.law.has_core());
  const SizeField field(sizes);
  const double of_one = sizes.law.growth * sizes.law.most;
  int num_in_core = 0;
  for (int i = 0; i < 2000; ++i) {
    const Point p = random_point(random, kPlaneFrame.root_box());
    const double room = field.room(p), at = field.at(p);
    if (room >= 0) {
      EXPECT_EQ(at, sizes.law.most);
    } else if (room > -0.3) {
      EXPECT_NEAR(at, sizes.law.most + room, 1e-9);
    }
    const auto cube = std::ranges::find_if(sizes.cubes, [&](const SizeCube& c) {
      return c.key.is_ancestor_or_self_of(kPlaneFrame.key_of(p));
    });
    ASSERT_NE(cube, sizes.cubes.end());
    if (!is_of_core(sizes.law, *cube)) continue;
    ++num_in_core;
    EXPECT_GE(room, kCoreMargin * of_one - 1e-6);
  }
  EXPECT_GT(num_in_core, 100);
  sizes.law.most = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(sizes.law.has_core());
  EXPECT_FALSE(is_of_core(sizes.law, sizes.cubes.back()));
}

TEST(SizeField, IsSmallestWhereNothingIsKnown) {
  SizeCubes sizes = cubes_at_a_plane({0, 0, 1}, 3);
  sizes.cubes.erase(sizes.cubes.begin() + 10, sizes.cubes.end() - 3);
  const Point unknown = kPlaneFrame.box(LinearOctree::uniform(2).leaves()[20]).center();
  EXPECT_EQ(SizeField(sizes).at(unknown), 0.5);
  EXPECT_EQ(SizeField(sizes).at({-100, 0, 0}), 0.5);
  EXPECT_FALSE(SizeField(sizes).has(unknown));
  EXPECT_FALSE(SizeField(sizes).has({-100, 0, 0}));
  EXPECT_TRUE(SizeField(sizes).has(kPlaneFrame.box(sizes.cubes.back().key).center()));
  EXPECT_TRUE(SizeField(0.25).has(unknown));
}

TEST(SizeField, ExcessIsTakenOff) {
  SizeCubes sizes = cubes_at_a_plane({0, 0, 1}, 3);
  const Point p{1, 1, 5.3};
  const double before = SizeField(sizes).at(p);
  for (SizeCube& cube : sizes.cubes) cube.excess = 0.5F;
  EXPECT_NEAR(SizeField(sizes).at(p), before - 0.2 * 0.5, 1e-6);
}

// A ball through p whose radius is k / 2 times h at its center lies within the reach of p.
TEST(SizeField, BallsStayWithinReach) {
  const SizeField field(cubes_at_a_plane({0, 0, 1}, 3));
  std::mt19937_64 random(8);
  for (int i = 0; i < 2000; ++i) {
    const Point center = random_point(random, kPlaneFrame.root_box());
    const double k = 2.25, radius = 0.5 * k * field.at(center);
    Point way = random_point(random, {{-1, -1, -1}, {1, 1, 1}});
    const Point p = center + radius / norm(way) * way;
    if (!kPlaneFrame.contains(p)) continue;
    EXPECT_LE(2 * radius, field.reach_of_balls(p, k) * (1 + 1e-6));
  }
}

}  // namespace
}  // namespace locvol
