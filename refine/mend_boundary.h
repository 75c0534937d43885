// Makes the boundary of each body of a mesh a 2-manifold where a surface vertex's disk (C3) was
// left unresolved, by leaving cells out: what is left is still a part of the Delaunay
// triangulation, and no vertex comes twice.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "octree/body_id.h"

namespace locvol {

struct MendInput {
  std::uint32_t num_own =
      0;  // vertices below it are own: the cells include all of the mesh at them
  std::vector<bool> is_on_surface;                  // of all vertices
  std::vector<std::array<std::uint32_t, 4>> cells;  // each has an own vertex
  std::vector<BodyId> bodies = {};                  // of the cells; empty: one has all
  // Of the cells, those that cannot be left out, whatever becomes of the boundary; empty: none.
  std::vector<bool> is_kept = {};
};

// The places of the cells to be left out, ascending: then each own vertex that has cells of a body
// lies inside of it, or in facets of its boundary that form a disk. Own vertices are judged in
// ascending order, and again when a cell at them has gone:
//   - of parts of the star that hang together by the vertex or an edge alone, the largest stays;
//   - of fans of cells that meet at an edge of four or more boundary facets, the smallest goes;
//   - where the boundary has two cycles of facets around the vertex (a tunnel as thin as a point),
//     the star goes.
// Cells with a volume vertex, which would be laid bare, count before all others; so do those that
// are kept.
// A pure function; ends, for each step takes a cell. Time and memory: linear in the cells.
std::vector<std::uint32_t> mend_boundary(const MendInput& input);

}  // namespace locvol
