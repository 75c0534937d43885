#include "refine/point_cubes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <vector>

#include "tests/refine/shapes.h"

namespace locvol {
namespace {

using shapes::Random;
using shapes::uniform;
using shapes::uniform_in;

// Some of the points come later, and some places lie outside of the box.
TEST(PointCubes, TellsHowFarTheNearestPointIs) {
  const auto seed = std::random_device()();
  Random random(seed);
  const Box box{{0, 0, 0}, {2, 1, 1}};
  for (const std::size_t num : {0, 1, 30, 500}) {
    std::vector<Point> points;
    for (std::size_t n = 0; n < num; ++n) points.push_back(uniform_in(random, box));
    PointCubes cubes(box, 0.15, 128, points);
    for (std::size_t n = 0; n < num / 10; ++n) {
      points.push_back(uniform_in(random, box));
      cubes.add(points.back());
    }
    for (int n = 0; n < 300; ++n) {
      const Point p = uniform_in(random, box.expanded(0.3));
      const double most = uniform(random, 0, 0.5), least = uniform(random, 0, most);
      double expected = most * most;
      for (const Point& q : points) expected = std::min(expected, squared_distance(p, q));
      const double squared = cubes.squared_clearance(p, least, most);
      if (expected >= least * least)
        EXPECT_EQ(squared, expected) << "seed " << seed;
      else
        EXPECT_LT(squared, least * least) << "seed " << seed;
      EXPECT_EQ(cubes.is_free(p, most), expected == most * most) << "seed " << seed;
    }
  }
}

}  // namespace
}  // namespace locvol
