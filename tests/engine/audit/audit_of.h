// The audit of a mesh made by hand.
#pragma once

#include "engine/audit/audit.h"
#include "tests/engine/hand_made_mesh.h"
#include "tests/temp_dir.h"

namespace locvol {

inline AuditReport audit_of(const HandMadeStore& store) {
  const TempDir dir;
  return audit(store.write(dir / "store"));
}

inline AuditReport audit_of(const HandMadeMesh& mesh, const LinearOctree& octree = mixed_octree()) {
  return audit_of(HandMadeStore(mesh, octree));
}

}  // namespace locvol
