// Makes surfaces that can be meshed of such that cannot, in memory: by filling what is missing and
// dropping what is too much, or by wrapping all of it.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <vector>

#include "octree/geometry.h"
#include "octree/mesh_facet.h"

namespace locvol {

// Triangles whose vertices are all different points.
struct LooseSurface {
  std::vector<Point> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  std::vector<SheetId> groups;  // of each triangle; empty: there are none
};

// Added to the groups of triangles over wide holes, but where the rim lies in a plane: there the
// surface turns as the rim happens to be, and not as what it is of.
inline constexpr SheetId kOverHole = SheetId{1} << 31;

struct RepairLaw {
  double weld = 0;             // points at open edges that are closer become one,
  bool is_weld_given = false;  // unless that is more than a tenth of the shortest of these edges
  std::uint64_t most_hole_edges = 10'000;  // of one that is filled
  double most_dropped = 0.01;              // of the area
};

struct RepairChanges {
  std::uint64_t num_doubled = 0;  // triangles on others, dropped
  std::uint64_t num_joined = 0;   // points that became another
  double largest_move = 0;        // of these
  std::uint64_t num_fins = 0;     // triangles that stood on an edge of two others, dropped
  std::uint64_t num_loose = 0;    // triangles of open pieces that bound nothing, dropped
  double dropped_area = 0;        // of the area, of all that was dropped but doubled ones
  std::uint64_t num_turned = 0;   // triangles whose corners are in another order
  std::uint64_t num_holes = 0;    // filled, and with how many triangles
  std::uint64_t num_filling = 0;
  std::uint64_t largest_hole = 0;  // edges of it
};

// Why a surface cannot be repaired.
class CureError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// Removes triangles that lie on others, and those that stand on the surface as fins; joins points
// at open edges; gives triangles one orientation; drops loose pieces of few
// triangles; fills holes by triangles without new vertices, of the groups around them. The
// triangles that stay keep their order, those of holes follow. Throws CureError: it has no inside
// then, or more would be dropped, or a hole is too large.
LooseSurface repair_surface(LooseSurface surface, const RepairLaw& law, RepairChanges& changes);

// A closed surface around all triangles, at the distance `offset`, that bridges what a ball of
// radius `alpha` does not go through (Portaneri, Rouxel-Labbé, Hemmer, Cohen-Steiner, Alliez: Alpha
// wrapping with an offset, 2022).
LooseSurface wrap_surface(std::span<const Point> vertices,
                          std::span<const std::array<std::uint32_t, 3>> triangles, double alpha,
                          double offset);

}  // namespace locvol
