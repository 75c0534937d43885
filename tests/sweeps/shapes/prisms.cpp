#include "tests/sweeps/shapes/prisms.h"

#include <CGAL/Constrained_Delaunay_triangulation_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <map>
#include <utility>

namespace locvol::sweeps {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Triangulation = CGAL::Constrained_Delaunay_triangulation_2<
    Kernel, CGAL::Default, CGAL::No_constraint_intersection_requiring_constructions_tag>;
using Triangle2 = std::array<Point2, 3>;

// One by one: CGAL shuffles lists of points, each time in another way.
void insert(const Ring& ring, Triangulation& triangulation) {
  std::vector<Triangulation::Vertex_handle> vertices;
  for (const Point2& p : ring) vertices.push_back(triangulation.insert({p.x, p.y}));
  for (std::size_t i = 0; i < vertices.size(); ++i)
    triangulation.insert_constraint(vertices[i], vertices[(i + 1) % vertices.size()]);
}

// Faces by how many rings must be crossed to come to them from outside: odd is inside.
std::map<Triangulation::Face_handle, int> depths(const Triangulation& triangulation) {
  std::map<Triangulation::Face_handle, int> depth = {{triangulation.infinite_face(), 0}};
  std::deque<Triangulation::Face_handle> waiting = {triangulation.infinite_face()};
  while (!waiting.empty()) {
    const auto face = waiting.front();
    waiting.pop_front();
    for (int i = 0; i < 3; ++i) {
      const bool is_crossed = triangulation.is_constrained({face, i});
      const auto [entry, is_new] =
          depth.emplace(face->neighbor(i), depth[face] + (is_crossed ? 1 : 0));
      if (!is_new) continue;
      is_crossed ? waiting.push_back(entry->first) : waiting.push_front(entry->first);
    }
  }
  return depth;
}

// Counterclockwise; without vertices of its own.
std::vector<Triangle2> triangles_of(const Region& region) {
  Triangulation triangulation;
  for (const Ring& ring : region) insert(ring, triangulation);
  const auto depth = depths(triangulation);
  std::vector<Triangle2> triangles;
  // Not in the map's order, which is that of addresses.
  for (const auto face : triangulation.finite_face_handles()) {
    if (depth.at(face) % 2 == 0) continue;
    const auto corner = [&](int i) {
      return Point2{face->vertex(i)->point().x(), face->vertex(i)->point().y()};
    };
    triangles.push_back({corner(0), corner(1), corner(2)});
  }
  return triangles;
}

Point placed(const Point2& p, double z, double angle = 0) {
  if (angle == 0) return {p.x, p.y, z};  // exactly
  const double c = std::cos(angle), s = std::sin(angle);
  return {c * p.x - s * p.y, s * p.x + c * p.y, z};
}

std::vector<Point> placed(const Ring& ring, double z, double angle = 0) {
  std::vector<Point> points;
  for (const Point2& p : ring) points.push_back(placed(p, z, angle));
  return points;
}

void add_cap(ShapeBuilder& builder, const Region& region, double z, bool faces_up,
             double angle = 0) {
  for (const auto& [a, b, c] : triangles_of(region)) {
    const Point p = placed(a, z, angle), q = placed(b, z, angle), r = placed(c, z, angle);
    faces_up ? builder.triangle(p, q, r) : builder.triangle(p, r, q);
  }
}

// The wall from the top of the prism to that of the boss, and what is there.
void add_boss(ShapeBuilder& builder, const Boss& boss, double height) {
  builder.band(placed(boss.outline, height), placed(boss.outline, height + boss.height));
  add_cap(builder, {boss.outline}, height + boss.height, true);
}

}  // namespace

Ring rectangle(const Point2& min, const Point2& max) {
  return {{min.x, min.y}, {max.x, min.y}, {max.x, max.y}, {min.x, max.y}};
}

Ring regular_polygon(const Point2& center, double radius, int num_sides, double phase) {
  Ring ring;
  for (int i = 0; i < num_sides; ++i) {
    const double angle = 2 * kPi * (i + phase) / num_sides;
    ring.push_back({center.x + radius * std::cos(angle), center.y + radius * std::sin(angle)});
  }
  return ring;
}

Ring reversed(Ring ring) {
  std::ranges::reverse(ring);
  return ring;
}

double signed_area(const Ring& ring) {
  double sum = 0;
  for (std::size_t i = 0; i < ring.size(); ++i) {
    const Point2 &p = ring[i], &q = ring[(i + 1) % ring.size()];
    sum += p.x * q.y - q.x * p.y;
  }
  return sum / 2;
}

double area(const Region& region) {
  double sum = 0;
  for (const Ring& ring : region) sum += signed_area(ring);
  return sum;
}

Solid prism(const Region& region, double height, const std::vector<Boss>& bosses) {
  ShapeBuilder builder;
  Region top = region;
  double volume = area(region) * height;
  for (const Ring& ring : region) builder.band(placed(ring, 0), placed(ring, height));
  for (const Boss& boss : bosses) {
    top.push_back(reversed(boss.outline));
    volume += signed_area(boss.outline) * boss.height;
    add_boss(builder, boss, height);
  }
  add_cap(builder, region, 0, false);
  add_cap(builder, top, height, true);
  return {.shape = builder.take(),
          .volume = volume,
          .genus = static_cast<int>(region.size()) - 1,
          .num_components = 1};
}

Solid twisted_prism(const Region& region, double height, double angle, int num_steps) {
  ShapeBuilder builder;
  for (int step = 0; step < num_steps; ++step) {
    const double from = static_cast<double>(step) / num_steps;
    const double to = static_cast<double>(step + 1) / num_steps;
    for (const Ring& ring : region)
      builder.band(placed(ring, from * height, from * angle),
                   placed(ring, to * height, to * angle));
  }
  add_cap(builder, region, 0, false);
  add_cap(builder, region, height, true, angle);
  return {
      .shape = builder.take(), .genus = static_cast<int>(region.size()) - 1, .num_components = 1};
}

Solid turned(const Ring& profile, int num_sides) {
  ShapeBuilder builder;
  const double step = 2 * kPi / num_sides;
  double moment = 0;  // ∮ r² dz
  bool meets_axis = false;
  for (std::size_t i = 0; i < profile.size(); ++i) {
    const Point2 &p = profile[i], &q = profile[(i + 1) % profile.size()];
    const Ring from = regular_polygon({}, p.x, num_sides), to = regular_polygon({}, q.x, num_sides);
    builder.band(placed(from, p.y), placed(to, q.y));
    moment += (p.x * p.x + p.x * q.x + q.x * q.x) / 3 * (q.y - p.y);
    meets_axis |= p.x == 0;
  }
  return {.shape = builder.take(),
          .volume = num_sides * std::sin(step) / 2 * moment,
          .genus = meets_axis ? 0 : 1,
          .num_components = 1};
}

}  // namespace locvol::sweeps
