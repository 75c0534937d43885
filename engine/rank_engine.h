// The engine of a run that several ranks work on at once.
#pragma once

#include <filesystem>

#include "engine/exchange/exchange.h"
#include "engine/ingest/surface_source.h"
#include "engine/plan/options.h"
#include "engine/run_steps.h"
#include "storage/records.h"

namespace locvol {

// mesh() by several ranks at once, each of which calls it and has a store of its own, which its
// number makes of options.store (store_of_rank()): what is the ranks' own in these, put together,
// is what mesh() makes. Goes on with what other ranks, as many or not, or one process, have begun.
// All take the input in, see ingest_by_ranks(), or the first one does. Of cover mode. `counts` of
// the summary's run: of all ranks. Throws ExchangeError, too.
RunSummary mesh_as_rank(const MeshOptions& options, const RunControl& control, Exchange& exchange);
// See mesh(). Where a surface is in no file, the first rank takes it in, and others do not ask for
// it.
RunSummary mesh_as_rank(const SurfaceSource& surface, const MeshOptions& options,
                        const RunControl& control, Exchange& exchange);
// The same of the run that the stores hold: needs neither the input nor the parameters.
RunSummary resume_as_rank(const std::filesystem::path& stores, const RunControl& control,
                          Exchange& exchange);
// Puts what all stores hold into one, which the first rank makes, for what one process does with a
// run. Called by any number of ranks, which see all of the run's stores: within a superstep, these
// end it first.
void join_ranks(const std::filesystem::path& stores, const std::filesystem::path& whole,
                const RunControl& control, Exchange& exchange);

}  // namespace locvol
