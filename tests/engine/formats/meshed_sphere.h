// A mesh that is large enough to be written in several pieces, and has a lattice core.
#pragma once

#include "engine/engine.h"
#include "tests/engine/closed_shapes.h"
#include "tests/temp_dir.h"

namespace locvol {

// Into dir / "store".
inline RunSummary mesh_sphere(const TempDir& dir, double size) {
  testing_shapes::write_off(testing_shapes::sphere(1, 31, 64), dir / "sphere.off");
  MeshOptions options;
  options.input = dir / "sphere.off";
  options.store = dir / "store";
  options.size = {size, false};
  options.leaf_capacity = 500;
  return mesh(options);
}

}  // namespace locvol
