#include "refine/size_leaf.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <span>
#include <unordered_map>
#include <utility>

#include "octree/table_hash.h"
#include "refine/box_tree.h"
#include "refine/closest_point.h"

namespace locvol {
namespace {

const double kCubeRadius = 1.001 * std::sqrt(5.0) / 4;  // over the side; with room for rounding
const double kHalfDiagonal = std::sqrt(3.0) / 2;

class SizeTree {
 public:
  SizeTree(const SizeInput& input, const SurfacePatch& surface, const FarSurface& far,
           const StopToken* stop)
      : input_(input),
        surface_(surface),
        far_(far),
        poll_(stop),
        step_(std::exp2(std::floor(std::log2(input.law.least)) - kStepBits)) {
    std::vector<Box> boxes;
    for (const Triangle& t : surface.triangles()) boxes.push_back(t.box());
    triangles_ = BoxTree(std::move(boxes));
  }

  std::vector<SizeCube> run() {
    descend(input_.leaf, {}, input_.shapes);
    return std::move(cubes_);
  }

 private:
  // What is known of a place: a triangle near it, if any, and a bound of the distance.
  struct Nearest {
    std::uint32_t triangle = kNone;
    double bound = std::numeric_limits<double>::infinity();
  };
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

  // `near`: of the node's center; its nearest triangle is close to that of the parent's center.
  // `shapes`: all that matter in the node.
  void descend(MortonKey node, Nearest near, std::span<const SizeShape> shapes) {
    poll_();
    const Box box = input_.frame.box(node);
    const double side = box.max.x - box.min.x;
    const Point center = box.center();
    const double distance = signed_distance(center, near);
    near.bound = std::abs(distance) + kHalfDiagonal * side;
    const SizeLaw& law = input_.law;
    const double size = std::min(law.at_distance(distance), size_from(shapes, law.growth, center));
    if (!may_stay(node, side, distance, size)) {
      std::vector<SizeShape> near_node;
      if (shapes.size() > kFewShapes) {
        const SizeBounds bounds = size_bounds(shapes, law.growth, box);
        near_node = shapes_near(shapes, law.growth, box, bounds.most);
        shapes = near_node;
      }
      for (int octant = 0; octant < 8; ++octant) descend(node.child(octant), near, shapes);
      return;
    }
    SizeCube cube{.key = node};
    const GridPoint low = node.grid_min();
    const std::uint32_t steps = node.grid_side();
    for (std::uint32_t k = 0; k < 8; ++k) {
      const GridPoint corner{low.x + (k & 1) * steps, low.y + (k >> 1 & 1) * steps,
                             low.z + (k >> 2) * steps};
      cube.distance[k] = corner_distance(corner, near);
      cube.less[k] = corner_less(corner, cube.distance[k], shapes);
    }
    if (distance > 0) cube.excess = up_to_step(interpolated(cube.distance, box, center) - distance);
    if (std::ranges::any_of(cube.less, [](float less) { return less > 0; })) {
      const float more = up_to_step(most_above_shapes(cube, box, shapes));
      for (float& less : cube.less) less += more;
    }
    // No surface passes through, and no cell lies there.
    if (distance < 0 && -distance > kHalfDiagonal * side)
      cube.distance.fill(-static_cast<float>(side));
    cubes_.push_back(cube);
  }

  // `size`: h at its center.
  bool may_stay(MortonKey node, double side, double distance, double size) const {
    if (node.level() >= kMaxCubeLevel) return true;
    if (distance < 0 && -distance > kHalfDiagonal * side) return true;
    const double radius = kCubeRadius * side;
    return radius < std::max(input_.law.least, size - input_.law.growth * radius);
  }

  // By how much h is above what the shapes allow, where that is looked at: interpolated, it is
  // above their cones' tips.
  double most_above_shapes(const SizeCube& cube, const Box& box,
                           std::span<const SizeShape> shapes) const {
    const double half = 0.5 * (box.max.x - box.min.x);
    double most = 0;
    for (int k = 0; k < 27; ++k) {
      const Point p = box.min + half * Point{double(k % 3), double(k / 3 % 3), double(k / 9)};
      most = std::max(most,
                      size_in(input_.law, cube, box, p) - size_from(shapes, input_.law.growth, p));
    }
    return most;
  }

  float up_to_step(double v) const {
    return static_cast<float>(step_ * std::ceil(std::max(0.0, v) / step_));
  }

  double signed_distance(const Point& p, Nearest& near) const {
    const auto squared_distance_of = [&](std::uint32_t n) {
      return squared_distance(p, closest_on_triangle(surface_.triangles()[n].corners, p));
    };
    double squared = near.bound * near.bound * (1 + 1e-9);
    if (near.triangle != kNone) squared = std::min(squared, squared_distance_of(near.triangle));
    triangles_.for_each_within(p, squared, [&](std::uint32_t n) {
      const double d = squared_distance_of(n);
      if (d < squared) squared = d, near.triangle = n;
    });
    double distance = std::sqrt(squared);
    if (distance > input_.exact_distance) distance = far_.distance(p, distance);
    return surface_.is_inside(p) ? distance : -distance;
  }

  // Corners are shared by eight cubes.
  float corner_distance(const GridPoint& g, Nearest near) {
    const auto [place, is_new] = corners_.try_emplace(std::array{g.x, g.y, g.z}, 0.0F);
    if (is_new)
      place->second = static_cast<float>(
          step_ * std::floor(signed_distance(input_.frame.position(g), near) / step_));
    return place->second;
  }

  // Of a corner, where the surface is so far. Other leaves get the same.
  float corner_less(const GridPoint& g, float distance, std::span<const SizeShape> shapes) const {
    if (shapes.empty()) return 0;
    const SizeLaw& law = input_.law;
    const double size = size_from(shapes, law.growth, input_.frame.position(g));
    return up_to_step(law.surface + law.growth * std::max(0.0F, distance) - size);
  }

  static constexpr std::size_t kFewShapes = 4;

  const SizeInput& input_;
  const SurfacePatch& surface_;
  const FarSurface& far_;
  BoxTree triangles_;
  StopPoll poll_;
  // Distances are multiples of it, a little less than they are: so they take half as many bytes.
  static constexpr int kStepBits = 9;
  double step_;
  std::unordered_map<std::array<std::uint32_t, 3>, float, TableHash> corners_;
  std::vector<SizeCube> cubes_;
};

}  // namespace

std::vector<SizeCube> size_leaf(SizeInput input, const FarSurface& far, const StopToken* stop) {
  const SurfacePatch surface(std::move(input.surface), stop);
  return SizeTree(input, surface, far, stop).run();
}

}  // namespace locvol
