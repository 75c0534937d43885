#include "refine/domain/box_tree.h"

#include <gtest/gtest.h>

#include <limits>
#include <set>

#include "tests/refine/shapes.h"

namespace locvol {
namespace {

using namespace shapes;

std::vector<Box> random_boxes(Random& random, std::size_t num) {
  std::vector<Box> boxes;
  const Box all{{0, 0, 0}, {4, 2, 1}};
  for (std::size_t n = 0; n < num; ++n) {
    const Point p = uniform_in(random, all);
    boxes.push_back(Box::around(p).joined(p + 0.1 * uniform_in(random, all)));
  }
  return boxes;
}

TEST(BoxTree, VisitsAllThatAreWithinADistance) {
  Random random(11);
  for (const std::size_t num : {0, 1, 4, 5, 33, 1000}) {
    const std::vector<Box> boxes = random_boxes(random, num);
    const BoxTree tree(boxes);
    for (int i = 0; i < 100; ++i) {
      const Point p = uniform_in(random, {{-1, -1, -1}, {5, 3, 2}});
      double squared = 0.7;
      std::set<std::uint32_t> visited, within;
      tree.for_each_within(
          p, squared, [&](std::uint32_t n) { EXPECT_TRUE(visited.insert(n).second) << "twice"; });
      for (std::uint32_t n = 0; n < num; ++n)
        if (boxes[n].squared_distance(p) < squared) within.insert(n);
      EXPECT_EQ(visited, within);
    }
  }
}

TEST(BoxTree, FindsTheNearestInFewVisits) {
  Random random(12);
  const std::vector<Box> boxes = random_boxes(random, 4000);
  const BoxTree tree(boxes);
  constexpr int kNum = 200;
  int num_visits = 0;
  for (int i = 0; i < kNum; ++i) {
    const Point p = uniform_in(random, {{-1, -1, -1}, {5, 3, 2}});
    double squared = std::numeric_limits<double>::infinity(), least = squared;
    tree.for_each_within(p, squared, [&](std::uint32_t n) {
      ++num_visits;
      squared = std::min(squared, boxes[n].squared_distance(p));
    });
    for (const Box& box : boxes) least = std::min(least, box.squared_distance(p));
    EXPECT_EQ(squared, least);
  }
  EXPECT_LT(num_visits, 40 * kNum);
}

}  // namespace
}  // namespace locvol
