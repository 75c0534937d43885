// What is told of a cell whose angles are poor.
#pragma once

#include "octree/geometry.h"
#include "octree/morton_key.h"

namespace locvol {

// A cell with a dihedral angle below the run's bound, which C7 could not improve.
struct LeafPoorCell {
  MortonKey leaf;
  Point position;          // of its circumcenter; of a flat cell, of its centroid
  double radius = 0;       // of its circumball
  double degrees = 0;      // its smallest angle
  bool is_forced = false;  // by a wall or an acute crease: see ForcedAngles
};

}  // namespace locvol
