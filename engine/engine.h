// The engine meshes a closed surface out of core: which leaf next, load, refine, commit; then
// writer and audit stream the result from the store.
#pragma once

#include <filesystem>

#include "engine/ingest/surface_source.h"
#include "engine/plan/options.h"
#include "engine/run_steps.h"

namespace locvol {

// Starts a run, or goes on with the one that the store holds. Throws InputError, StoreError,
// StoreMismatch, OverBudget, RefineError: a VisitError, if it can be made again from the store.
// Throws Stopped where is_stopped() ends it before the run is known; then nothing is changed.
RunSummary mesh(const MeshOptions& options, const RunControl& control = {});
// Of any surface. REQUIRES: options.input is what it comes from, or empty
RunSummary mesh(const SurfaceSource& surface, const MeshOptions& options,
                const RunControl& control = {});
// Goes on with the run in `store`; needs neither the input nor the parameters, but for an input
// that was in no file if it had not been taken in.
RunSummary resume(const std::filesystem::path& store, const RunControl& control = {});
// Does what comes before the first point, where sizes vary: then the store has them, and mesh()
// with the same options goes on from there. REQUIRES: they vary, and see mesh()
RunSummary find_sizes(const SurfaceSource& surface, const MeshOptions& options,
                      const RunControl& control = {});

}  // namespace locvol
