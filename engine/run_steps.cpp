#include "engine/run_steps.h"

#include <algorithm>
#include <utility>

#include "engine/ingest/cured_surface.h"
#include "engine/ingest/option_files.h"
#include "engine/ingest/surface_input.h"
#include "engine/plan/run_setup.h"
#include "engine/shared/input_error.h"
#include "engine/shared/memory_budget.h"
#include "engine/shared/workers.h"

namespace locvol {

RunSummary summarize(const Reader& reader) {
  const auto run = reader.run();
  if (!run) throw StoreError("the store holds no run");
  RunSummary summary{
      .outcome = run->counts.num_unresolved > 0 ? RunOutcome::kUnresolved : RunOutcome::kDone,
      .run = *run,
      .sheets = reader.sheets()};
  if (run->phase != Phase::kDone) summary.outcome = RunOutcome::kInterrupted;
  reader.for_each_leaf([&](MortonKey, const LeafInfo& info) {
    ++summary.num_leaves;
    summary.max_visits_of_a_leaf =
        std::max<std::uint64_t>(summary.max_visits_of_a_leaf, info.num_visits);
    return true;
  });
  return summary;
}

RunRecord planned(const MeshOptions& options, const std::string& digest, const Box& box,
                  const StopSource& stop) {
  return planned_run(options, digest, box, survey_files(options, box, &stop));
}

RunRecord begun(const MeshOptions& options, const std::string& digest, const Box& box,
                const RunControl& control, const StopSource& stop) {
  RunRecord run = planned(options, digest, box, stop);
  if (control.on_note)
    std::ranges::for_each(notes_on_shapes(options, run.parameters, box), control.on_note);
  return run;
}

SurfaceSource source_to_mesh(const SurfaceSource& given, const MeshOptions& options,
                             const RunControl& control) {
  return source_to_mesh(given, options.inside,
                        {options.wrap_alpha, options.wrap_offset, memory_cap(control.memory_bytes)},
                        options.store);
}

SurfaceSource source_to_mesh(const SurfaceSource& given, const RunParameters& parameters,
                             const std::filesystem::path& store, const RunControl& control) {
  return source_to_mesh(given, parameters.inside,
                        {Size::length(parameters.wrap_alpha), Size::length(parameters.wrap_offset),
                         memory_cap(control.memory_bytes)},
                        store);
}

void check_output(const RunRecord& run, const std::filesystem::path& store,
                  const RunControl& control, const DiskOf& disk) {
  if (!control.output.empty()) require_format(run, control.output, control.output_options);
  require_room(run, store, control.output, control.output_options, disk);
}

IngestWatch watch_of(const RunControl& control, const StopSource& stop, int num_ranks) {
  std::function<void(std::uint64_t)> tell;
  if (control.on_progress)
    tell = [&control, num = static_cast<std::uint64_t>(num_ranks)](std::uint64_t num_triangles) {
      control.on_progress({.phase = Phase::kIngest, .num_triangles = num * num_triangles});
    };
  return IngestWatch(&stop, tell);
}

IngestCalls ingest_calls(const std::filesystem::path& directory, std::function<Store()> open_store,
                         const RunControl& control, const DiskOf& disk) {
  const auto check = [directory, &control, disk](const RunRecord& run, std::uint64_t spilled) {
    if (control.on_note) std::ranges::for_each(run.surface.notes, control.on_note);
    // Temporary files, which will be gone.
    const std::uint64_t own = disk(directory).id;
    check_output(run, directory, control, [&](const std::filesystem::path& place) {
      Disk found = disk(place);
      if (found.id == own) found.free_bytes += static_cast<double>(spilled);
      return found;
    });
  };
  const auto begin = [&control](const RunRecord& run) {
    planned_memory(run, memory_cap(control.memory_bytes));
    if (control.on_run) control.on_run(run);
  };
  return {check, begin, std::move(open_store), memory_cap(control.memory_bytes)};
}

Store ingested(const SurfaceSource& surface, const std::filesystem::path& directory,
               const std::function<RunRecord(const std::string& digest, const Box& box)>& planned,
               const std::function<Store()>& open_store, const RunControl& control,
               const StopSource& stop) {
  IngestWatch watch = watch_of(control, stop);
  RawSurface raw = read_surface(surface, existing_directory(directory), watch);
  const RunRecord run = planned(raw.digest, raw.box);
  Workers workers(num_streaming_threads(control.num_threads, memory_cap(control.memory_bytes)));
  return ingest(std::move(raw), run, ingest_calls(directory, open_store, control, disk_of), watch,
                workers);
}

void require_cells(const RunRecord& run) {
  if (run.counts.num_cells == 0)
    throw InputError(run.surface.file +
                     ": no cell fits the surface at this size; choose a smaller one");
}

}  // namespace locvol
