#include "refine/measure_leaf.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>

#include "octree/octree.h"
#include "tests/refine/brute_force.h"
#include "tests/refine/domain_pieces.h"
#include "tests/refine/shapes.h"

namespace locvol {
namespace {

using namespace shapes;

constexpr double kPi = std::numbers::pi;

// A surface in leaves of one level.
class Part {
 public:
  Part(Mesh mesh, double size, int level)
      : mesh_(std::move(mesh)),
        size_(size),
        frame_(Frame::around(bounding_box(mesh_), size, 1.75 * size)),
        octree_(LinearOctree::uniform(level)) {}

  std::vector<SizedNode> measured(const SizeRules& rules) const {
    std::vector<SizedNode> all;
    for (const MortonKey leaf : octree_.leaves()) {
      const Box region = frame_.box(leaf).expanded(measure_reach(rules, size_));
      const std::vector<SizedNode> some =
          measure_leaf({rules, size_, frame_, leaf, piece_around(region, mesh_)});
      for (const SizedNode& node : some) {
        EXPECT_TRUE(leaf.is_ancestor_or_self_of(node.key));
        EXPECT_LT(node.size, size_);
        EXPECT_GE(node.size, static_cast<float>(rules.least));
      }
      all.insert(all.end(), some.begin(), some.end());
    }
    return all;
  }
  Box box(const SizedNode& node) const { return frame_.box(node.key); }
  double side(const SizedNode& node) const { return frame_.side(node.key.level()); }
  const Mesh& mesh() const { return mesh_; }

 private:
  Mesh mesh_;
  double size_;
  Frame frame_;
  LinearOctree octree_;
};

// Share of the nodes whose size is within a tenth of what is expected around them.
double share_of_expected(const Part& part, const std::vector<SizedNode>& nodes, double low,
                         double high) {
  const auto num = std::ranges::count_if(
      nodes, [&](const SizedNode& n) { return n.size > 0.9 * low && n.size < 1.1 * high; });
  for (const SizedNode& n : nodes) EXPECT_LT(part.side(n), 2.01 * n.size);
  return static_cast<double>(num) / static_cast<double>(std::max<std::size_t>(nodes.size(), 1));
}

// Every place of the surface lies in a node, or close to one.
double farthest_from_nodes(const Part& part, const std::vector<SizedNode>& nodes) {
  double farthest = 0;
  for (std::size_t n = 0; n < part.mesh().size(); n += 17) {
    const auto& [a, b, c] = part.mesh()[n].corners;
    const Point p = 1.0 / 3 * (a + b + c);
    double nearest = 1e9;
    for (const SizedNode& node : nodes)
      nearest = std::min(nearest, part.box(node).squared_distance(p));
    farthest = std::max(farthest, std::sqrt(nearest));
  }
  return farthest;
}

TEST(MeasureLeaf, AsksForEdgesAroundCirclesOfASphere) {
  const Part sphere(icosphere({0.1, 0, 0}, 1, 5), 0.5, 2);
  for (const double num : {16.0, 30.0}) {
    const auto nodes = sphere.measured({.per_circle = num, .least = 0.02});
    const double expected = 2 * kPi / (1.15 * num);
    EXPECT_GT(share_of_expected(sphere, nodes, expected, expected), 0.95) << num;
    EXPECT_LT(farthest_from_nodes(sphere, nodes), 0.5 * expected);
  }
  EXPECT_TRUE(sphere.measured({.per_circle = 8, .least = 0.02}).empty());  // 0.5 is enough
}

// A facet in a ball of radius s on a sphere of radius R is s²/2R off.
TEST(MeasureLeaf, AsksForFacetsThatDeviateLessFromASphere) {
  const Part sphere(icosphere({0.1, 0, 0}, 1, 5), 0.5, 2);
  for (const double deviation : {0.02, 0.003}) {
    const auto nodes = sphere.measured({.deviation = deviation, .least = 0.02});
    const double most = std::sqrt(2 * deviation);
    EXPECT_GT(share_of_expected(sphere, nodes, 0.85 * most, most), 0.95) << deviation;
    EXPECT_LT(farthest_from_nodes(sphere, nodes), 0.5 * most);
  }
}

// The larger curvature counts.
TEST(MeasureLeaf, AsksForTheSmallerCircleOfATorus) {
  const Part ring(torus(1, 0.25, 160, 40), 0.3, 2);
  const auto nodes = ring.measured({.per_circle = 24, .least = 0.01});
  const double expected = 2 * kPi * 0.25 / (1.15 * 24);
  EXPECT_GT(share_of_expected(ring, nodes, expected, expected), 0.95);
}

TEST(MeasureLeaf, AsksForNothingWhereTheSurfaceIsFlatButAtEdges) {
  const Box unit{{0, 0, 0}, {1, 0.9, 0.8}};
  const Part block(box(unit), 0.3, 2);
  EXPECT_TRUE(block.measured({.per_circle = 100, .least = 0.01}).empty());
  const auto nodes = block.measured({.deviation = 0.05, .least = 0.01});
  const double most = 0.05 / std::sin(kPi / 4);
  EXPECT_GT(share_of_expected(block, nodes, 0.75 * most, most), 0.99);
  for (const SizedNode& node : nodes) {  // each at one of the twelve edges
    const Box at = block.box(node);
    int num_planes = 0;
    for (const int axis : {0, 1, 2})
      num_planes += (at.min[axis] <= unit.min[axis] && at.max[axis] >= unit.min[axis]) ||
                    (at.min[axis] <= unit.max[axis] && at.max[axis] >= unit.max[axis]);
    EXPECT_GE(num_planes, 2);
  }
}

// A prism with a tip of that angle along the z axis, or with a groove of it.
Mesh tipped(double degrees, double length, bool is_groove) {
  const double half = 0.5 * kPi / 180 * degrees, x = std::cos(half), y = std::sin(half);
  std::vector<Point> section{{0, 0, 0}, {x, -y, 0}, {x, y, 0}};
  if (is_groove)
    section = {{0, 0, 0}, {x, y, 0}, {x, 1, 0}, {-1, 1, 0}, {-1, -1, 0}, {x, -1, 0}, {x, -y, 0}};
  const Point up{0, 0, length};
  std::vector<std::array<Point, 3>> all;
  for (std::size_t n = 0; n < section.size(); ++n) {
    const Point a = section[n], b = section[(n + 1) % section.size()];
    all.push_back({a, b, b + up});
    all.push_back({a, b + up, a + up});
    if (n == 0 || n + 1 == section.size()) continue;
    all.push_back({section[0], b, a});
    all.push_back({section[0] + up, a + up, b + up});
  }
  return numbered(all);
}

// Of the nodes at the z axis, away from its ends.
double least_at_axis(const Part& part, const std::vector<SizedNode>& nodes, double length) {
  double least = 1e9;
  for (const SizedNode& node : nodes) {
    const Box box = part.box(node);
    if (box.squared_distance(Point{0, 0, box.center().z}) > 0) continue;
    if (box.min.z > 0.4 * length && box.max.z < 0.6 * length)
      least = std::min<double>(least, node.size);
  }
  return least;
}

// What C3 and C4 leave of a tip ends where its sheets are a spacing floor apart: measured, at most
// 0.23, 0.12, 0.1 and 0.13 sizes are cut off at 5°, 10°, 15° and 20°. A facet cuts off up to the
// cosine of half the angle, which is what a groove asks for.
TEST(MeasureLeaf, AsksForNoMoreAtATipThanItTakes) {
  const double deviation = 0.01, length = 2;
  for (const auto& [degrees, cut] :
       {std::pair(5.0, 0.23), {10.0, 0.12}, {15.0, 0.1}, {20.0, 0.13}}) {
    const Part tip(tipped(degrees, length, false), 0.2, 1);
    const double size =
        least_at_axis(tip, tip.measured({.deviation = deviation, .least = 0.002}), length);
    EXPECT_GT(size, 3 * deviation) << degrees;
    EXPECT_LT(size, deviation / cut) << degrees;
    const Part groove(tipped(degrees, length, true), 0.2, 1);
    EXPECT_LT(
        least_at_axis(groove, groove.measured({.deviation = deviation, .least = 0.002}), length),
        1.02 * deviation)
        << degrees;
  }
  // With a larger spacing floor more is cut off.
  const Part tip(tipped(10, length, false), 0.2, 1);
  const auto nodes = tip.measured({.deviation = deviation, .least = 0.002, .spacing_floor = 0.06});
  EXPECT_LT(least_at_axis(tip, nodes, length), deviation / 0.34);
}

Mesh cone(double half_angle_degrees) {
  constexpr int kSides = 64;
  const Point apex{0, 0, 0}, base{0, 0, -1};
  const double radius = std::tan(kPi / 180 * half_angle_degrees);
  const auto at = [&](int n) {
    return Point{radius * std::cos(2 * kPi * n / kSides), radius * std::sin(2 * kPi * n / kSides),
                 -1};
  };
  std::vector<std::array<Point, 3>> all;
  for (int n = 0; n < kSides; ++n) {
    all.push_back({apex, at(n), at((n + 1) % kSides)});
    all.push_back({base, at((n + 1) % kSides), at(n)});
  }
  return numbered(all);
}

// A cone is cut off where it is no wider than a size, which has grown on the way from the apex.
TEST(MeasureLeaf, AsksForWhatReachesTheTipOfACone) {
  const double deviation = 0.05, least = 0.002;
  for (const double degrees : {8.0, 15.0, 25.0}) {
    const Part part(cone(degrees), 0.3, 1);
    const double opening = 2 * std::tan(kPi / 180 * degrees);
    for (const double growth : {0.0, 0.1, 0.2}) {
      SizeRules rules{.deviation = deviation, .least = least};
      rules.growth = growth;
      double at_apex = 1e9;
      for (const SizedNode& node : part.measured(rules))
        if (part.box(node).squared_distance(Point{0, 0, 0}) == 0)
          at_apex = std::min<double>(at_apex, node.size);
      const double reaching = deviation * (opening - growth);
      EXPECT_LT(at_apex, std::max(least, reaching) * 1.001) << degrees << ' ' << growth;
      EXPECT_GT(at_apex, std::max(least, 0.9 * reaching) * 0.999) << degrees << ' ' << growth;
    }
  }
  // Narrower than sizes grow: the least that is asked for.
  const Part needle(cone(4), 0.3, 1);
  const auto nodes = needle.measured({.deviation = deviation, .least = least, .growth = 0.2});
  EXPECT_EQ(std::ranges::min(nodes, {}, &SizedNode::size).size, static_cast<float>(least));
}

// The curvature of such a scan's triangles is that of a ball 25 times as small.
TEST(MeasureLeaf, DoesNotTakeNoiseForCurvature) {
  Mesh scanned = icosphere({0, 0, 0}, 1, 5);
  const auto noisy = [](const Point& p) {
    const double x = std::sin(2e4 * p.x + 1e4 * std::sin(3e4 * p.y) + 5e4 * p.z);
    return (1 + 0.002 * x) * p;
  };
  for (Triangle& t : scanned)
    for (Point& p : t.corners) p = noisy(p);
  const Part part(scanned, 0.5, 2);
  const double expected = 2 * kPi / (1.15 * 20);
  const auto nodes = part.measured({.per_circle = 20, .least = 0.02});
  EXPECT_GT(share_of_expected(part, nodes, 0.75 * expected, 1.1 * expected), 0.9);
  // Facets follow noise that is larger than the deviation, and not what is smaller.
  const auto coarse = part.measured({.deviation = 0.01, .least = 0.02});
  EXPECT_GT(share_of_expected(part, coarse, 0.7 * std::sqrt(0.02), std::sqrt(0.02)), 0.9);
  const auto fine = part.measured({.deviation = 0.0006, .least = 0.01});
  double mean = 0;
  for (const SizedNode& n : fine) mean += n.size / static_cast<double>(fine.size());
  EXPECT_LT(mean, 0.6 * std::sqrt(0.0012));
}

TEST(MeasureLeaf, AsksForLayersAcrossThinParts) {
  const double thickness = 0.06;
  const Part plate(box({{0, 0, 0}, {1, 1, thickness}}), 0.2, 1);
  for (const double layers : {1.0, 3.0}) {
    const auto nodes = plate.measured({.layers = layers, .least = 0.005});
    const double expected = thickness / (1.35 * layers);
    EXPECT_GT(share_of_expected(plate, nodes, expected, expected), 0.999);
    EXPECT_LT(farthest_from_nodes(plate, nodes), 2 * expected);
  }
  // The gap between two plates is no part.
  const Mesh two = together(box({{0, 0, 0}, {1, 1, 0.5}}), box({{0, 0, 0.53}, {1, 1, 1.03}}));
  EXPECT_TRUE(Part(two, 0.1, 1).measured({.layers = 3, .least = 0.005}).empty());
}

TEST(MeasureLeaf, GoesNoLowerThanTheLeast) {
  const Part sphere(icosphere({0, 0, 0}, 1, 4), 0.5, 1);
  for (const SizedNode& node :
       sphere.measured({.per_circle = 200, .deviation = 1e-6, .least = 0.1}))
    EXPECT_EQ(node.size, 0.1F);
}

}  // namespace
}  // namespace locvol
