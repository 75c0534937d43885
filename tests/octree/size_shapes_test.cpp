#include "octree/size_shapes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/octree/random_places.h"

namespace locvol {
namespace {

class SizeShapes : public testing::Test, protected RandomPlaces {
 protected:
  SizeShapes() : RandomPlaces(11) {}

  SizeShape shape() {
    const Point a = point(kFrame.root_box()), b = point(kFrame.root_box());
    const auto kind = static_cast<ShapeKind>(bits() % 3);
    const double size = uniform(0.01, 0.5);
    if (kind == ShapeKind::kBall) return {kind, size, a, {}, uniform(0, 1)};
    if (kind == ShapeKind::kSegment) return {kind, size, a, b};
    const Box box = Box::around(a).joined(b);
    return {kind, size, box.min, box.max};
  }
  std::vector<SizeShape> shapes(int num) {
    std::vector<SizeShape> some;
    while (num-- > 0) some.push_back(shape());
    return some;
  }
};

TEST_F(SizeShapes, DistancesOfClosedForm) {
  const SizeShape ball{ShapeKind::kBall, 1, {1, 2, 3}, {}, 2};
  EXPECT_DOUBLE_EQ(distance_to(ball, {1, 2, 8}), 3);
  EXPECT_EQ(distance_to(ball, {1, 3, 3}), 0);
  const SizeShape box{ShapeKind::kBox, 1, {0, 0, 0}, {1, 2, 3}};
  EXPECT_DOUBLE_EQ(distance_to(box, {4, 6, 1}), 5);
  EXPECT_EQ(distance_to(box, {0.5, 2, 3}), 0);
  const SizeShape segment{ShapeKind::kSegment, 1, {0, 0, 0}, {10, 0, 0}};
  EXPECT_DOUBLE_EQ(distance_to(segment, {5, 3, 4}), 5);
  EXPECT_DOUBLE_EQ(distance_to(segment, {-3, 0, 4}), 5);
  EXPECT_DOUBLE_EQ(distance_to(segment, {13, 4, 0}), 5);
  const SizeShape end{ShapeKind::kSegment, 1, {1, 1, 1}, {1, 1, 1}};
  EXPECT_DOUBLE_EQ(distance_to(end, {1, 1, 3}), 2);
}

TEST_F(SizeShapes, BoundsHoldInTheBox) {
  for (int n = 0; n < 200; ++n) {
    const std::vector<SizeShape> some = shapes(5);
    const Box box = Box::around(point(kFrame.root_box())).joined(point(kFrame.root_box()));
    const SizeBounds bounds = size_bounds(some, 0.2, box);
    for (int i = 0; i < 50; ++i) {
      const double size = size_from(some, 0.2, point(box));
      EXPECT_LE(bounds.least, size);
      EXPECT_GE(bounds.most, size);
    }
  }
}

TEST_F(SizeShapes, ThoseOfANodeAreAllThatMatterInIt) {
  const std::vector<SizeShape> some = shapes(200);
  ShapesOfNodes of_nodes(some, 0.2, kFrame);
  std::size_t most = 0;
  for (int n = 0; n < 300; ++n) {
    const MortonKey node = kFrame.key_of(point(kFrame.root_box()), static_cast<int>(bits() % 12));
    const auto near = of_nodes.in(node);
    if (node.level() > 8) most = std::max(most, near.size());
    for (int i = 0; i < 20; ++i) {
      const Point p = point(kFrame.box(node));
      EXPECT_EQ(size_from(near, 0.2, p), size_from(some, 0.2, p));
    }
  }
  EXPECT_LT(most, 40U);
  EXPECT_TRUE(ShapesOfNodes({}, 0.2, kFrame).in(MortonKey::root()).empty());
}

}  // namespace
}  // namespace locvol
