// Shapes at which cells are to be smaller than λ, and from which sizes grow.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "octree/frame.h"
#include "octree/geometry.h"
#include "octree/morton_key.h"

namespace locvol {

enum class ShapeKind : std::uint8_t { kBall = 0, kBox = 1, kSegment = 2 };

struct SizeShape {
  ShapeKind kind = ShapeKind::kBall;
  double size = 0;    // in all of it
  Point a, b;         // ball: a is its center; box: lowest and highest corner; segment: its ends
  double radius = 0;  // of a ball; 0: a point
  friend bool operator==(const SizeShape&, const SizeShape&) = default;
};

// The box around all of the shape.
Box box_of(const SizeShape& shape);

// The distance of p from the shape; 0 in it.
double distance_to(const SizeShape& shape, const Point& p);

// The size at p, and how much it grows away from there.
inline double size_from(const SizeShape& shape, double growth, const Point& p) {
  return shape.size + growth * distance_to(shape, p);
}
// The least size that any of the shapes asks for at p; infinite without any.
double size_from(std::span<const SizeShape> shapes, double growth, const Point& p);

// No more than the shapes allow anywhere in the box, and what they allow in all of it; infinite
// without any. Off by at most `growth` times its diagonal.
struct SizeBounds {
  double least, most;
};
SizeBounds size_bounds(std::span<const SizeShape> shapes, double growth, const Box& box);

// The shapes that may ask for `most` or less somewhere in the box, in the same order.
std::vector<SizeShape> shapes_near(std::span<const SizeShape> shapes, double growth, const Box& box,
                                   double most);

// Finds the shapes that matter in a node of an octree, fast where nodes are asked for in Morton
// order: it keeps those of the last node's ancestors.
class ShapesOfNodes {
 public:
  // `shapes`: must outlive it
  ShapesOfNodes(std::span<const SizeShape> shapes, double growth, const Frame& frame)
      : shapes_(shapes), growth_(growth), frame_(frame) {}

  // The shapes that matter in a node; valid until the next call.
  std::span<const SizeShape> in(MortonKey node);
  SizeBounds bounds(MortonKey node) { return size_bounds(in(node), growth_, frame_.box(node)); }

 private:
  struct Step {
    MortonKey node;
    std::vector<SizeShape> shapes;
  };
  std::span<const SizeShape> last() const {
    return path_.empty() ? shapes_ : std::span<const SizeShape>(path_.back().shapes);
  }

  std::span<const SizeShape> shapes_;
  double growth_;
  Frame frame_;
  std::vector<Step> path_;  // downwards
};

}  // namespace locvol
