// Frame places the octree in space: a cube of 2^21 grid steps a side.
//
// Every coordinate of an octree box comes from position(), so two nodes that share a corner get the
// same bits for it. `unit` is kept to 20 significant bits and the origin to a multiple of it, so
// that positions are exact unless the model lies more than 2^31 steps from the origin of space.
#pragma once

#include <tuple>

#include "octree/geometry.h"
#include "octree/morton_key.h"

namespace locvol {

class Frame {
 public:
  Frame() = default;
  // REQUIRES: unit > 0, finite
  Frame(const Point& origin, double unit) : origin_(origin), unit_(unit) {}

  // The smallest frame whose nodes of some level have sides of (just over) `leaf_side`, and whose
  // root contains `box` with at least `margin` to spare on all sides. Throws std::invalid_argument
  // if that needs a level beyond MortonKey::kMaxLevel or the coordinates cannot be told apart.
  static Frame around(const Box& box, double margin, double leaf_side);

  const Point& origin() const { return origin_; }
  double unit() const { return unit_; }
  double side(int level) const;          // of a node's box
  int level_of_side(double side) const;  // the deepest level whose side is at least `side`, or 0
  int level_no_wider(
      double side) const;             // the first level whose side is at most `side`, or the last
  Point position(GridPoint g) const;  // monotone in each coordinate
  Box box(MortonKey key) const;
  Box root_box() const { return box(MortonKey::root()); }
  // The node of `level` that owns p: boxes are half-open, [min, max). Consistent with position():
  // box(key_of(p, l)).min <= p < .max on each axis. REQUIRES: p inside root_box(), below its max
  MortonKey key_of(const Point& p, int level = MortonKey::kMaxLevel) const;
  bool contains(const Point& p) const;  // p has an owner

  friend bool operator==(const Frame&, const Frame&) = default;
  // What makes it up, for those who store or send it. `frame`: a Frame or a const one
  template <class Self>
  static auto members(Self& frame) {
    return std::tie(frame.origin_, frame.unit_);
  }

 private:
  Point origin_;
  double unit_ = 1;
};

}  // namespace locvol
