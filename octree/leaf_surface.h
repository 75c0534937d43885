// The surface in a part of space, for those who store it and pass it on. Where it has no triangles
// it has no creases or corners.
#pragma once

#include <cstddef>
#include <vector>

#include "octree/crease.h"
#include "octree/geometry.h"
#include "octree/sort_and_unite.h"

namespace locvol {

struct LeafSurface {
  std::vector<Triangle> triangles;        // all that meet the leaf's box, in order of id
  std::vector<CreaseEdge> creases = {};   // all that meet the closed box, in order of their ends
  std::vector<CornerPoint> corners = {};  // likewise, in order of id

  bool is_empty() const { return triangles.empty(); }
  std::size_t size() const { return triangles.size(); }
  std::size_t bytes() const {
    return triangles.size() * sizeof(Triangle) + creases.size() * sizeof(CreaseEdge) +
           corners.size() * sizeof(CornerPoint);
  }
  // Adds another part of the same surface. Once all is there, each thing is to be there once.
  void append(const LeafSurface& other) {
    const auto append = [](auto& all, const auto& some) {
      all.insert(all.end(), some.begin(), some.end());
    };
    append(triangles, other.triangles);
    append(creases, other.creases);
    append(corners, other.corners);
  }
  void unite() {
    sort_and_unite(triangles, &Triangle::id);
    sort_and_unite(creases, &CreaseEdge::ends);
    sort_and_unite(corners, &CornerPoint::corner);
  }
  friend bool operator==(const LeafSurface&, const LeafSurface&) = default;
};

}  // namespace locvol
