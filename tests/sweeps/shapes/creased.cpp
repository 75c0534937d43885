#include "tests/sweeps/shapes/creased.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <utility>

#include "tests/sweeps/shapes/prisms.h"
#include "tests/sweeps/shapes/screw.h"

namespace locvol::sweeps {
namespace {

constexpr double kLength = 7.3;  // of edges: no multiple of a step

double radians(double degrees) { return degrees * kPi / 180; }

// ---- Prisms

// A knife with this angle at the origin, symmetric about the x axis.
Ring wedge(double degrees) {
  const double half = radians(degrees) / 2, side = 5.1;
  return {{0, 0},
          {side * std::cos(half), -side * std::sin(half)},
          {side * std::cos(half), side * std::sin(half)}};
}

// A block with a notch of this angle.
Ring groove(double degrees) {
  const double half = radians(degrees) / 2;
  const double depth = std::min(2.5, 2 / std::tan(half)), width = depth * std::tan(half);
  return {{-4.2, -4}, {4.2, -4}, {4.2, 0}, {width, 0}, {0, -depth}, {-width, 0}, {-4.2, 0}};
}

Ring step(double height) {
  return {{-3.7, -3}, {4.1, -3}, {4.1, 0}, {0, 0}, {0, height}, {-3.7, height}};
}

Ring slot(double width) {
  return {{-4, -4}, {4, -4}, {4, 0}, {width, 0}, {width, -2.2}, {0, -2.2}, {0, 0}, {-4, 0}};
}

Ring plate(double thickness) { return rectangle({0, 0}, {thickness, 6.4}); }

// Edges of 90 degrees that run side by side on a plane face.
Ring bar_on_block(double width) {
  return {{-4, -3}, {4, -3}, {4, 0}, {width, 0}, {width, 1.3}, {0, 1.3}, {0, 0}, {-4, 0}};
}

// ---- Turned: a profile's edges are circles

constexpr int kNumSides = 96;

Ring lens(double degrees) {  // a rim with this angle
  const double radius = 5.2, height = radius * std::tan(radians(degrees) / 2);
  return {{0, -height}, {radius, 0}, {0, height}};
}

Ring ring_groove(double degrees) {
  const double half = radians(degrees) / 2;
  const double depth = std::min(2.0, 1.6 / std::tan(half)), width = depth * std::tan(half);
  return {{0, -3}, {6.2, -3}, {6.2, 0}, {4 + width, 0}, {4, -depth}, {4 - width, 0}, {0, 0}};
}

Ring cone(double degrees) {  // of this angle at its tip
  const double half = radians(degrees) / 2, height = std::min(8.0, 5 / std::tan(half));
  return {{0, 0}, {height * std::tan(half), 0}, {0, height}};
}

Ring frustum(double radius) { return {{0, 0}, {3.4, 0}, {radius, 5}, {0, 5}}; }

Ring spike(double radius) {  // on a disk
  return {{0, 0}, {4.3, 0}, {4.3, 1.6}, {radius, 1.6}, {0, 6.1}};
}

// ---- Corners of many creases

// A pyramid of two sides on a star: `num` creases meet in each of its two tips, of which every
// second one is a valley; of an odd number, none is.
Solid star(double num) {
  const int num_creases = static_cast<int>(num);
  const bool has_valleys = num_creases % 2 == 0 && num_creases > 4;
  ShapeBuilder builder;
  std::vector<Point> ring;
  for (int i = 0; i < num_creases; ++i) {
    const double angle = 2 * kPi * i / num_creases;
    const double radius = has_valleys && i % 2 == 1 ? 2.6 : 5;
    ring.push_back({radius * std::cos(angle), radius * std::sin(angle), 0});
  }
  builder.fan(ring, {0, 0, 4.2});
  std::ranges::reverse(ring);
  builder.fan(ring, {0, 0, -4.2});
  return {.shape = builder.take(), .genus = 0, .num_components = 1};
}

Solid gear(double pitch) {  // of its teeth
  constexpr int kNumTeeth = 14;
  const double root = kNumTeeth * pitch / (2 * kPi), depth = 0.6 * pitch;
  Ring outline;
  const auto add = [&](double radius, double turns) {
    outline.push_back({radius * std::cos(2 * kPi * turns), radius * std::sin(2 * kPi * turns)});
  };
  for (int i = 0; i < kNumTeeth; ++i) {
    add(root, (i + 0.0) / kNumTeeth);
    add(root + depth, (i + 0.15) / kNumTeeth);
    add(root + depth, (i + 0.45) / kNumTeeth);
    add(root, (i + 0.6) / kNumTeeth);
  }
  return prism({outline}, 3.3);
}

Solid thread(double pitch) {
  return screw({.root = std::max(1.5, 1.2 * pitch),
                .pitch = pitch,
                .depth = 0.6 * pitch,
                .flat = 0.15,
                .num_turns = 4,
                .num_sides = 48,
                .rows_a_turn = 12});
}

// ---- All of them

// Edges along z begin at other heights: no sample is beside another.
Shape oblique(Shape shape) {
  for (Point& p : shape.vertices) p.z += 0.37 * p.x + 0.23 * p.y;
  return shape;
}

class Shapes {
 public:
  template <typename Profile>
  void add_prisms(std::string_view kind, std::span<const double> measures, Profile profile) {
    add(kind, measures, [&](double measure) { return prism({profile(measure)}, kLength); });
  }
  template <typename Profile>
  void add_turned(std::string_view kind, std::span<const double> measures, Profile profile) {
    add(kind, measures,
        [&](double measure) { return sweeps::turned(profile(measure), kNumSides); });
  }
  template <typename Make>
  void add(std::string_view kind, std::span<const double> measures, Make make) {
    for (const double measure : measures) {
      Solid solid = make(measure);
      Solid other = solid;
      other.shape = testing_shapes::turned(oblique(std::move(other.shape)));
      shapes_.push_back({kind, measure, false, std::move(solid)});
      shapes_.push_back({kind, measure, true, std::move(other)});
    }
  }
  std::vector<CreasedShape> take() { return std::move(shapes_); }

 private:
  std::vector<CreasedShape> shapes_;
};

}  // namespace

std::string CreasedShape::name() const {
  return fmt::format("{} {:g}{}", kind, measure, is_oblique ? " oblique" : "");
}

// Where creases that are acute meet others at other angles than their mirrors, sites are left.
bool CreasedShape::is_to_be_whole() const {
  constexpr double kAboveFloor = 0.03;
  if (kind == "wedge") return measure <= (is_oblique ? 120 : 150) && (!is_oblique || measure >= 25);
  if (kind == "groove") return !is_oblique || measure >= 20;
  if (kind == "ring-groove") return measure >= 25;
  if (kind == "spike") return measure > kAboveFloor;
  if (kind == "slot" || kind == "step" || kind == "plate" || kind == "bar")
    return measure >= kAboveFloor;
  if (kind == "star") return measure <= 20;
  return true;
}

std::vector<CreasedShape> creased_shapes() {
  constexpr std::array kAngles{5.0,  8.0,  10.0, 12.0, 15.0,  18.0,  20.0,  25.0,  30.0, 40.0,
                               50.0, 60.0, 75.0, 90.0, 105.0, 120.0, 135.0, 150.0, 175.0};
  constexpr std::array kLengths{0.01, 0.03, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 3.0};
  constexpr std::array kTips{5.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0, 90.0, 120.0, 150.0};
  constexpr std::array kRadii{0.01, 0.03, 0.1, 0.3, 0.5, 1.0, 2.0};
  constexpr std::array kNumCreases{3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 16.0, 20.0, 24.0};
  constexpr std::array kPitches{0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0};
  Shapes shapes;
  shapes.add_prisms("wedge", kAngles, wedge);
  shapes.add_prisms("groove", kAngles, groove);
  shapes.add_turned("rim", kAngles, lens);
  shapes.add_turned("ring-groove", kAngles, ring_groove);
  shapes.add_prisms("step", kLengths, step);
  shapes.add_prisms("slot", kLengths, slot);
  shapes.add_prisms("plate", kLengths, plate);
  shapes.add_prisms("bar", kLengths, bar_on_block);
  shapes.add_turned("cone", kTips, cone);
  shapes.add_turned("frustum", kRadii, frustum);
  shapes.add_turned("spike", kRadii, spike);
  shapes.add("star", kNumCreases, star);
  shapes.add("gear", kPitches, gear);
  shapes.add("thread", kPitches, thread);
  return shapes.take();
}

}  // namespace locvol::sweeps
