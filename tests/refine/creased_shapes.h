// Closed surfaces with their sheets and creases, by brute force.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <numbers>
#include <numeric>
#include <utility>
#include <vector>

#include "refine/domain/domain_piece.h"

namespace locvol::creased_shapes {

inline constexpr double kPi = std::numbers::pi;

struct Creased {
  std::vector<Triangle> triangles;  // with their sheets
  std::vector<CreaseEdge> creases;
  double volume = 0;

  Box box() const {
    Box all = triangles.front().box();
    for (const Triangle& t : triangles) all = all.joined(t.box());
    return all;
  }
  double length() const {
    double sum = 0;
    for (const CreaseEdge& e : creases) sum += norm(e.ends[1] - e.ends[0]);
    return sum;
  }
  // All of it. REQUIRES: the region holds it
  DomainPiece piece(const Box& region) const {
    return {.triangles = triangles,
            .region = region,
            .reference = region.min,
            .reference_state = {},
            .is_whole = true,
            .creases = creases};
  }
};

// Edges are creases whose triangles turn by more than `degrees`, and sheets end there.
inline Creased creased(const std::vector<std::array<Point, 3>>& soup, double degrees = 40) {
  Creased shape;
  std::map<std::array<Point, 2>, std::vector<std::size_t>> edges;
  for (const auto& corners : soup) {
    for (std::size_t k = 0; k < 3; ++k) {
      const Point &a = corners[k], &b = corners[(k + 1) % 3];
      edges[{std::min(a, b), std::max(a, b)}].push_back(shape.triangles.size());
    }
    shape.volume += dot(corners[0], cross(corners[1], corners[2])) / 6;
    shape.triangles.push_back({shape.triangles.size(), corners});
  }
  const auto normal = [&](std::size_t t) {
    const auto& [a, b, c] = shape.triangles[t].corners;
    const Point n = cross(b - a, c - a);
    return (1 / norm(n)) * n;
  };
  std::vector<std::size_t> part(soup.size());
  std::iota(part.begin(), part.end(), std::size_t{0});
  const auto root = [&](std::size_t t) {
    while (part[t] != t) t = part[t];
    return t;
  };
  std::map<Point, std::vector<Point>> at;  // other ends of the creases there
  for (const auto& [ends, sides] : edges) {
    if (dot(normal(sides[0]), normal(sides[1])) < std::cos(degrees * kPi / 180)) {
      at[ends[0]].push_back(ends[1]);
      at[ends[1]].push_back(ends[0]);
    } else {
      const std::size_t one = root(sides[0]), other = root(sides[1]);
      part[std::max(one, other)] = std::min(one, other);
    }
  }
  std::map<std::size_t, SheetId> sheets;
  for (Triangle& t : shape.triangles)
    t.sheet = sheets.emplace(root(t.id), static_cast<SheetId>(sheets.size() + 1)).first->second;
  const auto is_corner = [&](const Point& p) {
    const std::vector<Point>& others = at.at(p);
    if (others.size() != 2) return true;
    const Point a = others[0] - p, b = others[1] - p;
    return -dot(a, b) < std::cos(kPi / 4) * norm(a) * norm(b);
  };
  for (const auto& [ends, sides] : edges) {
    if (dot(normal(sides[0]), normal(sides[1])) >= std::cos(degrees * kPi / 180)) continue;
    CreaseEdge edge{.ends = ends, .is_corner = {is_corner(ends[0]), is_corner(ends[1])}};
    edge.sheets = {shape.triangles[sides[0]].sheet, shape.triangles[sides[1]].sheet};
    std::ranges::sort(edge.sheets);
    shape.creases.push_back(edge);
  }
  return shape;
}

// Between a polygon, counterclockwise, and the same at another height, so far aside. The polygon is
// star-shaped around the origin.
inline Creased prism(const std::vector<Point>& polygon, double height, const Point& aside = {}) {
  std::vector<std::array<Point, 3>> soup;
  const Point up = Point{0, 0, height} + aside, below{0, 0, 0};
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Point &a = polygon[i], &b = polygon[(i + 1) % polygon.size()];
    soup.push_back({a, b, b + up});
    soup.push_back({a, b + up, a + up});
    soup.push_back({below, b, a});
    soup.push_back({up, a + up, b + up});
  }
  return creased(soup);
}

inline Creased cube(double side) {
  const double h = 0.5 * side;
  return prism({{h, h, 0}, {-h, h, 0}, {-h, -h, 0}, {h, -h, 0}}, side);
}

inline Creased cylinder(double radius, double height, int num_sides) {
  std::vector<Point> polygon;
  for (int i = 0; i < num_sides; ++i)
    polygon.push_back({radius * std::cos(2 * kPi * i / num_sides),
                       radius * std::sin(2 * kPi * i / num_sides), 0});
  return prism(polygon, height);
}

// A bar with an edge of so many degrees along z.
inline Creased bar(double degrees, double length) {
  const double half = 0.5 * degrees * kPi / 180;
  const Point tip{-0.5, 0, 0};
  const auto leg = [&](double angle) {
    return tip + Point{1.2 * std::cos(angle), 1.2 * std::sin(angle), 0};
  };
  return prism({tip, leg(-half), leg(half)}, length);
}

// A cross of two bars: reentrant edges.
inline Creased cross_bar(double side) {
  const double a = 0.2 * side, b = 0.5 * side;
  return prism({{b, -a, 0},
                {b, a, 0},
                {a, a, 0},
                {a, b, 0},
                {-a, b, 0},
                {-a, a, 0},
                {-b, a, 0},
                {-b, -a, 0},
                {-a, -a, 0},
                {-a, -b, 0},
                {a, -b, 0},
                {a, -a, 0}},
               side);
}

}  // namespace locvol::creased_shapes
