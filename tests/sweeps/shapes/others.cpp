// Families that are no unions of boxes, no prisms, and turn about no axis.
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/convex_hull_3.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <vector>

#include "tests/sweeps/shapes/blocks.h"
#include "tests/sweeps/shapes/families.h"

namespace locvol::sweeps {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;

// Of points in general position, so that it is a matter of the points alone; not so the order in
// which CGAL gives its triangles.
Shape convex_hull(const std::vector<Kernel::Point_3>& points) {
  CGAL::Surface_mesh<Kernel::Point_3> hull;
  CGAL::convex_hull_3(points.begin(), points.end(), hull);
  std::set<std::array<Point, 3>> triangles;
  for (const auto face : hull.faces()) {
    std::vector<Point> corners;
    for (const auto vertex : hull.vertices_around_face(hull.halfedge(face))) {
      const auto& p = hull.point(vertex);
      corners.push_back({p.x(), p.y(), p.z()});
    }
    std::ranges::rotate(corners, std::ranges::min_element(corners));
    triangles.insert({corners.at(0), corners.at(1), corners.at(2)});
  }
  ShapeBuilder builder;
  for (const auto& [a, b, c] : triangles) builder.triangle(a, b, c);
  return builder.take();
}

Kernel::Point_3 random_point(bool is_on_sphere, Dice& dice) {
  const double z = dice.uniform(-1, 1), angle = dice.uniform(0, 2 * kPi);
  const double r = std::sqrt(1 - z * z), size = is_on_sphere ? 1 : dice.uniform(0.2, 1);
  return {size * r * std::cos(angle), size * r * std::sin(angle), size * z};
}

// A part that is simple, so that a pair stays small.
Solid simple_part(Dice& dice) {
  constexpr std::array kParts = {make_box,  make_wedge, make_sphere, make_cone,
                                 make_hull, make_shaft, make_stack,  make_steps};
  return dice.one_of(kParts)(dice);
}

template <typename T>
std::optional<T> sum(const std::optional<T>& a, const std::optional<T>& b) {
  return a && b ? std::optional(*a + *b) : std::nullopt;
}

Solid balls_in_each_other(Dice& dice) {
  const Solid ball = make_sphere(dice);
  const double wall = dice.uniform(0.05, 0.3), gap = dice.log_uniform(1e-4, 0.2);
  const auto shrunk = [&](double by) { return scaled(ball.shape, {by, by, by}); };
  const double cavity = 1 - wall, inside = cavity - gap;
  return {
      .shape = together(together(ball.shape, turned_inside_out(shrunk(cavity))), shrunk(inside)),
      .thickness = 0.5 * ball.thickness * std::min(wall, gap),
      .volume = *ball.volume * (1 - std::pow(cavity, 3) + std::pow(inside, 3)),
      .genus = 0,
      .num_components = 3};
}

Solid boxes_in_each_other(Dice& dice) {
  const double wall = dice.length(0.05, 0.5), gap = dice.log_uniform(1e-4, 0.2);
  const auto planes = [&] {
    std::vector<double> all = {0};
    for (const double width : {wall, gap, dice.length(0.5, 3), gap, wall})
      all.push_back(all.back() + width);
    return all;
  };
  Blocks blocks({planes(), planes(), planes()});
  blocks.fill({0, 0, 0}, {5, 5, 5});
  blocks.fill({1, 1, 1}, {4, 4, 4}, false);
  blocks.set(2, 2, 2, true);
  Solid solid = blocks.solid();
  solid.genus = 0;
  solid.num_components = 3;
  return solid;
}

}  // namespace

Solid make_sheet(Dice& dice) {
  const int nx = dice.integer(1, 40), ny = dice.integer(1, 40);
  const double length = dice.length(1, 4), width = dice.length(1, 4);
  const double thickness = dice.length(0.002, 0.2);
  const double amplitude = dice.chance(0.3) ? 0 : dice.uniform(0, 0.3);
  const double waves = dice.uniform(0.5, 3), phase = dice.uniform(0, 2 * kPi);
  const auto at = [&](int i, int j, double height) {
    const double u = static_cast<double>(i) / nx, v = static_cast<double>(j) / ny;
    const double z = amplitude * std::sin(waves * kPi * u + phase) * std::cos(waves * kPi * v);
    return Point{length * u, width * v, z + height};
  };
  ShapeBuilder builder;
  for (int j = 0; j < ny; ++j)
    for (int i = 0; i < nx; ++i) {
      builder.quad(at(i, j, thickness), at(i + 1, j, thickness), at(i + 1, j + 1, thickness),
                   at(i, j + 1, thickness));
      builder.quad(at(i, j, 0), at(i, j + 1, 0), at(i + 1, j + 1, 0), at(i + 1, j, 0));
    }
  const auto rim = [&](double height) {
    std::vector<Point> ring;
    for (int i = 0; i < nx; ++i) ring.push_back(at(i, 0, height));
    for (int j = 0; j < ny; ++j) ring.push_back(at(nx, j, height));
    for (int i = nx; i > 0; --i) ring.push_back(at(i, ny, height));
    for (int j = ny; j > 0; --j) ring.push_back(at(0, j, height));
    return ring;
  };
  builder.band(rim(0), rim(thickness));
  return {.shape = builder.take(),
          .thickness = 0.25 * thickness,  // it is measured along z, and the sheet may be steep
          .volume = length * width * thickness,
          .genus = 0,
          .num_components = 1};
}

// Moved along its ray from the center, a vertex never makes the surface meet itself.
Solid make_urchin(Dice& dice) {
  Solid solid = make_sphere(dice);
  const double share = dice.uniform(0.02, 0.3), height = dice.uniform(0.2, 3);
  for (Point& p : solid.shape.vertices)
    if (dice.chance(share)) p = (1 + height) * p;
  return {.shape = solid.shape, .genus = 0, .num_components = 1};
}

Solid make_scan(Dice& dice) {
  Solid solid = make_sphere(dice);
  const double roughness = dice.log_uniform(1e-4, 0.1);
  for (Point& p : solid.shape.vertices) p = dice.uniform(1 - roughness, 1) * p;
  return {.shape = solid.shape,
          .thickness = roughness < 0.01 ? solid.thickness : 0,
          .genus = 0,
          .num_components = 1};
}

Solid make_hull(Dice& dice) {
  const int num_points = dice.one_of(std::array{4, 5, 6, 8, 12, 20, 50, 200});
  const bool is_on_sphere = dice.chance(0.5);
  std::vector<Kernel::Point_3> points;
  for (int i = 0; i < num_points; ++i) points.push_back(random_point(is_on_sphere, dice));
  return {.shape = convex_hull(points), .genus = 0, .num_components = 1};
}

Solid make_pair(Dice& dice) {
  const Solid first = simple_part(dice);
  const bool is_alike = dice.chance(0.5);
  const Solid second = is_alike ? first : simple_part(dice);
  const Box box = box_of(first.shape), other = box_of(second.shape);
  const double gap = dice.log_uniform(1e-6, 0.3) * (box.max.x - box.min.x);
  const double shift = dice.chance(0.5) ? 0 : dice.uniform(-0.5, 0.5) * (box.max.y - box.min.y);
  const Point by = {box.max.x + gap - other.min.x, box.min.y - other.min.y + shift,
                    box.min.z - other.min.z};
  return {.shape = together(first.shape, translated(second.shape, by)),
          .thickness = std::min({first.thickness, second.thickness, gap}),
          .volume = sum(first.volume, second.volume),
          .genus = sum(first.genus, second.genus),
          .num_components = sum(first.num_components, second.num_components)};
}

Solid make_nested(Dice& dice) {
  return dice.chance(0.5) ? balls_in_each_other(dice) : boxes_in_each_other(dice);
}

}  // namespace locvol::sweeps
