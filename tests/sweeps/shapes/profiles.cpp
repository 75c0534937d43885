// Families that are prisms over plane figures.
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "tests/sweeps/shapes/families.h"
#include "tests/sweeps/shapes/prisms.h"

namespace locvol::sweeps {
namespace {

Point2 polar(double radius, double angle) {
  return {radius * std::cos(angle), radius * std::sin(angle)};
}

int num_sides_of_hole(Dice& dice) { return dice.one_of(std::array{3, 4, 6, 8, 12, 24, 48}); }

// What lies between two lines that run side by side.
Ring strip(const std::vector<Point2>& right, const std::vector<Point2>& left) {
  Ring ring = right;
  ring.insert(ring.end(), left.rbegin(), left.rend());
  return ring;
}

// To the left of its way, from p to q.
Point2 normal(const Point2& p, const Point2& q) {
  const double length = std::hypot(q.x - p.x, q.y - p.y);
  return {(p.y - q.y) / length, (q.x - p.x) / length};
}

// The line at this distance to the left; its corners are mitered.
std::vector<Point2> beside(const std::vector<Point2>& line, double distance) {
  std::vector<Point2> moved;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const Point2 before = i > 0 ? normal(line[i - 1], line[i]) : normal(line[i], line[i + 1]);
    const Point2 after = i + 1 < line.size() ? normal(line[i], line[i + 1]) : before;
    const double by = distance / (1 + before.x * after.x + before.y * after.y);
    moved.push_back({line[i].x + by * (before.x + after.x), line[i].y + by * (before.y + after.y)});
  }
  return moved;
}

}  // namespace

Solid make_plate(Dice& dice) {
  const int nx = dice.integer(1, 4), ny = dice.integer(1, 4);
  const double pitch = dice.length(1, 2), height = dice.length(0.05, 1.5);
  Region region = {rectangle({0, 0}, {nx * pitch, ny * pitch})};
  std::vector<Boss> bosses;
  double thickness = std::min(height, 0.2 * pitch);  // between holes
  for (int j = 0; j < ny; ++j)
    for (int i = 0; i < nx; ++i) {
      if (dice.chance(0.2)) continue;
      const Point2 center = {(i + 0.5) * pitch, (j + 0.5) * pitch};
      const double radius = dice.uniform(0.1, 0.4) * pitch;
      const Ring ring = regular_polygon(center, radius, num_sides_of_hole(dice), 0.5);
      const int kind = dice.integer(0, 2);  // hole, pocket, boss
      const double depth = dice.one_of(std::array{0.5, 0.25, 0.9}) * height;
      if (kind == 0)
        region.push_back(reversed(ring));
      else
        bosses.push_back({ring, kind == 1 ? -depth : depth});
      thickness = std::min(thickness, radius);
      if (kind != 0) thickness = std::min({thickness, depth, height - depth});
    }
  return with_thickness(prism(region, height, bosses), thickness);
}

Solid make_steps(Dice& dice) {
  const int num_steps = dice.integer(2, 12);
  const double run = dice.length(0.2, 1), rise = dice.length(0.02, 1), width = dice.length(0.1, 4);
  const double base = dice.length(0.05, 1);
  const double length = num_steps * run;
  // Counterclockwise, down the stairs from the left end, where they are highest.
  Ring profile = {{0, 0}, {length, 0}};
  for (int i = 0; i < num_steps; ++i) {
    const double top = base + i * rise;
    profile.push_back({length - i * run, top});
    profile.push_back({length - (i + 1) * run, top});
  }
  profile.back().x = 0;
  return with_thickness(prism({profile}, width), std::min({run, rise, base, width}));
}

Solid make_ribs(Dice& dice) {
  const int num_ribs = dice.integer(2, 10);
  const double rib = dice.length(0.02, 0.5), gap = dice.length(0.05, 0.5);
  const double height = dice.length(0.2, 3), base = dice.length(0.1, 0.5);
  const double width = dice.length(0.2, 4), draft = dice.chance(0.3) ? 0.3 * rib : 0;
  const double length = num_ribs * rib + (num_ribs - 1) * gap;
  Ring profile = {{0, 0}, {length, 0}};
  for (int i = num_ribs - 1; i >= 0; --i) {
    const double start = i * (rib + gap), end = start + rib;
    if (i < num_ribs - 1) profile.push_back({end, base});
    profile.push_back({end - draft, base + height});
    profile.push_back({start + draft, base + height});
    if (i > 0) profile.push_back({start, base});
  }
  // The outermost ribs have no foot of their own.
  return with_thickness(prism({profile}, width), std::min({rib - 2 * draft, gap, base, width}));
}

Solid make_gear(Dice& dice) {
  const int num_teeth = dice.integer(5, 40);
  const double root = dice.length(1, 3), height = dice.length(0.1, 2);
  const double depth = dice.uniform(0.05, 0.4) * root, tip_share = dice.uniform(0.1, 0.9);
  Ring outline;
  for (int i = 0; i < num_teeth; ++i) {
    const double step = 2 * kPi / num_teeth, start = i * step;
    outline.push_back(polar(root, start));
    outline.push_back(polar(root + depth, start + 0.3 * step * (1 - tip_share)));
    outline.push_back(polar(root + depth, start + 0.3 * step * (1 + tip_share)));
    outline.push_back(polar(root, start + 0.6 * step));
  }
  const double bore = dice.uniform(0.1, 0.7) * root;
  Region region = {outline};
  if (dice.chance(0.7)) region.push_back(reversed(regular_polygon({}, bore, 4 * num_teeth)));
  const double tooth = 2 * kPi * root / num_teeth;
  const double thickness =
      std::min({height, 0.6 * tooth * tip_share, 0.4 * tooth, bore, 0.25 * root, depth});
  if (dice.chance(0.3))
    return with_thickness(twisted_prism({region}, height, dice.uniform(-0.5, 0.5) * height / root,
                                        dice.integer(3, 12)),
                          0.5 * thickness);
  return with_thickness(prism(region, height), thickness);
}

Solid make_spiral(Dice& dice) {
  const int num_turns = dice.integer(2, 8), num_steps = 48;
  const double thickness = dice.length(0.01, 0.2), gap = dice.length(0.01, 0.2);
  const double first = dice.length(0.3, 1), height = dice.length(0.05, 2);
  std::vector<Point2> inner, outer;
  for (int i = 0; i <= num_turns * num_steps; ++i) {
    const double turns = static_cast<double>(i) / num_steps;
    const double angle = 2 * kPi * (i % num_steps) / num_steps;  // the same in each turn
    const double radius = first + turns * (thickness + gap);
    inner.push_back(polar(radius, angle));
    outer.push_back(polar(radius + thickness, angle));
  }
  // Counterclockwise with the outer side first.
  return with_thickness(prism({strip(outer, inner)}, height),
                        std::min({0.9 * thickness, 0.9 * gap, height}));
}

Solid make_fold(Dice& dice) {
  const int num_folds = dice.integer(1, 5);
  const double thickness = dice.length(0.01, 0.3), reach = dice.length(0.5, 2);
  const double width = dice.length(0.3, 3), gap = dice.length(0.05, 1) + thickness;
  const double slant = dice.chance(0.3) ? dice.uniform(0, 0.4) * gap : 0;
  std::vector<Point2> line;  // a meander: to the right, up, to the left, up ...
  for (int i = 0; i <= num_folds; ++i) {
    const Point2 left = {0, i * gap + slant}, right = {reach, i * gap};
    line.push_back(i % 2 == 0 ? left : right);
    line.push_back(i % 2 == 0 ? right : left);
  }
  return with_thickness(
      prism({strip(beside(line, -thickness / 2), beside(line, thickness / 2))}, width),
      std::min({thickness, gap - thickness, width}));
}

Solid make_wedge(Dice& dice) {
  const double length = dice.length(1, 4), width = dice.length(0.2, 4);
  const double angle = dice.log_uniform(0.2, 60) * kPi / 180;
  const double height = length * std::tan(angle);
  const int kind = dice.integer(0, 3);
  if (kind == 0) return prism({{{0, 0}, {length, 0}, {length, height}}}, width);
  if (kind == 1)  // two edges, as of a lens
    return prism({{{0, 0}, {length / 2, -height / 4}, {length, 0}, {length / 2, height / 4}}},
                 width);
  if (kind == 2)  // a box with a chisel's edge
    return prism({{{0, 0},
                   {length, -height},
                   {2 * length, -height},
                   {2 * length, height},
                   {length, height}}},
                 width);
  // A tetrahedron between two edges that cross at a distance.
  const Point a = {-length / 2, 0, 0}, b = {length / 2, 0, 0};
  const Point c = {0, -width / 2, height}, d = {0, width / 2, height};
  ShapeBuilder builder;
  builder.triangle(a, b, c);
  builder.triangle(a, d, b);
  builder.triangle(a, c, d);
  builder.triangle(b, d, c);
  return {.shape = builder.take(),
          .volume = length * width * height / 6,
          .genus = 0,
          .num_components = 1};
}

Solid make_twist(Dice& dice) {
  const double width = dice.length(0.5, 2), depth = dice.length(0.05, 1),
               length = dice.length(2, 8);
  const double wall = 0.2 * std::min(width, depth);
  Region region = {rectangle({-width / 2, -depth / 2}, {width / 2, depth / 2})};
  const bool is_hollow = dice.chance(0.3);
  if (is_hollow)
    region.push_back(reversed(
        rectangle({-width / 2 + wall, -depth / 2 + wall}, {width / 2 - wall, depth / 2 - wall})));
  // Steps so small that a side does not bend into the other, which is 0.6 of the depth away.
  const double turn = dice.uniform(0.5, 6);
  const int num_steps = std::max(8, static_cast<int>(turn * 10 * std::max(width / depth, 1.0)));
  return with_thickness(twisted_prism(region, length, turn, std::min(num_steps, 400)),
                        0.7 * (is_hollow ? wall : std::min(width, depth)));
}

}  // namespace locvol::sweeps
