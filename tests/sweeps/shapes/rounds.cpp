// Families that turn about an axis, or follow a curve.
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "tests/sweeps/shapes/blocks.h"
#include "tests/sweeps/shapes/families.h"
#include "tests/sweeps/shapes/prisms.h"
#include "tests/sweeps/shapes/screw.h"

namespace locvol::sweeps {
namespace {

int num_sides_of_round(Dice& dice) {
  return dice.one_of(std::array{6, 8, 12, 16, 24, 32, 48, 64, 96});
}

// From the lower pole to the upper one, or only so far; exactly on the axis at the poles.
Ring arc(double radius, int num_steps, double share = 1) {
  Ring points;
  for (int i = 0; i <= num_steps; ++i) {
    const double angle = share * kPi * i / num_steps;
    const bool is_pole = i == 0 || (share == 1 && i == num_steps);
    points.push_back({is_pole ? 0 : radius * std::sin(angle), -radius * std::cos(angle)});
  }
  return points;
}

// A place on a curve, with the plane across it: u × v points along the curve.
struct Frame {
  Point center, u, v;
};

std::vector<Point> circle_in(const Frame& frame, double radius, int num_sides) {
  std::vector<Point> ring;
  for (int i = 0; i < num_sides; ++i) {
    const double angle = 2 * kPi * i / num_sides;
    ring.push_back(frame.center + radius * std::cos(angle) * frame.u +
                   radius * std::sin(angle) * frame.v);
  }
  return ring;
}

// The bands between rings, one after another.
void add_skin(ShapeBuilder& builder, const std::vector<Frame>& frames, double radius,
              int num_sides) {
  for (std::size_t i = 0; i + 1 < frames.size(); ++i)
    builder.band(circle_in(frames[i], radius, num_sides),
                 circle_in(frames[i + 1], radius, num_sides));
}

Solid wire(const std::vector<Frame>& frames, double radius, int num_sides) {
  ShapeBuilder builder;
  add_skin(builder, frames, radius, num_sides);
  std::vector<Point> start = circle_in(frames.front(), radius, num_sides);
  std::ranges::reverse(start);
  builder.fan(start, frames.front().center);
  builder.fan(circle_in(frames.back(), radius, num_sides), frames.back().center);
  return {.shape = builder.take(), .genus = 0, .num_components = 1};
}

Solid pipe(std::vector<Frame> frames, double outer, double inner, int num_sides) {
  ShapeBuilder builder;
  add_skin(builder, frames, outer, num_sides);
  builder.band(circle_in(frames.back(), outer, num_sides),
               circle_in(frames.back(), inner, num_sides));
  builder.band(circle_in(frames.front(), inner, num_sides),
               circle_in(frames.front(), outer, num_sides));
  std::ranges::reverse(frames);
  add_skin(builder, frames, inner, num_sides);
  return {.shape = builder.take(), .genus = 1, .num_components = 1};
}

// An arc about the y axis.
std::vector<Frame> bend(double radius, double angle, int num_steps) {
  std::vector<Frame> frames;
  for (int i = 0; i <= num_steps; ++i) {
    const double a = angle * i / num_steps;
    const Point outwards = {std::cos(a), 0, std::sin(a)};
    frames.push_back({radius * outwards, outwards, {0, 1, 0}});
  }
  return frames;
}

std::vector<Frame> helix(double radius, double pitch, double num_turns, int steps_a_turn) {
  std::vector<Frame> frames;
  const int num_steps = static_cast<int>(num_turns * steps_a_turn);
  for (int i = 0; i <= num_steps; ++i) {
    const double a = 2 * kPi * i / steps_a_turn;
    const Point outwards = {std::cos(a), std::sin(a), 0};
    Point along = {-radius * std::sin(a), radius * std::cos(a), pitch / (2 * kPi)};
    along = (1 / norm(along)) * along;
    const Point center = {radius * outwards.x, radius * outwards.y, pitch * i / steps_a_turn};
    frames.push_back({center, outwards, cross(along, outwards)});
  }
  return frames;
}

// How far out the thread is, from 0 to 1, at a share of a turn: a ramp up, the crest, a ramp down.
double thread_height(double turns, double flat) {
  const double phase = turns - std::floor(turns);
  const double ramp = 0.5 - flat;
  if (phase < flat) return 0;
  if (phase < flat + ramp) return (phase - flat) / ramp;
  if (phase < 2 * flat + ramp) return 1;
  return (1 - phase) / ramp;
}

}  // namespace

Solid make_sphere(Dice& dice) {
  const double radius = dice.length(0.5, 4);
  const int num_sides = num_sides_of_round(dice);
  return with_thickness(turned(arc(radius, std::max(num_sides / 2, 4)), num_sides), radius);
}

Solid make_torus(Dice& dice) {
  const double major = dice.length(1, 4), minor = dice.uniform(0.1, 0.6) * major;
  const int num_sides = num_sides_of_round(dice);
  const Ring profile = regular_polygon({major, 0}, minor, std::max(num_sides / 2, 8));
  return with_thickness(turned(profile, num_sides), std::min(minor, major - minor));
}

Solid make_shaft(Dice& dice) {
  const int num_sections = dice.integer(1, 7);
  const double bore = dice.chance(0.4) ? dice.length(0.05, 0.3) : 0;
  double z = 0, thickness = HUGE_VAL;
  Ring profile = {{bore, 0}};
  for (int i = 0; i < num_sections; ++i) {
    const double radius = 2 * bore + dice.length(0.1, 1), length = dice.length(0.05, 2);
    profile.push_back({radius, z});
    z += length;
    profile.push_back({radius, z});
    thickness = std::min({thickness, length, radius - bore});
  }
  profile.push_back({bore, z});
  if (bore > 0) thickness = std::min(thickness, bore);
  return with_thickness(turned(profile, num_sides_of_round(dice)), 0.8 * thickness);
}

Solid make_tube(Dice& dice) {
  const double outer = dice.length(0.3, 1),
               wall = dice.one_of(std::array{0.5, 0.2, 0.1, 0.03, 0.01});
  const double inner = outer * (1 - wall), length = dice.length(0.2, 6);
  const double thickness = 0.8 * std::min({outer - inner, inner, length});
  const int num_sides = num_sides_of_round(dice);
  if (dice.chance(0.5))
    return with_thickness(
        turned({{inner, 0}, {outer, 0}, {outer, length}, {inner, length}}, num_sides), thickness);
  const auto frames =
      bend(outer * dice.uniform(1.3, 4), dice.uniform(0.5, 4.5), dice.integer(12, 48));
  return with_thickness(pipe(frames, outer, inner, num_sides), 0.2 * thickness);
}

Solid make_cone(Dice& dice) {
  const double radius = dice.length(0.1, 3), height = dice.length(0.1, 5);
  const int num_sides = dice.one_of(std::array{3, 4, 5, 6, 12, 24, 48, 96});
  const int kind = dice.integer(0, 3);
  if (kind == 0) return turned({{0, 0}, {radius, 0}, {0, height}}, num_sides);
  if (kind == 1) return turned({{0, -dice.length(0.1, 5)}, {radius, 0}, {0, height}}, num_sides);
  if (kind == 2)  // a funnel
    return turned({{0, 0}, {radius, height}, {0.9 * radius, height}, {0, 0.1 * height}}, num_sides);
  const double tip = dice.one_of(std::array{0.5, 0.1, 0.01}) * radius;
  return turned({{0, 0}, {radius, 0}, {tip, height}, {0, height}}, num_sides);
}

Solid make_needle(Dice& dice) {
  const double length = dice.length(2, 10), width = length / dice.log_uniform(10, 1000);
  const int num_sides = dice.one_of(std::array{3, 4, 6, 12});
  const int kind = dice.integer(0, 2);
  if (kind == 0) {
    Blocks bar({{{0, length}, {0, width}, {0, width * dice.uniform(1, 3)}}});
    bar.set(0, 0, 0, true);
    return bar.solid();
  }
  if (kind == 1)
    return with_thickness(turned({{0, 0}, {width, 0}, {width, length}, {0, length}}, num_sides),
                          width);
  return turned({{0, 0}, {width, dice.uniform(0.1, 0.9) * length}, {0, length}}, num_sides);
}

Solid screw(const ScrewPlan& plan) {
  std::vector<std::vector<Point>> rings;
  for (int row = 0; row <= plan.num_turns * plan.rows_a_turn; ++row) {
    const double turns = static_cast<double>(row) / plan.rows_a_turn;
    std::vector<Point> ring;
    for (int side = 0; side < plan.num_sides; ++side) {
      const double share = static_cast<double>(side) / plan.num_sides;
      const double radius = plan.root + plan.depth * thread_height(turns - share, plan.flat);
      ring.push_back({radius * std::cos(2 * kPi * share), radius * std::sin(2 * kPi * share),
                      turns * plan.pitch});
    }
    rings.push_back(ring);
  }
  ShapeBuilder builder;
  for (std::size_t i = 0; i + 1 < rings.size(); ++i) builder.band(rings[i], rings[i + 1]);
  builder.fan(rings.back(), {0, 0, plan.num_turns * plan.pitch});
  std::ranges::reverse(rings.front());
  builder.fan(rings.front(), {0, 0, 0});
  // Grooves and crests may be sharp.
  return {.shape = builder.take(),
          .thickness = 0.1 * std::min(plan.pitch, plan.depth),
          .genus = 0,
          .num_components = 1};
}

Solid make_thread(Dice& dice) {
  ScrewPlan plan;
  plan.root = dice.length(0.3, 1);
  plan.pitch = dice.length(0.05, 0.5);
  plan.depth = dice.uniform(0.3, 1) * std::min(plan.pitch, plan.root);
  plan.flat = dice.uniform(0, 0.3);
  plan.num_turns = dice.integer(2, 8);
  plan.num_sides = dice.one_of(std::array{16, 24, 32, 48});
  plan.rows_a_turn = dice.one_of(std::array{6, 8, 12});
  return screw(plan);
}

Solid make_spring(Dice& dice) {
  const double wire_radius = dice.length(0.05, 0.3), gap = dice.length(0.01, 0.5);
  const double radius = wire_radius * dice.uniform(2, 8), pitch = 2.05 * wire_radius + gap;
  const int num_sides = dice.one_of(std::array{6, 8, 12});
  const auto frames = helix(radius, pitch, dice.uniform(1, 6), dice.one_of(std::array{16, 24, 32}));
  return with_thickness(wire(frames, wire_radius, num_sides), std::min(gap, wire_radius));
}

Solid make_shell(Dice& dice) {
  const double radius = dice.length(0.5, 3);
  const double inner = radius * (1 - dice.one_of(std::array{0.5, 0.2, 0.1, 0.03, 0.01}));
  const int num_sides = num_sides_of_round(dice), num_steps = std::max(num_sides / 2, 8);
  const double thickness = 0.8 * std::min(radius - inner, inner);
  if (dice.chance(0.5)) {  // a cup
    const double share = dice.uniform(0.3, 0.9);
    Ring profile = arc(radius, num_steps, share), back = arc(inner, num_steps, share);
    profile.insert(profile.end(), back.rbegin(), back.rend());
    return with_thickness(turned(profile, num_sides), thickness);
  }
  const Solid outside = turned(arc(radius, num_steps), num_sides);
  const Solid cavity = turned(arc(inner, num_steps), num_sides);
  return {.shape = together(outside.shape, turned_inside_out(cavity.shape)),
          .thickness = thickness,
          .volume = *outside.volume - *cavity.volume,
          .genus = 0,
          .num_components = 2};
}

}  // namespace locvol::sweeps
