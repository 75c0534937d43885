// A leaf's visit done again, or before its time, from the store alone and for looking at: nothing
// is written.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "engine/cell_mesh.h"
#include "refine/refine_leaf.h"
#include "storage/store.h"

namespace locvol {

struct Replay {
  MortonKey leaf;
  Box box;
  double size = 0;                                               // λ
  LeafInfo info;                                                 // before the visit
  std::uint64_t num_own = 0, num_ghosts = 0, num_triangles = 0;  // what the visit was given
  std::vector<RefineStep> steps;
  LeafDelta delta;    // without its cells, which are in `mesh`
  std::string error;  // why the visit broke off (a RefineError), after `steps`; else empty
  CellMesh mesh;      // the leaf's cells after the visit; empty if it is to be split

  // Against what the store holds.
  std::uint64_t num_stored_cells = 0;
  std::uint64_t num_cells_gone = 0;  // in the store only
  std::uint64_t num_cells_new = 0;   // in the visit's result only

  bool is_clean() const { return !info.queued; }
  bool changes_points() const { return !delta.inserted.empty() || !delta.deleted.empty(); }
  // The same cells, and no point inserted or deleted: what a clean leaf's visit must give.
  bool reproduces() const {
    return error.empty() && !delta.is_overfull && !changes_points() && num_cells_gone == 0 &&
           num_cells_new == 0;
  }
};

// Visits `leaf` as of the store's last commit, whatever another process does meanwhile.
// Throws StoreError: no such leaf, damage in the leaf or around it, or a run not yet in refinement.
Replay replay(const Store& store, MortonKey leaf);

}  // namespace locvol
