// A leaf's visit done again, or before its time, from the store alone and for looking at: nothing
// is written.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "engine/inspect/cell_mesh.h"
#include "refine/leaf.h"
#include "storage/store.h"

namespace locvol {

// A visit, and what the store held: a value, which can be kept in a file and visited elsewhere.
struct StoredVisit {
  MortonKey leaf;
  bool is_clean = false;
  std::uint32_t num_visits = 0;                      // before
  LeafInput input;                                   // in paper mode with all of the surface
  std::optional<std::vector<MeshPoint>> all_points;  // paper mode
  std::vector<NamedCell> cells;                      // the store's, by vertex ids, sorted
  std::uint64_t num_left_out = 0;                    // of the visit's cells, to mend the boundary
  friend bool operator==(const StoredVisit&, const StoredVisit&) = default;
};

// Takes it from the store's last commit, whatever another process does meanwhile.
// Throws StoreError: no such leaf, damage in the leaf or around it, or a run not yet in refinement.
StoredVisit stored_visit(const Store& store, MortonKey leaf);

struct Replay {
  std::vector<RefineStep> steps;
  LeafDelta delta;           // without its cells, which are in `mesh`
  std::uint64_t digest = 0;  // of the whole delta: equal visits give equal ones, on any machine
  std::string error;         // why the visit broke off, after `steps`; else empty
  CellMesh mesh;             // the leaf's cells after the visit; empty if it is to be split

  // Differences from what the store held.
  std::uint64_t num_cells_gone = 0;  // in the store only
  std::uint64_t num_cells_new = 0;   // in the visit's result only
  std::uint64_t num_left_out = 0;    // StoredVisit::num_left_out

  bool changes_points() const { return !delta.inserted.empty() || !delta.deleted.empty(); }
  // Tells whether the visit gave what that of a clean leaf must give: the same cells, but for those
  // left out later, and no point inserted or deleted.
  bool reproduces() const {
    return error.empty() && !delta.is_overfull && !changes_points() && num_cells_gone == 0 &&
           num_cells_new == num_left_out;
  }
};

Replay replay(const StoredVisit& visit);

}  // namespace locvol
