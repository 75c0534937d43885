#include "engine/run/leaf_sides.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "refine/domain/leaf_domain.h"
#include "tests/engine/closed_shapes.h"

namespace locvol {
namespace {

using namespace testing_shapes;

// Parity of crossings of a ray in a direction that hits no edge.
bool is_inside_by_ray(const std::vector<Triangle>& soup, const Point& p) {
  const Point direction{0.5772156649, 0.3141592653, 0.7537293104};
  bool is_inside = false;
  for (const Triangle& t : soup) {
    const auto& [a, b, c] = t.corners;
    const auto sign = [&](const Point& u, const Point& v) {
      return dot(cross(u - p, v - p), direction) > 0;
    };
    const bool is_hit_by_line = sign(a, b) == sign(b, c) && sign(b, c) == sign(c, a);
    const Point n = cross(b - a, c - a);
    if (is_hit_by_line && dot(n, a - p) / dot(n, direction) > 0) is_inside = !is_inside;
  }
  return is_inside;
}

std::uint8_t parities_of(const std::vector<Triangle>& soup, const Box& box) {
  std::vector<Triangle> met;
  std::ranges::copy_if(soup, std::back_inserter(met),
                       [&](const Triangle& t) { return meets(t, box); });
  return center_to_corner_parities(met, box);
}

std::vector<std::uint8_t> all_parities(const LinearOctree& octree, const Frame& frame,
                                       const std::vector<Triangle>& soup) {
  std::vector<std::uint8_t> parities;
  for (const MortonKey leaf : octree.leaves())
    parities.push_back(parities_of(soup, frame.box(leaf)));
  return parities;
}

TEST(LeafSides, AgreeWithRaysOnOctreesOfMixedLevels) {
  const std::uint64_t seed = std::random_device{}();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937_64 random(seed);
  // A ball in a torus' hole, and a cavity in the ball.
  const auto soup =
      together(torus(1, 0.35, 24, 12), together(sphere(0.5, 9, 16), sphere(0.25, 5, 9))).soup();
  const Frame frame({-1.53, -1.49, -1.51}, 3.07 / (1 << MortonKey::kMaxLevel));
  LinearOctree octree = LinearOctree::uniform(3);
  for (int i = 0; i < 150; ++i) {
    const MortonKey leaf = octree.leaves()[random() % octree.size()];
    if (leaf.level() < 5) octree.split(leaf);
  }
  const auto sides = center_sides(octree, all_parities(octree, frame, soup));
  int num_inside = 0;
  for (std::size_t i = 0; i < octree.size(); ++i) {
    const Point center = frame.box(octree.leaves()[i]).center();
    EXPECT_EQ(sides[i], is_inside_by_ray(soup, center)) << "leaf " << i;
    num_inside += sides[i];
  }
  EXPECT_GT(num_inside, 20);
}

TEST(LeafSides, OfChildrenFollowFromTheirParent) {
  const auto soup = torus(1, 0.35, 24, 12).soup();
  const Frame frame({-1.53, -1.49, -1.51}, 3.07 / (1 << MortonKey::kMaxLevel));
  const LinearOctree octree = LinearOctree::uniform(2);
  int num_inside = 0;
  for (const MortonKey parent : octree.leaves()) {
    std::array<std::uint8_t, 8> parities{};
    for (int c = 0; c < 8; ++c)
      parities[static_cast<std::size_t>(c)] = parities_of(soup, frame.box(parent.child(c)));
    const auto sides =
        center_sides_of_children(is_inside_by_ray(soup, frame.box(parent).center()), parities);
    for (int c = 0; c < 8; ++c) {
      const auto i = static_cast<std::size_t>(c);
      EXPECT_EQ(sides[i], is_inside_by_ray(soup, frame.box(parent.child(c)).center()));
      num_inside += sides[i];
    }
  }
  EXPECT_GT(num_inside, 20);
}

}  // namespace
}  // namespace locvol
