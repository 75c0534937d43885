#include "octree/size_nodes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "tests/octree/random_places.h"

namespace locvol {
namespace {

constexpr double kGrowth = 0.2;

class SizeNodesTest : public testing::Test, protected RandomPlaces {
 protected:
  SizeNodesTest() : RandomPlaces(5) {}

  // Of levels from 2 to 8: many lie in others.
  std::vector<SizedNode> nodes(int num) {
    std::vector<SizedNode> some;
    for (; num > 0; --num)
      some.push_back({kFrame.key_of(point({{-3, -3, -3}, {1, 3, 3}}), int(2 + bits() % 7)),
                      static_cast<float>(std::exp(uniform(-4, 0)))});
    unite(some);
    return some;
  }
  static double brute_force(const std::vector<SizedNode>& nodes, const Point& p) {
    double least = std::numeric_limits<double>::infinity();
    for (const SizedNode& n : nodes)
      least = std::min(least, static_cast<double>(n.size) +
                                  kGrowth * std::sqrt(kFrame.box(n.key).squared_distance(p)));
    return least;
  }
};

TEST_F(SizeNodesTest, UnitedNodesKeepTheLeastOfTheirSizes) {
  const MortonKey a = MortonKey::root().child(3), b = a.child(1);
  std::vector<SizedNode> some{{b, 2}, {a, 3}, {b, 1}, {a, 4}};
  unite(some);
  ASSERT_EQ(some.size(), 2U);
  for (const SizedNode& node : some) EXPECT_EQ(node.size, node.key == a ? 3 : 1);
}

// From the root down to small boxes, with what is found near each taken to the next.
TEST_F(SizeNodesTest, WhatIsFoundOnTheWayDownAsksForTheSameAsAllOfThem) {
  for (const int num : {1, 2, 30, 2000}) {
    const std::vector<SizedNode> all = nodes(num);
    const SizeNodes tree(all, kGrowth, kFrame);
    for (int i = 0; i < 20; ++i) {
      const Point end = point(kFrame.root_box());
      SizeNodes::Branches branches = tree.all(), near;
      for (int level = 0; level <= 10; ++level) {
        const Box box = kFrame.box(kFrame.key_of(end, level));
        double most = std::numeric_limits<double>::infinity();
        tree.find_near(branches, box, most, near);
        std::swap(branches, near);
        for (int k = 0; k < 5; ++k) {
          const Point p = point(box);
          const double expected = brute_force(all, p);
          EXPECT_LE(expected, most * (1 + 1e-12));
          EXPECT_NEAR(tree.size_at(branches, p, 1e9), expected, 1e-12);
          EXPECT_EQ(tree.size_at(branches, p, 0.5 * expected), 0.5 * expected);
        }
        for (const Point& corner : {box.min, box.max})
          EXPECT_NEAR(tree.size_at(branches, corner, 1e9), brute_force(all, corner), 1e-12);
      }
      if (num >= 30) {
        EXPECT_LT(branches.size(), all.size());
      }
    }
  }
}

TEST_F(SizeNodesTest, BranchesThatAskForMoreThanIsAllowedGo) {
  const SizeNodes tree(nodes(100), kGrowth, kFrame);
  SizeNodes::Branches near;
  double most = 1e-3;
  tree.find_near(tree.all(), kFrame.box(MortonKey::root().child(7).child(7)), most, near);
  EXPECT_TRUE(near.empty());
  EXPECT_EQ(most, 1e-3);
  EXPECT_TRUE(SizeNodes({}, kGrowth, kFrame).is_empty());
}

}  // namespace
}  // namespace locvol
