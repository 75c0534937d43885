#include "refine/size_leaf.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <optional>
#include <span>
#include <tuple>
#include <unordered_map>
#include <utility>

#include "octree/table_hash.h"
#include "refine/domain/nearest_surface.h"

namespace locvol {
namespace {

const double kCubeRadius = 1.001 * std::sqrt(5.0) / 4;  // over the side; with room for rounding
const double kHalfDiagonal = std::sqrt(3.0) / 2;

class SizeTree {
 public:
  SizeTree(const SizeInput& input, const LeafDomain& domain, const FarSurface& far,
           const StopToken* stop)
      : input_(input),
        domain_(domain),
        surface_(domain),
        far_(far.around(input.frame.box(input.leaf))),
        poll_(stop),
        step_(std::exp2(std::floor(std::log2(input.law.least)) - kStepBits)),
        nodes_(input.nodes, input.law.growth, input.frame) {}

  std::vector<SizeCube> run() {
    descend(input_.leaf, {}, input_.shapes, nodes_.all(), nullptr);
    return std::move(cubes_);
  }

 private:
  // A place that was looked up, and what that tells of others around it.
  struct Known {
    Point place;
    double distance = 0;  // from the surface, negative outside; 0: nothing is known
    BodyId body = kNoBody;
    NearestSurface::Known near;
  };

  // Distances of a node's corners from the surface, as SizeCube has them.
  using Distances = std::array<float, 8>;

  // `known`: near the node. `shapes`, `branches`: all that matter in it. `corners`: between which
  // all that lies in it is interpolated; null: distances are to be looked up.
  void descend(MortonKey node, Known known, std::span<const SizeShape> shapes,
               const SizeNodes::Branches& branches, const Distances* corners) {
    poll_();
    const Box box = input_.frame.box(node);
    const double side = box.max.x - box.min.x;
    const Point center = box.center();
    const auto [distance, body] = corners != nullptr
                                      ? std::pair(interpolated(*corners, box, center), known.body)
                                      : signed_distance(center, known);
    known.place = center, known.distance = distance, known.body = body;
    known.near.bound = std::abs(distance) + kHalfDiagonal * side;
    const SizeLaw& law = input_.law;
    double most = law.surface + law.growth * (std::max(0.0, distance) + kHalfDiagonal * side);
    SizeNodes::Branches& near_branches = branches_[std::size_t(node.level())];
    if (!nodes_.is_empty()) nodes_.find_near(branches, box, most, near_branches);
    std::vector<SizeShape> near_shapes;
    if (shapes.size() > kFewShapes) {
      const SizeBounds bounds = size_bounds(shapes, law.growth, box);
      near_shapes = shapes_near(shapes, law.growth, box, std::min(most, bounds.most));
      shapes = near_shapes;
    }
    const double asked =
        std::min(asked_at(center, shapes, near_branches, most), size_throughout(body));
    const double most_asked = asked + law.growth * kHalfDiagonal * side * (1 + 1e-9);
    const auto at = [&](std::uint32_t k) {
      return at_corner(corner_of(node, k), known, shapes, near_branches, most_asked,
                       corners != nullptr ? &(*corners)[k] : nullptr);
    };
    if (!may_stay(node, side, distance, asked)) {
      Distances own;
      if (corners == nullptr && distance > kHalfDiagonal * side) {
        for (std::uint32_t k = 0; k < 8; ++k) own[k] = at(k).first;
        if (is_nearly_linear(own, box, distance)) corners = &own;
      }
      for (int octant = 0; octant < 8; ++octant) {
        const MortonKey child = node.child(octant);
        if (corners == nullptr) {
          descend(child, known, shapes, near_branches, nullptr);
          continue;
        }
        Distances of_child;
        for (std::uint32_t k = 0; k < 8; ++k)
          of_child[k] =
              down_to_step(interpolated(*corners, box, input_.frame.position(corner_of(child, k))));
        descend(child, known, shapes, near_branches, &of_child);
      }
      return;
    }
    SizeCube cube{.key = node};
    // No surface passes through, and no cell lies there.
    const bool is_outside = distance < 0 && -distance > kHalfDiagonal * side;
    if (is_outside && shapes.empty() && near_branches.empty()) {
      cube.distance.fill(-static_cast<float>(side));
      cubes_.push_back(cube);
      return;
    }
    for (std::uint32_t k = 0; k < 8; ++k) std::tie(cube.distance[k], cube.less[k]) = at(k);
    if (distance > 0) cube.excess = up_to_step(interpolated(cube.distance, box, center) - distance);
    if (std::ranges::any_of(cube.less, [](float less) { return less > 0; })) {
      const bool is_of_one = std::abs(distance) > kHalfDiagonal * side;
      const float more = up_to_step(most_above(cube, box, shapes, near_branches,
                                               is_of_one ? std::optional(body) : std::nullopt));
      for (float& less : cube.less) less += more;
    }
    if (is_outside) cube.distance.fill(-static_cast<float>(side));
    cubes_.push_back(cube);
  }

  // Is what the surface allows for at a place, where none passes, about what is interpolated? Then
  // so it is in all of the node: distances bend less the farther the surface is, and where two of
  // its sides are as far, what is interpolated is less. `distance`: of its center.
  bool is_nearly_linear(const Distances& corners, const Box& box, double distance) const {
    constexpr double kClose = 0.01;
    const double change = input_.law.growth * (interpolated(corners, box, box.center()) - distance);
    return std::abs(change) <= kClose * input_.law.at_distance(distance);
  }

  static GridPoint corner_of(MortonKey node, std::uint32_t k) {
    const GridPoint low = node.grid_min();
    const std::uint32_t steps = node.grid_side();
    return {low.x + (k & 1) * steps, low.y + (k >> 1 & 1) * steps, low.z + (k >> 2) * steps};
  }

  // `distance`, `asked`: at its center.
  bool may_stay(MortonKey node, double side, double distance, double asked) const {
    if (node.level() >= kMaxCubeLevel) return true;
    const SizeLaw& law = input_.law;
    constexpr double kAllAround = 1.9;  // over the side: half a diagonal, and that a depth in it is
                                        // known but for the side (SizeField::least_depth)
    const double unbounded = std::min(law.surface + law.growth * distance, asked);
    if (law.has_core() &&
        unbounded >= law.most + law.growth * (kAllAround * side + kCoreMargin * law.most))
      return true;
    if (distance < 0 && -distance > kHalfDiagonal * side) return true;
    const double radius = kCubeRadius * side;
    const double least_of_surface = law.surface + law.growth * std::max(0.0, distance - radius);
    return radius <
           std::max(law.least, std::min({law.most, least_of_surface, asked - law.growth * radius}));
  }

  // What shapes and nodes ask for, if that is less than `most`; else `most`.
  double asked_at(const Point& p, std::span<const SizeShape> shapes,
                  const SizeNodes::Branches& branches, double most) const {
    return nodes_.size_at(branches, p, std::min(most, size_from(shapes, input_.law.growth, p)));
  }

  double size_throughout(BodyId body) const {
    return body != kNoBody && body <= input_.body_sizes.size()
               ? input_.body_sizes[body - 1]
               : std::numeric_limits<double>::infinity();
  }

  // By how much h is above that, where that is looked at: interpolated, it is above cones' tips,
  // and in a body above what it is there throughout, where that is passed by a border of the body.
  // `body`: that all of the cube is in, if it is in one.
  // Tips of shapes are as sharp as their user made them; nodes are not much smaller than the cube.
  double most_above(const SizeCube& cube, const Box& box, std::span<const SizeShape> shapes,
                    const SizeNodes::Branches& branches, std::optional<BodyId> body) const {
    const double half = 0.5 * (box.max.x - box.min.x);
    double most = 0;
    for (int k = 0; k < 27; ++k) {
      const Point steps{double(k % 3), double(k / 3 % 3), double(k / 9)};
      const int num_between = (steps.x == 1) + (steps.y == 1) + (steps.z == 1);
      if (shapes.empty() && input_.body_sizes.empty() && num_between < 2) continue;
      const Point p = box.min + half * steps;
      const double size = size_in(input_.law, cube, box, p);
      double asked = asked_at(p, shapes, branches, size);
      if (!input_.body_sizes.empty())
        asked = std::min(asked, size_throughout(body ? *body : domain_.label(p).value_or(kNoBody)));
      most = std::max(most, size - asked);
    }
    return most;
  }

  float down_to_step(double v) const { return static_cast<float>(step_ * std::floor(v / step_)); }
  float up_to_step(double v) const {
    return static_cast<float>(step_ * std::ceil(std::max(0.0, v) / step_));
  }

  // With the body that p is in: as a place is that no surface comes between.
  std::pair<double, BodyId> signed_distance(const Point& p, Known& known) const {
    double distance = surface_.distance(p, known.near);
    if (distance > input_.exact_distance) distance = far_.distance(p, distance);
    constexpr double kSurely = 0.9;  // far distances may be a little too large
    const double empty = kSurely * known.distance;
    const BodyId body = squared_distance(p, known.place) < empty * empty
                            ? known.body
                            : domain_.label(p).value_or(kNoBody);
    return {body != kNoBody ? distance : -distance, body};
  }

  // Its distance, and by how much less is asked for there than the surface so far away allows.
  // Corners are shared by eight cubes; other leaves get about the same. `given`: its distance, if
  // that is not to be looked up.
  std::pair<float, float> at_corner(const GridPoint& g, Known known,
                                    std::span<const SizeShape> shapes,
                                    const SizeNodes::Branches& branches, double most,
                                    const float* given) {
    const auto [place, is_new] = corners_.try_emplace(std::array{g.x, g.y, g.z});
    auto& [distance, less] = place->second;
    if (!is_new) return place->second;
    const SizeLaw& law = input_.law;
    const Point p = input_.frame.position(g);
    BodyId body = known.body;
    if (given != nullptr) {
      distance = *given;
    } else {
      double exact = 0;
      std::tie(exact, body) = signed_distance(p, known);
      distance = down_to_step(exact);
    }
    const double throughout = size_throughout(body);
    if (!shapes.empty() || !branches.empty() || throughout < most)
      less = up_to_step(law.surface + law.growth * std::max(0.0F, distance) -
                        std::min(asked_at(p, shapes, branches, most), throughout));
    return place->second;
  }

  static constexpr std::size_t kFewShapes = 4;

  const SizeInput& input_;
  const LeafDomain& domain_;
  const NearestSurface surface_;
  const FarPoints far_;
  StopPoll poll_;
  // Distances are multiples of it, a little less than they are: so they take half as many bytes.
  static constexpr int kStepBits = 9;
  double step_;
  std::unordered_map<std::array<std::uint32_t, 3>, std::pair<float, float>, TableHash> corners_;
  SizeNodes nodes_;
  std::array<SizeNodes::Branches, kMaxCubeLevel + 1> branches_;  // by level
  std::vector<SizeCube> cubes_;
};

}  // namespace

std::vector<SizeCube> size_leaf(SizeInput input, const FarSurface& far, const StopToken* stop) {
  const LeafDomain domain(std::move(input.domain), stop);
  return SizeTree(input, domain, far, stop).run();
}

}  // namespace locvol
