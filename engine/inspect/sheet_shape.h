// What shape a sheet of the surface has: a plane, a cylinder or a sphere, or none of these. It is
// fitted to sums over the sheet's triangles, and checked at all of their corners.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "engine/shared/compensated_sum.h"
#include "octree/geometry.h"

namespace locvol {

enum class SheetForm : std::uint8_t { kOther, kPlane, kCylinder, kSphere };

struct SheetShape {
  SheetForm form = SheetForm::kOther;
  Point place;             // the sheet's centroid, a point of the axis, or the center
  Point direction;         // of a plane its normal, outward; of a cylinder its axis
  double radius = 0;       // of a cylinder or a sphere
  bool is_hollow = false;  // likewise: the surface faces the axis or the center
  double deviation = 0;    // of the corner that is farthest from it
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

  Point origin_;
  std::vector<CompensatedSum> sums_;
};

// Looks at the same triangles again, for how far they are from the shapes that were fitted to them.
class ShapeCheck {
 public:
  explicit ShapeCheck(const ShapeSums& sums);

  void add(const std::array<Point, 3>& corners);
  // The first of plane, cylinder and sphere whose corners are all within the tolerance. A cylinder
  // or a sphere is none that less than three triangles span: through few places there is one
  // always.
  SheetShape shape(double tolerance) const;

  // For another rank: what add() has found.
  std::vector<double> found() const;
  void add_found(std::span<const double> found);
  static constexpr std::size_t kNumFound = 9;

 private:
  struct Candidate {
    SheetShape shape;      // kOther: there is none
    double facing = 0;     // away from the axis or the center, times the area
    double most_turn = 0;  // of the shape's normal between two corners of a triangle
  };

  std::array<Candidate, 3> candidates_;
  double flatness_;
};

}  // namespace locvol
