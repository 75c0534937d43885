#include "engine/run/leaf_states.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "refine/domain/surface_part.h"
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

CornerStates corners_of(const LeafSurface& surface, const Box& box) {
  return center_to_corners(box, part_in(box, surface));
}

std::vector<CornerStates> corners_of_all(const LinearOctree& octree, const Frame& frame,
                                         const LeafSurface& surface) {
  std::vector<CornerStates> corners;
  for (const MortonKey leaf : octree.leaves())
    corners.push_back(corners_of(surface, frame.box(leaf)));
  return corners;
}

BodyId body_by_ray(const LeafSurface& surface, const Point& p) {
  return is_inside_by_ray(surface.triangles, p) ? kOnlyBody : kNoBody;
}

TEST(LeafStates, AgreeWithRaysOnOctreesOfMixedLevels) {
  const std::uint64_t seed = std::random_device{}();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937_64 random(seed);
  // A ball in a torus' hole, and a cavity in the ball.
  const LeafSurface surface{
      together(torus(1, 0.35, 24, 12), together(sphere(0.5, 9, 16), sphere(0.25, 5, 9))).soup()};
  const Frame frame({-1.53, -1.49, -1.51}, 3.07 / (1 << MortonKey::kMaxLevel));
  LinearOctree octree = LinearOctree::uniform(3);
  for (int i = 0; i < 150; ++i) {
    const MortonKey leaf = octree.leaves()[random() % octree.size()];
    if (leaf.level() < 5) octree.split(leaf);
  }
  const auto states = center_states(octree, corners_of_all(octree, frame, surface));
  int num_inside = 0;
  for (std::size_t i = 0; i < octree.size(); ++i) {
    const Point center = frame.box(octree.leaves()[i]).center();
    EXPECT_EQ(states[i].body(), body_by_ray(surface, center)) << "leaf " << i;
    num_inside += states[i] != DomainState();
  }
  EXPECT_GT(num_inside, 20);
}

TEST(LeafStates, OfChildrenFollowFromTheirParent) {
  const LeafSurface surface{torus(1, 0.35, 24, 12).soup()};
  const Frame frame({-1.53, -1.49, -1.51}, 3.07 / (1 << MortonKey::kMaxLevel));
  const LinearOctree octree = LinearOctree::uniform(2);
  int num_inside = 0;
  for (const MortonKey parent : octree.leaves()) {
    std::array<CornerStates, 8> corners;
    for (int c = 0; c < 8; ++c)
      corners[static_cast<std::size_t>(c)] = corners_of(surface, frame.box(parent.child(c)));
    const auto states = center_states_of_children(
        DomainState::in(body_by_ray(surface, frame.box(parent).center())), corners);
    for (int c = 0; c < 8; ++c) {
      const auto i = static_cast<std::size_t>(c);
      EXPECT_EQ(states[i].body(), body_by_ray(surface, frame.box(parent.child(c)).center()));
      num_inside += states[i] != DomainState();
    }
  }
  EXPECT_GT(num_inside, 20);
}

}  // namespace
}  // namespace locvol
