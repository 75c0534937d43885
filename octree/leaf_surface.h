// The surface in a part of space, for those who store it and pass it on.
#pragma once

#include <cstddef>
#include <vector>

#include "octree/geometry.h"

namespace locvol {

struct LeafSurface {
  std::vector<Triangle> triangles;  // all that meet the leaf's box, in order of id

  bool is_empty() const { return triangles.empty(); }
  std::size_t size() const { return triangles.size(); }
  std::size_t bytes() const { return triangles.size() * sizeof(Triangle); }
  friend bool operator==(const LeafSurface&, const LeafSurface&) = default;
};

}  // namespace locvol
