#include "tests/sweeps/shapes/solid.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <string>
#include <utility>

namespace locvol::sweeps {
namespace {

using Edge = std::array<std::uint32_t, 2>;

Edge edge_of(const std::array<std::uint32_t, 3>& triangle, std::size_t i) {
  const std::uint32_t a = triangle[i], b = triangle[(i + 1) % 3];
  return {std::min(a, b), std::max(a, b)};
}

Point point_between(const Point& a, const Point& b, double fraction) {
  return a + fraction * (b - a);
}

}  // namespace

std::uint32_t ShapeBuilder::vertex(const Point& point) {
  // Without negative zeros, which equal others and have other bits.
  const Point unsigned_zero = {point.x + 0.0, point.y + 0.0, point.z + 0.0};
  const auto [entry, is_new] =
      vertices_.emplace(unsigned_zero, static_cast<std::uint32_t>(shape_.vertices.size()));
  if (is_new) shape_.vertices.push_back(unsigned_zero);
  return entry->second;
}

void ShapeBuilder::triangle(const Point& a, const Point& b, const Point& c) {
  if (a == b || b == c || c == a) return;
  const std::uint32_t first = vertex(a), second = vertex(b);
  shape_.triangles.push_back({first, second, vertex(c)});
}

void ShapeBuilder::quad(const Point& a, const Point& b, const Point& c, const Point& d) {
  triangle(a, b, c);
  triangle(a, c, d);
}

void ShapeBuilder::band(std::span<const Point> from, std::span<const Point> to) {
  for (std::size_t i = 0; i < from.size(); ++i) {
    const std::size_t next = (i + 1) % from.size();
    quad(from[i], from[next], to[next], to[i]);
  }
}

void ShapeBuilder::fan(std::span<const Point> ring, const Point& apex) {
  for (std::size_t i = 0; i < ring.size(); ++i)
    triangle(ring[i], ring[(i + 1) % ring.size()], apex);
}

double volume_of(const Shape& shape) {
  const Point origin = shape.vertices.front();  // so that a solid far away keeps its digits
  double sum = 0;
  for (const auto& [a, b, c] : shape.triangles)
    sum += dot(shape.vertices[a] - origin,
               cross(shape.vertices[b] - origin, shape.vertices[c] - origin));
  return sum / 6;
}

double area_of(const Shape& shape) {
  double sum = 0;
  for (const auto& [a, b, c] : shape.triangles)
    sum +=
        norm(cross(shape.vertices[b] - shape.vertices[a], shape.vertices[c] - shape.vertices[a]));
  return sum / 2;
}

Box box_of(const Shape& shape) {
  Box box = Box::around(shape.vertices.front());
  for (const Point& p : shape.vertices) box = box.joined(p);
  return box;
}

double smallest_height(const Shape& shape) {
  double smallest = HUGE_VAL;
  for (const auto& [a, b, c] : shape.triangles) {
    const Point &p = shape.vertices[a], &q = shape.vertices[b], &r = shape.vertices[c];
    const double longest = std::max({norm(p - q), norm(q - r), norm(r - p)});
    smallest = std::min(smallest, norm(cross(q - p, r - p)) / longest);
  }
  return smallest;
}

std::size_t num_edges(const Shape& shape) { return shape.triangles.size() * 3 / 2; }

Shape turned_inside_out(Shape shape) {
  for (auto& triangle : shape.triangles) std::swap(triangle[1], triangle[2]);
  return shape;
}

Shape scaled(Shape shape, const Point& by) {
  for (Point& p : shape.vertices) p = {p.x * by.x, p.y * by.y, p.z * by.z};
  return shape;
}

Shape rotated(Shape shape, const Axes& axes) {
  for (Point& p : shape.vertices) p = p.x * axes[0] + p.y * axes[1] + p.z * axes[2];
  return shape;
}

Axes random_rotation(Dice& dice) {
  const auto direction = [&] {
    const double z = dice.uniform(-1, 1), angle = dice.uniform(0, 2 * kPi);
    const double radius = std::sqrt(1 - z * z);
    return Point{radius * std::cos(angle), radius * std::sin(angle), z};
  };
  const Point x = direction();
  Point y = direction();
  y = y - dot(x, y) * x;
  y = (1 / norm(y)) * y;
  return {x, y, cross(x, y)};
}

Axes simple_rotation(Dice& dice) {
  constexpr std::array kDegrees = {45.0, 30.0, 1.0, 1e-3, 1e-6, 1e-9, 1e-13};
  const double angle = dice.one_of(kDegrees) * kPi / 180;
  const double tilt = dice.chance(0.5) ? dice.one_of(kDegrees) * kPi / 180 : 0;
  const double c = std::cos(angle), s = std::sin(angle), d = std::cos(tilt), t = std::sin(tilt);
  return {{{c, s * d, s * t}, {-s, c * d, c * t}, {0, -t, d}}};
}

Axes random_permutation(Dice& dice) {
  constexpr Axes kUnit = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
  const auto first = static_cast<std::size_t>(dice.integer(0, 2));
  Axes axes = {kUnit[first], kUnit[(first + 1) % 3], kUnit[(first + 2) % 3]};
  if (dice.chance(0.5)) axes = {-1.0 * axes[1], axes[0], axes[2]};  // a quarter turn
  return axes;
}

Shape subdivided(const Shape& shape) {
  Shape finer = {shape.vertices, {}};
  std::map<Edge, std::uint32_t> midpoints;
  const auto midpoint = [&](const std::array<std::uint32_t, 3>& triangle, std::size_t i) {
    const Edge edge = edge_of(triangle, i);
    const auto [entry, is_new] =
        midpoints.emplace(edge, static_cast<std::uint32_t>(finer.vertices.size()));
    if (is_new)
      finer.vertices.push_back(
          point_between(shape.vertices[edge[0]], shape.vertices[edge[1]], 0.5));
    return entry->second;
  };
  for (const auto& t : shape.triangles) {
    const std::uint32_t ab = midpoint(t, 0), bc = midpoint(t, 1), ca = midpoint(t, 2);
    finer.triangles.insert(finer.triangles.end(),
                           {{t[0], ab, ca}, {ab, t[1], bc}, {ca, bc, t[2]}, {ab, bc, ca}});
  }
  return finer;
}

Shape with_split_edges(const Shape& shape, double fraction, Dice& dice) {
  std::map<Edge, std::vector<std::size_t>> triangles_at;
  for (std::size_t t = 0; t < shape.triangles.size(); ++t)
    for (std::size_t i = 0; i < 3; ++i)
      triangles_at[edge_of(shape.triangles[t], i)].push_back(3 * t + i);
  Shape split = shape;
  std::vector<bool> is_split(shape.triangles.size());  // once in a call
  for (const auto& [edge, uses] : triangles_at) {
    const std::size_t first = uses[0], second = uses[1];
    if (is_split[first / 3] || is_split[second / 3] || dice.chance(0.3)) continue;
    const auto middle = static_cast<std::uint32_t>(split.vertices.size());
    split.vertices.push_back(
        point_between(shape.vertices[edge[0]], shape.vertices[edge[1]], fraction));
    for (const std::size_t use : {first, second}) {
      const std::size_t t = use / 3, i = use % 3;
      is_split[t] = true;
      auto half = split.triangles[t];
      half[i] = middle;
      split.triangles[t][(i + 1) % 3] = middle;
      split.triangles.push_back(half);
    }
  }
  return split;
}

Shape with_noise(Shape shape, double amplitude, Dice& dice) {
  for (Point& p : shape.vertices)
    for (int axis = 0; axis < 3; ++axis) p[axis] += dice.uniform(-amplitude, amplitude);
  return shape;
}

Shape rounded_to_float(Shape shape) {
  for (Point& p : shape.vertices)
    for (int axis = 0; axis < 3; ++axis) p[axis] = static_cast<float>(p[axis]);
  return shape;
}

void write_obj(const Solid& solid, const std::filesystem::path& file) {
  std::ofstream out(file);
  out.precision(std::numeric_limits<double>::max_digits10);
  for (const Point& p : solid.shape.vertices)
    out << "v " << p.x << ' ' << p.y << ' ' << p.z << '\n';
  std::uint32_t body = 0;
  for (std::size_t t = 0; t < solid.shape.triangles.size(); ++t) {
    if (solid.bodies[t] != body) out << "g body_" << (body = solid.bodies[t]) << '\n';
    const auto& [a, b, c] = solid.shape.triangles[t];
    out << "f " << a + 1 << ' ' << b + 1 << ' ' << c + 1 << '\n';
  }
}

void write_stl(const Shape& shape, const std::filesystem::path& file) {
  std::string bytes(80, ' ');  // and no name that begins with "solid"
  const auto append = [&](auto value) {
    std::array<char, sizeof value> raw;
    std::memcpy(raw.data(), &value, sizeof value);
    bytes.append(raw.data(), raw.size());
  };
  append(static_cast<std::uint32_t>(shape.triangles.size()));
  for (const auto& triangle : shape.triangles) {
    for (int i = 0; i < 3; ++i) append(0.0F);  // the normal: nobody needs it
    for (const std::uint32_t corner : triangle)
      for (int axis = 0; axis < 3; ++axis) append(static_cast<float>(shape.vertices[corner][axis]));
    append(std::uint16_t{0});
  }
  std::ofstream(file, std::ios::binary) << bytes;
}

}  // namespace locvol::sweeps
