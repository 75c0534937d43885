// What shape a sheet of the surface has: a plane, a cylinder, a sphere, a cone or a torus, or none
// of these. It is fitted to sums over the sheet's triangles, or to some of their corners, and
// checked at all of these.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "engine/shared/compensated_sum.h"
#include "octree/geometry.h"

namespace locvol {

enum class SheetForm : std::uint8_t { kOther, kPlane, kCylinder, kSphere, kCone, kTorus };

struct SheetShape {
  SheetForm form = SheetForm::kOther;
  Point place;             // the sheet's centroid, a point of the axis, the center, or the tip
  Point direction;         // of a plane its normal, outward; else the axis, of a cone from its tip
  double radius = 0;       // of a cylinder or a sphere; of the circle in the middle of a tube
  double tube_radius = 0;  // of a torus
  double half_angle = 0;   // of a cone, in radians
  bool is_hollow =
      false;             // of what is round: the surface faces the axis, the center, or the circle
  double deviation = 0;  // of the corner that is farthest from it
};

// Moments of a sheet's triangles, from which shapes are fitted. Sums of parts of a sheet, in any
// order, are those of the sheet.
class ShapeSums {
 public:
  // `origin`: moments are about it. The same for all parts of a sheet; near to it, for digits.
  explicit ShapeSums(const Point& origin = {}) : origin_(origin), sums_(kNumSums) {}

  void add(const std::array<Point, 3>& corners);
  double area() const { return value(kArea); }
  Point centroid() const;
  // Of its own area: 1 of a plane, less of what is bent, 0 of what is closed or has no area.
  double flatness() const;
  // Outward; its length is the area of what the sheet covers, seen from there.
  Point area_vector() const { return vector(kAreaVector); }

  // With the least squares of what is 0 on the shape; nothing where that tells none.
  SheetShape plane() const;
  std::optional<SheetShape> cylinder() const;
  std::optional<SheetShape> sphere() const;
  // Of all samples, as close as the tolerance.
  std::optional<SheetShape> cone(double tolerance) const;
  std::optional<SheetShape> torus(double tolerance) const;

  // Some of the corners, the same in whatever order they come: no two alike.
  std::vector<Point> samples() const;
  void add_sample(const Point& corner);
  static constexpr std::size_t kMostSamples = 48;

  // For another rank.
  std::span<const CompensatedSum> sums() const { return sums_; }
  void add(std::span<const CompensatedSum> sums);
  static constexpr std::size_t kNumSums = 34;

 private:
  // Where sums of a kind begin. Moments are of all corners of all triangles.
  enum : std::size_t {
    kArea = 0,
    kAreaVector = 1,
    kCentroid = 4,  // times the area
    kNormals = 7,   // products of the unit normal with itself, times the area: xx yy zz xy yz zx
    kNumCorners = 13,
    kFirst = 14,   // x y z
    kSecond = 17,  // xx yy zz xy yz zx
    kThird = 23    // of each axis thrice, then of two axes; and xyz. See third()
  };
  double value(std::size_t at) const { return sums_[at].value(); }
  Point vector(std::size_t at) const { return {value(at), value(at + 1), value(at + 2)}; }
  double second(const Point& a, const Point& b) const;
  double third(const Point& a, const Point& b, const Point& c) const;
  // Along which normals vary least, more, and most.
  std::array<Point, 3> axes_of_normals() const;

  Point origin_;
  std::vector<CompensatedSum> sums_;
  std::vector<std::pair<std::uint64_t, Point>> samples_;  // those of the smallest numbers
};

// Looks at the same triangles again, for how far they are from the shapes that were fitted to them.
class ShapeCheck {
 public:
  // `tolerance`: as for shape()
  ShapeCheck(const ShapeSums& sums, double tolerance);

  void add(const std::array<Point, 3>& corners);
  // The first of plane, cylinder, sphere, cone and torus whose corners are all within the
  // tolerance. A cylinder or a sphere is none that less than three triangles span: through few
  // places there is one always.
  SheetShape shape(double tolerance) const;

  // For another rank: what add() has found.
  std::vector<double> found() const;
  void add_found(std::span<const double> found);
  static constexpr std::size_t kNumFound = 15;

 private:
  struct Candidate {
    SheetShape shape;      // kOther: there is none
    double facing = 0;     // away from the axis or the center, times the area
    double most_turn = 0;  // of the shape's normal between two corners of a triangle
  };

  std::array<Candidate, 5> candidates_;
  double flatness_;
};

}  // namespace locvol
