// Makes the surface of a run of the surface alone a 2-manifold where a vertex's disk (C3) was left
// unresolved: cells of the Delaunay triangulation go from the inside of it to the outside, as
// mend_boundary leaves them out, or where that does not help, from the outside to the inside. Only
// near ones do, with circumballs that are known to be empty, for they are the same cells whoever
// looks; and each of them once.
#pragma once

#include <tuple>
#include <vector>

#include "octree/stop.h"
#include "refine/leaf.h"
#include "refine/leaf_fields.h"

namespace locvol {

struct SurfaceMendInput {
  LeafInput leaf;  // its last visit does not matter
  // Cells at the leaf's points that have gone so far, with the bodies that they were in; their
  // vertices ascend, and so do they.
  std::vector<NamedCell> gone;
};

struct MendedSurface {
  struct Cell {
    NamedCell cell;  // vertices ascend: ids
    std::array<Point, 4> corners;
    friend bool operator==(const Cell&, const Cell&) = default;
  };
  std::vector<Cell> gone;  // besides
  FacetList facets;        // of the leaf, if nothing goes any more
};
auto fields(Maybe<MendedSurface::Cell> auto& cell) {
  auto& [named, corners] = cell;
  return std::tuple(Field("cell", named), Field("corners", corners));
}
auto fields(Maybe<MendedSurface> auto& mended) {
  auto& [gone, facets] = mended;
  return std::tuple(Field("gone", gone), Field("facets", facets));
}

// A pure function. Throws Stopped, RefineError. `stop` may be null
MendedSurface mend_surface(SurfaceMendInput input, const StopToken* stop);

}  // namespace locvol
