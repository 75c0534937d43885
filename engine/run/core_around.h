// The lattice core of a run: which sites are points of P that no record lists.
#pragma once

#include <cstdint>

#include "engine/run/run_state.h"
#include "refine/core_index.h"

namespace locvol {

// Of the leaves within `distance` of the leaf, all sites at most that far away.
CoreRows core_around(const RunView& state, MortonKey leaf, double distance);

// How many cells the leaf has whose vertices are all of the core, the smallest one its own.
std::uint64_t num_core_cells(const RunView& state, MortonKey leaf);

// Makes a point of the core one that the leaf's record lists, for it has a new neighbor: leaves at
// points around it are to be visited again, as a whole. REQUIRES: it is of the core
void make_explicit(RunState& state, const LatticeSite& site);
// The same of a point whose core's cells have not been counted, nor any listed.
void list_core_point(RunState& state, const LatticeSite& site);
bool is_core(const RunView& state, const LatticeSite& site);

}  // namespace locvol
