#include "refine/size_leaf.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
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
        step_(std::exp2(std::floor(std::log2(input.law.surface)) - kStepBits)) {
    std::vector<Box> boxes;
    for (const Triangle& t : surface.triangles()) boxes.push_back(t.box());
    triangles_ = BoxTree(std::move(boxes));
  }

  std::vector<SizeCube> run() {
    descend(input_.leaf, {});
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
  void descend(MortonKey node, Nearest near) {
    poll_();
    const Box box = input_.frame.box(node);
    const double side = box.max.x - box.min.x;
    const double distance = signed_distance(box.center(), near);
    near.bound = std::abs(distance) + kHalfDiagonal * side;
    if (!may_stay(node, side, distance)) {
      for (int octant = 0; octant < 8; ++octant) descend(node.child(octant), near);
      return;
    }
    SizeCube cube{.key = node};
    const GridPoint low = node.grid_min();
    const std::uint32_t steps = node.grid_side();
    for (std::uint32_t k = 0; k < 8; ++k)
      cube.distance[k] = corner_distance(
          {low.x + (k & 1) * steps, low.y + (k >> 1 & 1) * steps, low.z + (k >> 2) * steps}, near);
    if (distance > 0)
      cube.excess = static_cast<float>(
          step_ *
          std::ceil(std::max(0.0, interpolated(cube, box, box.center()) - distance) / step_));
    // There h is λ, whatever they are.
    if (std::ranges::all_of(cube.distance, [](float d) { return d < 0; }))
      cube.distance.fill(static_cast<float>(-step_));
    cubes_.push_back(cube);
  }

  bool may_stay(MortonKey node, double side, double distance) const {
    if (node.level() >= kMaxCubeLevel) return true;
    if (distance < 0 && -distance > kHalfDiagonal * side) return true;
    const double radius = kCubeRadius * side;
    const SizeLaw& law = input_.law;
    const double least = std::max(law.at_distance(0),
                                  law.at_distance(std::max(distance, 0.0)) - law.growth * radius);
    return radius < least;
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
    if (distance > kExactDistance * input_.law.surface) distance = far_.distance(p, distance);
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
