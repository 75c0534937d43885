// TriangleSoup is a piece of a surface in memory, with its equal corners merged into vertices.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "octree/geometry.h"

namespace locvol {

using TriangleCorners = std::array<std::uint32_t, 3>;  // numbers of vertices

struct TriangleSoup {
  std::vector<Point> vertices;  // all different, in the order of their first appearance
  std::vector<TriangleCorners> triangles;
};

// REQUIRES: no coordinate is -0.0
TriangleSoup soup_of(std::span<const Triangle> triangles);

}  // namespace locvol
