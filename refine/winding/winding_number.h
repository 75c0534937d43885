// WindingNumber tells how often triangles wind around a place, whatever they are: the generalized
// winding number (Jacobson, Kavan, Sorkine-Hornung: Robust inside-outside segmentation, 2013).
//
// The open edges are closed by cones. Triangles and cones together wind around a place a whole
// number of times, which is the sum of the signed crossings of a ray, exactly; less the solid
// angles of the cones, that is the number of the triangles alone. So what is closed costs no solid
// angle, and of what is far the cones' moments are enough (Barill, Dickson, Schmidt, Levin,
// Jacobson: Fast winding numbers, 2018).
// Degenerate positions are decided by moving all places by the same infinitesimal (ε, ε², ε³).
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "octree/geometry.h"
#include "refine/domain/triangle_tree.h"
#include "refine/winding/chain.h"

namespace locvol {

// What is inside. A plane wall inside of something has exactly 1/2 on one of its sides, and is no
// wall; what is told of sides is more exact than this.
inline constexpr double kLeastInside = 0.5 - 1e-5;

// Beside a triangle, of both of its sides.
struct BesideNumbers {
  double behind = 0, before = 0;
};

// Where both are asked for: within the triangle, above no edge but by chance.
inline Point place_on(const std::array<Point, 3>& t) {
  return t[0] + (0.3178 * (t[1] - t[0]) + 0.3391 * (t[2] - t[0]));
}

// Cones over open edges.
class Cones {
 public:
  // What is so far, in radii, is seen as one: then the angle is off by 1e-3; where that might
  // decide, by 1e-6; and by some hundredths.
  static constexpr double kFar = 5, kFarther = 50, kRough = 2;

  Cones() = default;
  Cones(const Chain& chain, std::span<const OpenEdge> edges);

  using Cone = std::array<Point, 3>;
  const std::vector<Cone>& all() const { return cones_; }
  // The sum of their solid angles seen from p, over 4π. What is `far`, in radii, is seen as one.
  double angle_at(const Point& p, double far) const;
  // Is that surely less than `most`, whichever its sign, also as angle_at() has it? In a fraction
  // of the time; false does not say that it is more.
  bool is_surely_below(double most, const Point& p) const;

 private:
  struct Node {
    Point center, moment;                          // of the area, and of the area's vectors
    double area = 0, radius = 0;                   // the latter: around the center
    std::uint32_t begin = 0, end = 0, second = 0;  // its cones; its second child, 0: none
  };
  std::uint32_t build(std::uint32_t begin, std::uint32_t end);
  double angle_of(const Node& node, const Point& p, double far) const;
  // Takes what it is at most from `left`, until nothing is.
  void take_most_of(const Node& node, const Point& p, double& left) const;

  std::vector<Cone> cones_;
  std::vector<Node> nodes_;  // the first child follows its parent
};

// Is a place on the triangle before it? Rounding moves it to one of the sides.
bool is_seen_before(const std::array<Point, 3>& triangle, const Point& p);
// Of a triangle that is there so many times. `whole`: the whole number at place_on() it
BesideNumbers beside_triangle(const std::array<Point, 3>& triangle, int times, int whole,
                              const Cones& cones);

class WindingNumber {
 public:
  // REQUIRES: coordinates are finite
  explicit WindingNumber(const Chain& chain);

  double at(const Point& p) const { return whole_at(p) - cones_.angle_at(p, Cones::kFar); }
  // To some hundredths, in a fraction of the time where much is open.
  double roughly_at(const Point& p) const {
    return whole_at(p) - cones_.angle_at(p, Cones::kRough);
  }
  // `triangle`: its place in the chain
  BesideNumbers beside(std::size_t triangle) const;
  const std::vector<OpenEdge>& open() const { return open_; }

 private:
  int whole_at(const Point& p) const;

  std::vector<Triangle> triangles_;  // and cones
  std::vector<std::int32_t> times_;
  std::vector<OpenEdge> open_;
  Cones cones_;
  std::vector<TriangleTree> tree_;  // one
  std::vector<std::uint32_t> in_tree_;
};

}  // namespace locvol
