// What runs of one process and of several have in common around their phases.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

#include "engine/ingest/ingest.h"
#include "engine/ingest/ingest_watch.h"
#include "engine/ingest/surface_source.h"
#include "engine/plan/disk_room.h"
#include "engine/plan/options.h"
#include "engine/shared/stop_source.h"
#include "octree/geometry.h"
#include "storage/records.h"
#include "storage/store.h"

namespace locvol {

enum class RunOutcome { kDone, kUnresolved, kInterrupted };

struct RunSummary {
  RunOutcome outcome = RunOutcome::kDone;
  RunRecord run;
  SurfaceSheets sheets;
  std::uint64_t num_leaves = 0, max_visits_of_a_leaf = 0;
  double cpu_of_visits = 0;  // of several ranks: this one's, in seconds, since it started
};
RunSummary summarize(const Reader& reader);
// Throws InputError.
void require_cells(const RunRecord& run);

// The run that `options` ask for, of a surface with this digest and bounding box. Throws
// InputError, Stopped.
RunRecord planned(const MeshOptions& options, const std::string& digest, const Box& box,
                  const StopSource& stop);
// The same of one that begins; what is to be said of its options is told.
RunRecord begun(const MeshOptions& options, const std::string& digest, const Box& box,
                const RunControl& control, const StopSource& stop);
// Is there room for the output, and can it be of that format? Before the work, rather than after
// it. Throws InputError.
void check_output(const RunRecord& run, const std::filesystem::path& store,
                  const RunControl& control, const DiskOf& disk = disk_of);

// See engine/ingest/cured_surface.h. Of a run that begins, and of one that is gone on with.
SurfaceSource source_to_mesh(const SurfaceSource& given, const MeshOptions& options,
                             const RunControl& control);
SurfaceSource source_to_mesh(const SurfaceSource& given, const RunParameters& parameters,
                             const std::filesystem::path& store, const RunControl& control);

// Of `num_ranks` which each have about as many triangles, one tells what all have done.
IngestWatch watch_of(const RunControl& control, const StopSource& stop, int num_ranks = 1);
IngestCalls ingest_calls(const std::filesystem::path& directory, std::function<Store()> open_store,
                         const RunControl& control, const DiskOf& disk);
// Takes in the surface for a run that `planned` makes of its digest and bounding box. Throws
// Stopped before that is known, with nothing changed.
Store ingested(const SurfaceSource& surface, const std::filesystem::path& directory,
               const std::function<RunRecord(const std::string& digest, const Box& box)>& planned,
               const std::function<Store()>& open_store, const RunControl& control,
               const StopSource& stop);

// The result of run(control, stop), in which the user's functions take turns.
template <class Run>
RunSummary in_turns(const RunControl& control, const Run& run) {
  const StopSource stop(control.is_stopped);
  RunControl in_turn = control;
  in_turn.on_progress = stop.in_turn(control.on_progress);
  in_turn.on_note = stop.in_turn(control.on_note);
  in_turn.on_run = stop.in_turn(control.on_run);
  in_turn.on_sizes = stop.in_turn(control.on_sizes);
  try {
    RunSummary summary = run(in_turn, stop);
    stop.rethrow();
    return summary;
  } catch (const Stopped&) {
    stop.rethrow();
    throw;
  }
}

}  // namespace locvol
