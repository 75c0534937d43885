// Closed triangulated shapes made in the test.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <limits>
#include <numbers>
#include <utility>
#include <vector>

#include "octree/geometry.h"

namespace locvol::testing_shapes {

struct Shape {
  std::vector<Point> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;

  std::vector<Triangle> soup() const {
    std::vector<Triangle> soup;
    for (const auto& [a, b, c] : triangles)
      soup.push_back({soup.size(), {vertices[a], vertices[b], vertices[c]}});
    return soup;
  }
};

// A torus around the z axis: n × m quadrilaterals, cut in two.
inline Shape torus(double major, double minor, std::uint32_t n, std::uint32_t m) {
  Shape shape;
  for (std::uint32_t i = 0; i < n; ++i)
    for (std::uint32_t j = 0; j < m; ++j) {
      const double u = 2 * std::numbers::pi * i / n, v = 2 * std::numbers::pi * j / m;
      const double r = major + minor * std::cos(v);
      shape.vertices.push_back({r * std::cos(u), r * std::sin(u), minor * std::sin(v)});
    }
  const auto at = [&](std::uint32_t i, std::uint32_t j) { return (i % n) * m + j % m; };
  for (std::uint32_t i = 0; i < n; ++i)
    for (std::uint32_t j = 0; j < m; ++j) {
      shape.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
      shape.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
    }
  return shape;
}

// Its sides are cut from the lower to the upper corner, so that two boxes cut one between them
// alike.
inline Shape box(const Point& low, const Point& high) {
  Shape shape;
  for (int k = 0; k < 8; ++k)
    shape.vertices.push_back(
        {k & 1 ? high.x : low.x, k & 2 ? high.y : low.y, k & 4 ? high.z : low.z});
  shape.triangles = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
                     {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
  return shape;
}

// A sphere around the origin, of n rings of m vertices between the poles.
inline Shape sphere(double radius, std::uint32_t n, std::uint32_t m) {
  Shape shape;
  shape.vertices.push_back({0, 0, -radius});
  for (std::uint32_t i = 1; i <= n; ++i)
    for (std::uint32_t j = 0; j < m; ++j) {
      const double u = std::numbers::pi * (-0.5 + 1.0 * i / (n + 1));
      const double v = 2 * std::numbers::pi * j / m;
      shape.vertices.push_back({radius * std::cos(u) * std::cos(v),
                                radius * std::cos(u) * std::sin(v), radius * std::sin(u)});
    }
  shape.vertices.push_back({0, 0, radius});
  const auto at = [&](std::uint32_t i, std::uint32_t j) { return 1 + i * m + j % m; };
  const std::uint32_t top = n * m + 1;
  for (std::uint32_t j = 0; j < m; ++j) {
    shape.triangles.push_back({0, at(0, j + 1), at(0, j)});
    for (std::uint32_t i = 0; i + 1 < n; ++i) {
      shape.triangles.push_back({at(i, j), at(i, j + 1), at(i + 1, j + 1)});
      shape.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i + 1, j)});
    }
    shape.triangles.push_back({at(n - 1, j), at(n - 1, j + 1), top});
  }
  return shape;
}

// A knife: its edge is `width` long, and `angle` (radians) sharp.
inline Shape wedge(double length, double width, double angle) {
  const double height = length * std::tan(angle);
  return {{{0, 0, 0},
           {length, 0, 0},
           {length, 0, height},
           {0, width, 0},
           {length, width, 0},
           {length, width, height}},
          {{0, 2, 1}, {3, 4, 5}, {0, 1, 4}, {0, 4, 3}, {1, 2, 5}, {1, 5, 4}, {2, 0, 3}, {2, 3, 5}}};
}

inline Shape box_shape(const Box& box) {
  Shape shape;
  for (int k = 0; k < 8; ++k)
    shape.vertices.push_back({(k & 1 ? box.max : box.min).x, (k & 2 ? box.max : box.min).y,
                              (k & 4 ? box.max : box.min).z});
  for (const std::array<std::uint32_t, 4>& q : {std::array<std::uint32_t, 4>{0, 2, 3, 1},
                                                {4, 5, 7, 6},
                                                {0, 1, 5, 4},
                                                {2, 6, 7, 3},
                                                {0, 4, 6, 2},
                                                {1, 3, 7, 5}}) {
    shape.triangles.push_back({q[0], q[1], q[2]});
    shape.triangles.push_back({q[0], q[2], q[3]});
  }
  return shape;
}

// So that nothing is along an axis.
inline Shape turned(Shape shape) {
  for (Point& p : shape.vertices)
    p = {0.8 * p.x - 0.6 * p.y, 0.48 * p.x + 0.64 * p.y - 0.6 * p.z,
         0.36 * p.x + 0.48 * p.y + 0.8 * p.z};
  return shape;
}

inline Shape translated(Shape shape, const Point& by) {
  for (Point& p : shape.vertices) p = p + by;
  return shape;
}

inline Shape together(Shape a, const Shape& b) {
  const auto offset = static_cast<std::uint32_t>(a.vertices.size());
  a.vertices.insert(a.vertices.end(), b.vertices.begin(), b.vertices.end());
  for (const auto& t : b.triangles)
    a.triangles.push_back({t[0] + offset, t[1] + offset, t[2] + offset});
  return a;
}

// Outside in: a cavity, in a larger one.
inline Shape inverted(Shape shape) {
  for (auto& [a, b, c] : shape.triangles) std::swap(b, c);
  return shape;
}

// Around the z axis, of n quadrilaterals around.
inline Shape pipe(double radius, double wall, double length, std::uint32_t n) {
  Shape shape;
  for (std::uint32_t i = 0; i < n; ++i)
    for (const double r : {radius, radius - wall})
      for (const double z : {0.0, length}) {
        const double u = 2 * std::numbers::pi * i / n;
        shape.vertices.push_back({r * std::cos(u), r * std::sin(u), z});
      }
  // Around the section: outside below and above, inside above and below.
  for (std::uint32_t i = 0; i < n; ++i)
    for (const auto& [v, w] :
         std::array<std::array<std::uint32_t, 2>, 4>{{{0, 1}, {1, 3}, {3, 2}, {2, 0}}}) {
      const std::uint32_t here = 4 * i, next = 4 * ((i + 1) % n);
      shape.triangles.push_back({here + v, next + v, next + w});
      shape.triangles.push_back({here + v, next + w, here + w});
    }
  return shape;
}

// A sphere's wall.
inline Shape shell(double radius, double wall, std::uint32_t n) {
  return together(sphere(radius, n, 2 * n), inverted(sphere(radius - wall, n, 2 * n)));
}

// Two, one of them along the axes: at their edges no spacing tells the sheets apart.
inline Shape knives() {
  constexpr double kAngle = 0.1;
  return together(turned(wedge(4, 8, kAngle)), translated(wedge(4, 8, kAngle), {9, 0, 0}));
}

inline void write_off(const Shape& shape, const std::filesystem::path& file) {
  std::ofstream out(file);
  out.precision(std::numeric_limits<double>::max_digits10);
  out << "OFF\n" << shape.vertices.size() << ' ' << shape.triangles.size() << " 0\n";
  for (const Point& p : shape.vertices) out << p.x << ' ' << p.y << ' ' << p.z << '\n';
  for (const auto& t : shape.triangles) out << "3 " << t[0] << ' ' << t[1] << ' ' << t[2] << '\n';
}

}  // namespace locvol::testing_shapes
