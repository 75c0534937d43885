#include "octree/size_shapes.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <utility>

namespace locvol {
namespace {

double distance_to_segment(const Point& a, const Point& b, const Point& p) {
  const Point along = b - a;
  const double length2 = dot(along, along);
  const double t = length2 > 0 ? std::clamp(dot(p - a, along) / length2, 0.0, 1.0) : 0.0;
  return norm(p - (a + t * along));
}

struct Distances {
  double least, most;  // no more, no less than to any point of a box
};
Distances distances(const SizeShape& shape, const Box& box) {
  if (shape.kind == ShapeKind::kBox) {
    const Box of_shape{shape.a, shape.b};
    return {std::sqrt(of_shape.squared_distance(box)), of_shape.most_distance(box)};
  }
  const double distance = distance_to(shape, box.center()), way = 0.5 * norm(box.max - box.min);
  return {std::max(0.0, distance - way), distance + way};
}

}  // namespace

Box box_of(const SizeShape& shape) {
  if (shape.kind == ShapeKind::kBall) return Box::around(shape.a).expanded(shape.radius);
  return Box::around(shape.a).joined(shape.b);
}

double distance_to(const SizeShape& shape, const Point& p) {
  switch (shape.kind) {
    case ShapeKind::kBall:
      return std::max(0.0, norm(p - shape.a) - shape.radius);
    case ShapeKind::kBox:
      return std::sqrt(Box{shape.a, shape.b}.squared_distance(p));
    case ShapeKind::kSegment:
      return distance_to_segment(shape.a, shape.b, p);
  }
  return std::numeric_limits<double>::infinity();
}

double size_from(std::span<const SizeShape> shapes, double growth, const Point& p) {
  double least = std::numeric_limits<double>::infinity();
  for (const SizeShape& shape : shapes) least = std::min(least, size_from(shape, growth, p));
  return least;
}

SizeBounds size_bounds(std::span<const SizeShape> shapes, double growth, const Box& box) {
  SizeBounds bounds{std::numeric_limits<double>::infinity(),
                    std::numeric_limits<double>::infinity()};
  for (const SizeShape& shape : shapes) {
    const auto [least, most] = distances(shape, box);
    bounds.least = std::min(bounds.least, shape.size + growth * least);
    bounds.most = std::min(bounds.most, shape.size + growth * most);
  }
  return bounds;
}

std::vector<SizeShape> shapes_near(std::span<const SizeShape> shapes, double growth, const Box& box,
                                   double most) {
  std::vector<SizeShape> near;
  std::ranges::copy_if(shapes, std::back_inserter(near), [&](const SizeShape& shape) {
    return shape.size + growth * distances(shape, box).least <= most;
  });
  return near;
}

std::span<const SizeShape> ShapesOfNodes::in(MortonKey node) {
  constexpr std::size_t kFew = 4;  // all may be looked at
  while (!path_.empty() && !path_.back().node.is_ancestor_or_self_of(node)) path_.pop_back();
  int level = path_.empty() ? 0 : path_.back().node.level() + 1;
  for (; level <= node.level() && last().size() > kFew; ++level) {
    MortonKey above = node;
    while (above.level() > level) above = above.parent();
    const Box box = frame_.box(above);
    std::vector<SizeShape> near =
        shapes_near(last(), growth_, box, size_bounds(last(), growth_, box).most);
    path_.push_back({above, std::move(near)});
  }
  return last();
}

}  // namespace locvol
