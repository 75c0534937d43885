// Closed surfaces with what is known of them, the tools that make them, and what can be done to
// any.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <numbers>
#include <optional>
#include <span>
#include <vector>

#include "octree/geometry.h"
#include "tests/engine/closed_shapes.h"
#include "tests/sweeps/shapes/dice.h"

namespace locvol::sweeps {

using testing_shapes::Shape;

inline constexpr double kPi = std::numbers::pi;

// A surface that is closed, manifold and oriented outwards, and claims about it that do not come
// from its triangles.
struct Solid {
  Shape shape;
  // The thinnest wall or gap; 0 where two faces meet at an acute angle, so that it has no least.
  double thickness = 0;
  std::optional<double> volume = {};
  std::optional<int> genus = {};  // of all components together
  std::optional<int> num_components = {};
  // Which body each triangle is of, from 1 on; empty: there is one. Each is closed by itself, and
  // shares vertices with others.
  std::vector<std::uint32_t> bodies = {};
};

inline Solid with_thickness(Solid solid, double thickness) {
  solid.thickness = thickness;
  return solid;
}

// Collects triangles by the coordinates of their corners: the same coordinates, the same vertex.
class ShapeBuilder {
 public:
  // Does nothing if two corners coincide: so rings may shrink to a pole.
  void triangle(const Point& a, const Point& b, const Point& c);
  void quad(const Point& a, const Point& b, const Point& c, const Point& d);  // cut from a to c
  // A band from one ring to the next, with as many points; seen from the tip of the band, rings
  // turn counterclockwise.
  void band(std::span<const Point> from, std::span<const Point> to);
  void fan(std::span<const Point> ring, const Point& apex);  // counterclockwise from outside
  Shape take() { return std::move(shape_); }

 private:
  std::uint32_t vertex(const Point& point);

  Shape shape_;
  std::map<Point, std::uint32_t> vertices_;
};

double volume_of(const Shape& shape);
double area_of(const Shape& shape);
Box box_of(const Shape& shape);
double smallest_height(const Shape& shape);  // of its triangles
std::size_t num_edges(const Shape& shape);

Shape turned_inside_out(Shape shape);
Shape scaled(Shape shape, const Point& by);
// Orthonormal axes: the images of those of x, y and z.
using Axes = std::array<Point, 3>;
Shape rotated(Shape shape, const Axes& axes);
Axes random_rotation(Dice& dice);
// About z and then x: of 45 or 30 degrees, or next to none.
Axes simple_rotation(Dice& dice);
// Exact: axes go to axes.
Axes random_permutation(Dice& dice);

// Each triangle in four.
Shape subdivided(const Shape& shape);
// Many edges get a vertex at this fraction of their length, and make their triangles thinner.
Shape with_split_edges(const Shape& shape, double fraction, Dice& dice);
// Each coordinate moves by at most `amplitude`.
Shape with_noise(Shape shape, double amplitude, Dice& dice);
Shape rounded_to_float(Shape shape);

// OBJ, each body a group.
void write_obj(const Solid& solid, const std::filesystem::path& file);
// Binary STL: float32.
void write_stl(const Shape& shape, const std::filesystem::path& file);

}  // namespace locvol::sweeps
