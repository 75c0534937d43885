// Two to five bodies in one surface: side by side, in each other, apart, and grains.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "refine/grains/voronoi_grains.h"
#include "tests/sweeps/shapes/families.h"

namespace locvol::sweeps {
namespace {

using testing_shapes::box;

// What bodies have in common is there once with each, in the same triangles.
class Bodies {
 public:
  void begin() { ++num_; }
  void triangle(const Point& a, const Point& b, const Point& c) {
    builder_.triangle(a, b, c);
    bodies_.push_back(num_);
  }
  void add(const Shape& shape) {
    begin();
    for (const auto& [a, b, c] : shape.triangles)
      triangle(shape.vertices[a], shape.vertices[b], shape.vertices[c]);
  }
  Solid take(double thickness) {
    return {.shape = builder_.take(), .thickness = thickness, .bodies = std::move(bodies_)};
  }

 private:
  ShapeBuilder builder_;
  std::vector<std::uint32_t> bodies_;
  std::uint32_t num_ = 0;
};

double least_side(const Box& box) {
  const Point sides = box.max - box.min;
  return std::min({sides.x, sides.y, sides.z});
}

}  // namespace

// Cells of a grid: layers, or what meets in an edge, of which one may be missing.
Solid make_bricks(Dice& dice) {
  const bool is_stack = dice.chance(0.5);
  const std::array<int, 3> num =
      is_stack ? std::array{1, 1, dice.integer(2, 5)} : std::array{2, 2, 1};
  const int missing = !is_stack && dice.chance(0.5) ? dice.integer(0, 3) : -1;
  std::array<std::vector<double>, 3> planes;
  double thickness = HUGE_VAL;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    planes[axis] = {0};
    for (int i = 0; i < num[axis]; ++i) {
      const double width = dice.length(is_stack && axis == 2 ? 0.1 : 0.5, 4);
      planes[axis].push_back(planes[axis].back() + width);
      thickness = std::min(thickness, width);
    }
  }
  Bodies bodies;
  double volume = 0;
  for (std::size_t n = 0, k = 0; k + 1 < planes[2].size(); ++k)
    for (std::size_t j = 0; j + 1 < planes[1].size(); ++j)
      for (std::size_t i = 0; i + 1 < planes[0].size(); ++i, ++n) {
        if (static_cast<int>(n) == missing) continue;
        const Point low = {planes[0][i], planes[1][j], planes[2][k]},
                    high = {planes[0][i + 1], planes[1][j + 1], planes[2][k + 1]};
        bodies.add(box(low, high));
        volume += Box{low, high}.volume();
      }
  Solid solid = bodies.take(thickness);
  solid.volume = volume;
  return solid;
}

// Each in the one before.
Solid make_onion(Dice& dice) {
  const bool has_boxes = dice.chance(0.5);
  const int num = dice.integer(2, 5);
  Bodies bodies;
  double half = dice.length(1, 5), thickness = HUGE_VAL;
  std::optional<double> volume;
  for (int n = 0; n < num; ++n) {
    const Shape shape = has_boxes ? box({-half, -half, -half}, {half, half, half})
                                  : testing_shapes::sphere(half, 8 + n, 16 + n);
    if (!volume) volume = volume_of(shape);
    bodies.add(shape);
    const double next = half * dice.uniform(0.3, 0.8);
    // Facets of a ball of 16 sides are within a thirtieth of its radius.
    thickness = std::min(thickness, n + 1 < num ? (has_boxes ? 1 : 0.96) * half - next : half);
    half = next;
  }
  Solid solid = bodies.take(thickness);
  solid.volume = volume;
  return solid;
}

Solid make_apart(Dice& dice) {
  constexpr std::array kMakers = {make_sphere, make_torus, make_box, make_hull, make_cone};
  const int num = dice.integer(2, 4);
  Bodies bodies;
  double end = 0, thickness = HUGE_VAL;
  for (int n = 0; n < num; ++n) {
    const Solid solid = dice.one_of(kMakers)(dice);
    const Box around = box_of(solid.shape);
    const double gap = dice.uniform(0.1, 1) * least_side(around);
    bodies.add(testing_shapes::translated(solid.shape, {end - around.min.x, 0, 0}));
    end += around.max.x - around.min.x + gap;
    thickness = std::min({thickness, solid.thickness, gap});
  }
  return bodies.take(thickness);
}

// Voronoi cells in a cube. Some edges, and angles between faces, are as small as they come.
Solid make_grains(Dice& dice) {
  std::vector<Point> seeds(static_cast<std::size_t>(dice.integer(2, 5)));
  for (Point& seed : seeds)
    for (int axis = 0; axis < 3; ++axis)
      seed[axis] = std::ldexp(static_cast<double>(dice.bits() >> 24 << 1 | 1), -40) - 1;
  const Grains grains = voronoi_grains(seeds);
  Bodies bodies;
  for (std::uint32_t g = 0; g < seeds.size(); ++g) {
    bodies.begin();
    for (const auto& [sides, ring] : grains.faces) {
      if (sides[0] != g && sides[1] != g) continue;
      const auto at = [&](std::size_t i) { return grains.vertices[ring[i]]; };
      for (std::size_t i = 1; i + 1 < ring.size(); ++i)
        sides[0] == g ? bodies.triangle(at(0), at(i), at(i + 1))
                      : bodies.triangle(at(0), at(i + 1), at(i));
    }
  }
  Solid solid = bodies.take(0);
  solid.volume = 8;
  return solid;
}

}  // namespace locvol::sweeps
