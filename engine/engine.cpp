#include "engine/engine.h"

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "engine/ingest/cad_input.h"
#include "engine/ingest/option_files.h"
#include "engine/plan/run_setup.h"
#include "engine/plan/same_run.h"
#include "engine/run/run_timeline.h"
#include "engine/run_phases.h"
#include "engine/shared/input_error.h"
#include "engine/shared/memory_budget.h"
#include "engine/shared/standard_input.h"
#include "engine/shared/stop_source.h"

namespace locvol {
namespace {

// When the first process began that worked on the run, in seconds since 1970; 0: none has yet.
std::uint64_t started(const Reader& reader) {
  const TimelineRecord timeline = reader.timeline();
  return timeline.samples.empty() ? 0 : timeline.samples.front().started;
}

// The run in the store, if it is the one that is asked for. Nothing: it is to begin, over what
// there is. Throws StoreMismatch.
std::optional<RunRecord> run_to_go_on_with(const SurfaceSource& surface, const MeshOptions& options,
                                           const StopSource& stop) {
  if (!Store::exists(options.store)) return std::nullopt;
  const Store store = Store::open(options.store, {.read_only = true});
  require_whole_run(store);
  const Snapshot reader = store.snapshot();
  const auto held = reader.run();
  if (!held || held->phase == Phase::kIngest) return std::nullopt;
  const RunRecord asked = planned(options, surface.digest(&stop), held->surface.box, stop);
  if (held->parameters == asked.parameters) return held;
  if (options.is_forced || is_in_vain(*held)) return std::nullopt;
  require_same_run(*held, asked, options.store, started(reader));
  return held;
}

RunSummary interrupted(const Store& store) {
  RunSummary summary = summarize(store.snapshot());
  summary.outcome = RunOutcome::kInterrupted;
  return summary;
}

RunSummary finish(Store& store, const RunControl& control, const StopSource& stop,
                  const WorkClock& clock, Phase until = Phase::kDone) {
  const RunRecord run = store.snapshot().run().value();
  if (run.phase == Phase::kIngest) return interrupted(store);
  check_output(run, store.directory(), control);
  const MemoryPlan plan = planned_memory(store.snapshot(), memory_cap(control.memory_bytes));
  try {
    const auto on_sizes = [&](const RunRecord& known) {
      require_few_cells(known);
      check_output(known, store.directory(), control);
      if (control.on_sizes) control.on_sizes(known);
    };
    RunPhases(store, plan, control.num_threads, control.on_progress, stop, clock)
        .run(until, on_sizes);
  } catch (const Stopped&) {
    return interrupted(store);
  }
  if (until != Phase::kDone) return interrupted(store);
  RunSummary summary = summarize(store.snapshot());
  require_cells(summary.run);
  return summary;
}

RunSummary mesh(const SurfaceSource& given, const MeshOptions& asked, const RunControl& control,
                const StopSource& stop, Phase until = Phase::kDone) {
  const WorkClock clock;
  MeshOptions options = asked;
  const SurfaceSource surface = source_to_mesh(given, options, control);
  settle_faces(surface, options, memory_cap(control.memory_bytes), &stop);
  if (const auto held = run_to_go_on_with(surface, options, stop)) {
    Store store = Store::open(options.store);
    if (control.on_run) control.on_run(*held);
    surface.release();
    return finish(store, control, stop, clock, until);
  }
  Store store = ingested(
      surface, options.store,
      [&](const std::string& digest, const Box& box) {
        return begun(options, digest, box, control, stop);
      },
      [&] { return Store::open(options.store, {.create = true}); }, control, stop);
  surface.release();
  return finish(store, control, stop, clock, until);
}

void require_same_files(const RunRecord& run, const std::filesystem::path& store,
                        const StopSource& stop) {
  const FilesOfOptions files = survey_files(run, &stop);
  const auto require_same = [&](bool is_same, const char* what, const std::string& file) {
    if (!is_same)
      throw StoreMismatch("the store " + store.string() + " was to take in " + what + " from " +
                          file + ", which is another file by now: restore it, or force a new run");
  };
  require_same(files.image.digest == run.parameters.size_image, "sizes", run.image_file);
  require_same(files.sharp_polylines == run.parameters.sharp_polylines, "sharp edges",
               run.sharp_file);
}

RunSummary resume(const std::filesystem::path& directory, const RunControl& control,
                  const StopSource& stop) {
  const WorkClock clock;
  Store store = Store::open(directory);
  require_whole_run(store);
  const auto held = store.snapshot().run();
  if (!held) throw StoreError(directory.string() + ": the store holds no run to go on with");
  if (held->phase == Phase::kIngest) {
    if (held->surface.file == kInMemory)
      throw StoreError("the store " + directory.string() +
                       " was to take in a surface that is in no file: give it again to the program "
                       "that began the run");
    const std::vector<std::string>& more = held->surface.more_files;
    const SurfaceSource surface =
        source_to_mesh(held->surface.file == kStandardInput
                           ? surface_in_standard_input(directory)
                           : surface_at(held->surface.file, {more.begin(), more.end()}, directory),
                       held->parameters, directory, control);
    try {
      cut_faces_for(surface, held->parameters, memory_cap(control.memory_bytes), &stop);
      store = ingested(
          surface, directory,
          [&](const std::string& digest, const Box&) {
            if (digest != held->parameters.input_digest)
              throw StoreMismatch("the store " + directory.string() + " was to take in " +
                                  held->surface.file +
                                  ", which is another file by now: restore it, or force a new run");
            require_same_files(*held, directory, stop);
            return *held;
          },
          [&] { return std::move(store); }, control, stop);
      surface.release();
    } catch (const Stopped&) {
      return interrupted(store);
    }
  } else if (control.on_run) {
    control.on_run(*held);
  }
  return finish(store, control, stop, clock);
}

}  // namespace

RunSummary mesh(const MeshOptions& options, const RunControl& control) {
  return mesh(surface_at(options.input, options.more_inputs, options.store), options, control);
}

RunSummary mesh(const SurfaceSource& surface, const MeshOptions& options,
                const RunControl& control) {
  return in_turns(control, [&](const RunControl& in_turn, const StopSource& stop) {
    return mesh(surface, options, in_turn, stop);
  });
}

RunSummary find_sizes(const SurfaceSource& surface, const MeshOptions& options,
                      const RunControl& control) {
  return in_turns(control, [&](const RunControl& in_turn, const StopSource& stop) {
    return mesh(surface, options, in_turn, stop, Phase::kCover);
  });
}

RunSummary resume(const std::filesystem::path& directory, const RunControl& control) {
  return in_turns(control, [&](const RunControl& in_turn, const StopSource& stop) {
    return resume(directory, in_turn, stop);
  });
}

}  // namespace locvol
