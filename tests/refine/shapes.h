// Closed triangulated surfaces for the tests of refine/, and points on them. All are oriented
// outwards, with shared vertices of equal bits.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <functional>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

#include "octree/geometry.h"

namespace locvol::shapes {

using Mesh = std::vector<Triangle>;
using Random = std::mt19937_64;

inline const Box kCube{{-1, -1, -1}, {1, 1, 1}};

inline double uniform(Random& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}

inline Point uniform_in(Random& random, const Box& box) {
  const double x = uniform(random, box.min.x, box.max.x);
  const double y = uniform(random, box.min.y, box.max.y);
  return {x, y, uniform(random, box.min.z, box.max.z)};
}

inline Mesh numbered(const std::vector<std::array<Point, 3>>& corners) {
  Mesh mesh;
  for (const auto& c : corners) mesh.push_back({mesh.size(), c});
  return mesh;
}

inline Box bounding_box(const Mesh& mesh) {
  Box box = mesh.front().box();
  for (const Triangle& t : mesh) box = box.joined(t.box());
  return box;
}

// An icosahedron, each triangle cut into 4^depth.
inline Mesh icosphere(const Point& center, double radius, int depth) {
  constexpr double g = std::numbers::phi;
  const std::array<Point, 12> v{{{-1, g, 0},
                                 {1, g, 0},
                                 {-1, -g, 0},
                                 {1, -g, 0},
                                 {0, -1, g},
                                 {0, 1, g},
                                 {0, -1, -g},
                                 {0, 1, -g},
                                 {g, 0, -1},
                                 {g, 0, 1},
                                 {-g, 0, -1},
                                 {-g, 0, 1}}};
  constexpr std::array<std::array<std::size_t, 3>, 20> faces{
      {{0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
       {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
       {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}}};
  const auto unit = [](const Point& p) { return (1 / norm(p)) * p; };
  std::vector<std::array<Point, 3>> corners;
  for (const auto& [a, b, c] : faces) corners.push_back({unit(v[a]), unit(v[b]), unit(v[c])});
  for (; depth > 0; --depth) {
    std::vector<std::array<Point, 3>> finer;
    for (const auto& [a, b, c] : corners) {
      const Point ab = unit(a + b), bc = unit(b + c), ca = unit(c + a);
      finer.insert(finer.end(), {{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}});
    }
    corners = std::move(finer);
  }
  for (auto& triangle : corners)
    for (Point& p : triangle) p = center + radius * p;
  return numbered(corners);
}

// Around the z axis, of nu × nv quadrilaterals, cut in two.
inline Mesh torus(double major, double minor, int nu, int nv) {
  const auto at = [&](int i, int j) {
    const double u = 2 * std::numbers::pi * (i % nu) / nu, v = 2 * std::numbers::pi * (j % nv) / nv;
    const double r = major + minor * std::cos(v);
    return Point{r * std::cos(u), r * std::sin(u), minor * std::sin(v)};
  };
  std::vector<std::array<Point, 3>> corners;
  for (int i = 0; i < nu; ++i)
    for (int j = 0; j < nv; ++j) {
      corners.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
      corners.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
    }
  return numbered(corners);
}

inline Point corner_of(const Box& box, int k) {
  return {(k & 1 ? box.max : box.min).x, (k & 2 ? box.max : box.min).y,
          (k & 4 ? box.max : box.min).z};
}

// Corners of a box's faces as numbered by corner_of, counterclockwise from outside: -x, +x, -y, …
inline constexpr std::array<std::array<int, 4>, 6> kBoxFaces{
    {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}}};

inline void append_face(const Box& box, std::size_t face,
                        std::vector<std::array<Point, 3>>& corners) {
  const auto& q = kBoxFaces[face];
  corners.push_back({corner_of(box, q[0]), corner_of(box, q[1]), corner_of(box, q[2])});
  corners.push_back({corner_of(box, q[0]), corner_of(box, q[2]), corner_of(box, q[3])});
}

inline Mesh box(const Box& b) {
  std::vector<std::array<Point, 3>> corners;
  for (std::size_t face = 0; face < 6; ++face) append_face(b, face, corners);
  return numbered(corners);
}

// Two close parallel sheets, joined at their rims.
inline Mesh thin_plate(double side, double thickness) {
  return box({{0, 0, 0}, {side, side, thickness}});
}

// The boundary of the unit cubes (i, j, k) … (i+1, j+1, k+1) in [0, n)³ that `is_full` names: all
// coordinates are integers. Cubes that meet in an edge or a vertex only are allowed.
inline Mesh voxels(int n, const std::function<bool(int, int, int)>& is_full) {
  const auto is_in = [&](int i, int j, int k) {
    return 0 <= std::min({i, j, k}) && std::max({i, j, k}) < n && is_full(i, j, k);
  };
  std::vector<std::array<Point, 3>> corners;
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j)
      for (int k = 0; k < n; ++k) {
        if (!is_in(i, j, k)) continue;
        const Point low{double(i), double(j), double(k)};
        for (std::size_t face = 0; face < 6; ++face) {
          std::array<int, 3> other{i, j, k};
          other[face / 2] += face % 2 == 0 ? -1 : 1;
          if (!is_in(other[0], other[1], other[2]))
            append_face({low, low + Point{1, 1, 1}}, face, corners);
        }
      }
  return numbered(corners);
}

inline Mesh reversed(Mesh mesh) {
  for (Triangle& t : mesh) std::swap(t.corners[1], t.corners[2]);
  return mesh;
}

inline Mesh together(Mesh a, const Mesh& b) {
  for (Triangle t : b) {
    t.id = a.size();
    a.push_back(t);
  }
  return a;
}

// A hollow ball.
inline Mesh nested_shells(double outer, double inner, int depth) {
  return together(icosphere({0, 0, 0}, outer, depth), reversed(icosphere({0, 0, 0}, inner, depth)));
}

// Uniform random points of the surface, rounded.
inline std::vector<Point> random_points_on(const Mesh& mesh, std::size_t num, Random& random) {
  std::vector<double> areas;
  for (const Triangle& t : mesh)
    areas.push_back(norm(cross(t.corners[1] - t.corners[0], t.corners[2] - t.corners[0])));
  std::discrete_distribution<std::size_t> pick(areas.begin(), areas.end());
  std::vector<Point> points;
  for (std::size_t n = 0; n < num; ++n) {
    const auto& [a, b, c] = mesh[pick(random)].corners;
    double u = uniform(random, 0, 1), v = uniform(random, 0, 1);
    if (u + v > 1) u = 1 - u, v = 1 - v;
    points.push_back(a + u * (b - a) + v * (c - a));
  }
  return points;
}

}  // namespace locvol::shapes
