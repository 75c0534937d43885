// What the cells of a finished mesh are like: histograms of their shapes, extremes, volume.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "engine/exchange/exchange.h"
#include "engine/exchange/one_rank.h"
#include "engine/inspect/cell_gauge.h"
#include "engine/inspect/poor_cell.h"
#include "engine/shared/step_progress.h"
#include "octree/stop.h"
#include "storage/store.h"

namespace locvol {

// Streams over the cells that the store lists, of a rank's store its own. Those of the lattice core
// are all alike and are taken by formula, without the lattice's displacement of 2^-18 of its
// spacing. The result is the same for any number of threads. Steps are listed cells. Memory: for
// each thread a leaf, its cells, and 8 MB for the points around it. Throws StoreError unless the
// store holds a finished run; CorruptRecord, Stopped.
// `exchange`: of the ranks that have the mesh together. All call it and get the same,
// with the volume added up rank by rank. Where cells cannot be measured on one, throws that on it,
// and ExchangeError on the others, all of which may go on.
MeshStatistics mesh_statistics(const Store& store, int num_threads = 1,
                               const StepProgress& on_step = {}, const StopToken* stop = nullptr,
                               Exchange& exchange = alone());

// Visits all poor cells in the order of leaves, until `visit` returns false. They are found by
// measuring the cells, which is what mesh_statistics() does: same memory, same errors. There are
// none if the run has no bound.
void for_each_poor_cell(const Store& store, const std::function<bool(const LeafPoorCell&)>& visit,
                        int num_threads = 1, const StopToken* stop = nullptr);
// The first `max` poor cells at most. `exchange`: of the ranks that have the mesh together; all
// ranks call it and get the same.
std::vector<LeafPoorCell> first_poor_cells(const Store& store, std::uint64_t max,
                                           int num_threads = 1, Exchange& exchange = alone());

}  // namespace locvol
