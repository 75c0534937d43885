// The grains of a polycrystal: the Voronoi cells of points in a box.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <stdexcept>
#include <vector>

#include "octree/geometry.h"

namespace locvol {

inline constexpr std::uint32_t kNoGrain = std::numeric_limits<std::uint32_t>::max();

// Between two grains, or a grain and the outside of the cube.
struct GrainFace {
  std::array<std::uint32_t, 2> grains;  // the smaller first; the second is kNoGrain at the cube
  // Of a convex polygon, plane but for rounding, turning left as seen from the second grain.
  std::vector<std::uint32_t> vertices;
};

struct Grains {
  std::vector<Point> vertices;   // ascending
  std::vector<GrainFace> faces;  // ascending by grains
};

// These seeds make no grains that can be told apart.
class GrainError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// The grain of each seed in the cube from -1 to 1, numbered as the seeds are. Grains share the
// vertices and faces between them, so that together they fill the cube. Vertices are computed
// exactly, and rounded once, so where more than four grains meet there is one. Memory: 7 kB a
// grain. Throws GrainError: two seeds are one.
// REQUIRES: coordinates are multiples of 2^-40 between -1 and 1, without these
Grains voronoi_grains(std::span<const Point> seeds);

}  // namespace locvol
