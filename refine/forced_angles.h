// Which small dihedral angles of a finished mesh are the surface's own: those in walls and at
// creases that leave no room for larger ones.
#pragma once

#include <array>
#include <vector>

#include "octree/geometry.h"
#include "refine/domain/leaf_domain.h"

namespace locvol {

// A crease is acute where the angle inside, between its sheets, is below this. In degrees.
inline constexpr double kAcuteCrease = 30;

class ForcedAngles {
 public:
  // `piece`: the surface and its creases around the cells that are asked for, a λ beyond them.
  // `size`: λ. `min_dihedral`: the angle asked for, in degrees, above 0.
  ForcedAngles(DomainPiece piece, double size, double min_dihedral);

  // Of a cell with an angle below the bound. An acute crease forces it where two of the corners lie
  // on that crease; a wall does where all corners lie on the surface, on sides that face each other
  // across less than 0.87 of the bound's tangent times the longest edge.
  bool are_forced(const std::array<Point, 4>& corners) const;

 private:
  struct OnSurface {
    std::vector<Point> normals;  // of the sides there, unit, outwards; none if it is not on any
    CreaseId acute_crease = 0;   // if it is on one
  };
  OnSurface find(const Point& p) const;
  static double relative_width(const std::array<Point, 4>& corners,
                               const std::array<OnSurface, 4>& places);
  static double angle_inside(const Point& normal, const Point& way, const Point& other);

  double size_, min_dihedral_;
  LeafDomain domain_;
};

}  // namespace locvol
