#pragma once

#include "octree/geometry.h"

namespace locvol {

// How large a mesh is, known or estimated.
struct MeshSizes {
  double num_vertices = 0, num_cells = 0;
  double num_listed_cells = 0;  // not of the lattice core
  double num_boundary_facets = 0;
  bool has_creases = false;  // told of by formats with the boundary
  // As many as there are edges: what Euler's formula says of a ball.
  double num_nodes() const { return num_vertices + num_cells + num_boundary_facets / 2; }
  Box box;  // how long coordinates are as text
};

}  // namespace locvol
