// The engine meshes a closed surface out of core: which leaf next, load, refine, commit; then
// writer and audit stream the result from the store.
#pragma once

#include <cstdint>
#include <filesystem>

#include "engine/ingest/surface_source.h"
#include "engine/plan/options.h"
#include "storage/records.h"
#include "storage/store.h"

namespace locvol {

enum class RunOutcome { kDone, kUnresolved, kInterrupted };

struct RunSummary {
  RunOutcome outcome = RunOutcome::kDone;
  RunRecord run;
  std::uint64_t num_leaves = 0, max_visits_of_a_leaf = 0;
  double cpu_of_visits = 0;  // of several ranks: this one's, in seconds, since it started
};

// Starts a run, or goes on with the one that the store holds. Throws InputError, StoreError,
// StoreMismatch, OverBudget, RefineError: a VisitError, if it can be made again from the store.
// Throws Stopped where is_stopped() ends it before the run is known; then nothing is changed.
RunSummary mesh(const MeshOptions& options, const RunControl& control = {});
// Of any surface. REQUIRES: options.input is empty unless it is that file
RunSummary mesh(const SurfaceSource& surface, const MeshOptions& options,
                const RunControl& control = {});
// Goes on with the run in `store`; needs neither the input nor the parameters, but for an input
// that was in no file if it had not been taken in.
RunSummary resume(const std::filesystem::path& store, const RunControl& control = {});
// Does what comes before the first point, where sizes vary: then the store has them, and mesh()
// with the same options goes on from there. REQUIRES: they vary
RunSummary find_sizes(const MeshOptions& options, const RunControl& control = {});
RunSummary summarize(const Reader& reader);

class Exchange;
// mesh() by several ranks at once, each of which calls it and has a store of its own, which its
// number makes of options.store (store_of_rank()): what is the ranks' own in these, put together,
// is what mesh() makes. Goes on with what other ranks, as many or not, or one process, have begun.
// All
// take the input in, see ingest_by_ranks(), or the first one does. Of cover mode. `counts` of the
// summary's run: of all ranks. Throws ExchangeError, too.
RunSummary mesh_as_rank(const MeshOptions& options, const RunControl& control, Exchange& exchange);
// The same of the run that the stores hold: needs neither the input nor the parameters.
RunSummary resume_as_rank(const std::filesystem::path& stores, const RunControl& control,
                          Exchange& exchange);
// Puts what all stores hold into one, which the first rank makes, for what one process does with a
// run. Called by any number of ranks, which see all of the run's stores. Gives the run.
RunRecord join_ranks(const std::filesystem::path& stores, const std::filesystem::path& whole,
                     Exchange& exchange);

}  // namespace locvol
