#include "tools/commands.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "engine/audit/audit.h"
#include "engine/exchange/one_rank.h"
#include "engine/exchange/pack.h"
#include "engine/formats/writer.h"
#include "engine/ingest/cad_input.h"
#include "engine/ingest/option_files.h"
#include "engine/ingest/surface_survey.h"
#include "engine/inspect/replay.h"
#include "engine/inspect/size_report.h"
#include "engine/plan/disk_room.h"
#include "engine/plan/run_estimate.h"
#include "engine/plan/run_setup.h"
#include "engine/rank_engine.h"
#include "engine/ranks/rank_store.h"
#include "engine/run/visit_error.h"
#include "engine/shared/memory_budget.h"
#include "engine/shared/scratch_directory.h"
#include "engine/shared/standard_input.h"
#include "engine/shared/stop_source.h"
#include "engine/shared/workers.h"
#include "tools/arguments.h"
#include "tools/faces.h"
#include "tools/finish.h"
#include "tools/generate.h"
#include "tools/progress.h"
#include "tools/results.h"
#include "tools/stop_signal.h"
#include "tools/stored_run.h"
#include "tools/tell_user.h"
#include "tools/visit_file.h"

namespace locvol {
namespace {

// Only what this command may remove when it is done with it.
bool is_absent_or_store(const std::filesystem::path& directory) {
  return !std::filesystem::exists(directory) || Store::owns(directory);
}

void remove_store(const std::filesystem::path& directory) {
  std::error_code error;
  std::filesystem::remove_all(directory, error);
  if (error) {
    tell_user("locvol: cannot remove the store {}: {}\n", directory.string(), error.message());
  }
}

// Throws InputError if it is no surface to be meshed; Stopped, once StopSignal is installed.
SurveyedSurface surveyed(const SurfaceSource& surface, const SurveyLaw& law, std::uint64_t cap) {
  const StopSource stop(StopSignal::is_requested);
  IngestWatch watch(&stop, {});
  Workers workers(num_streaming_threads(0, cap));
  return survey_surface(surface, temporary_directory(), watch, workers, law);
}

// The run that `mesh` would begin.
RunRecord run_of_size(const SurveyedSurface& surface, const std::filesystem::path& file,
                      double size, MeshOptions options) {
  options.input = file;
  options.size = {size, false};
  RunRecord run =
      planned_run(options, surface.digest, surface.facts, survey_files(options, surface.facts.box));
  run.has_creases = surface.has_sharp_edges;
  return run;
}

// For a user who gives none.
Size chosen_size(const SurfaceSource& surface, const MeshOptions& options, std::uint64_t cap,
                 ProgressLine& line) {
  const SurveyedSurface survey = surveyed(surface,
                                          {.weld = options.weld,
                                           .sharp_angle = options.sharp_angle,
                                           .sharp_polylines = options.sharp_polylines,
                                           .inside = options.inside,
                                           .wrap_alpha = options.wrap_alpha,
                                           .wrap_offset = options.wrap_offset,
                                           .memory_cap = cap},
                                          cap);
  const double size = survey.default_size();
  if (!(size > 0))
    throw InputError(surface.name +
                     ": its volume is 0, so no size can be chosen for it: give --size");
  const auto cells = [&](double s) {
    return count_text(estimated_num_cells(survey.facts, survey.has_sharp_edges, s));
  };
  const std::string reason = default_size_reason(survey.facts, survey.has_sharp_edges, size);
  line.tell(
      "size",
      [&] {
        return Json{{"size", size}, {"reason", reason}};
      },
      fmt::format("no --size is given: {} is chosen, for about {} tetrahedra{}; --size {} makes "
                  "about {}, --size {} about {}",
                  size, cells(size), reason.empty() ? "" : ", " + reason, 2 * size, cells(2 * size),
                  size / 2, cells(size / 2)));
  return {size, false};
}

// Before there was a run to go on with. Returns the exit code.
int tell_read_in_vain(const RunPlace& place, bool is_json) {
  if (!place.is_first()) return kExitInterrupted;
  tell_user(
      "{}: interrupted while the surface was read, with nothing changed; the same "
      "command reads it again\n",
      place.program());
  if (is_json) print_json({{"outcome", outcome_name(RunOutcome::kInterrupted)}});
  return kExitInterrupted;
}

// Throws std::runtime_error unless the output can be made without overwriting the surface.
void require_output(const std::filesystem::path& output, const OutputOptions& options,
                    const std::filesystem::path& surface) {
  auto files = files_of(options, output);
  if (options.has_faces) files.push_back(faces_file(output));
  for (const auto& file : files) {
    require_writable(file);
    std::error_code absent;  // then they are two
    if (std::filesystem::equivalent(file, surface, absent))
      throw std::runtime_error(fmt::format("cannot write {}: it is the surface", file.string()));
  }
}

// Keeps the visit that has failed beside the store, for who is to mend it.
[[noreturn]] void fail(const VisitError& error, const std::filesystem::path& directory) {
  const std::filesystem::path file =
      fmt::format("{}.{}.json", directory.string(), key_text(error.leaf()));
  std::string message = error.what();
  try {
    write_visit(stored_visit(open_to_read(directory), error.leaf()), file);
    message +=
        fmt::format("; `locvol replay --from {}` repeats the visit: send that file with a report",
                    file.string());
  } catch (const std::exception& e) {
    message += fmt::format("; the visit is in no file: {}", e.what());
  }
  throw std::runtime_error(message);
}

// Throws InputError.
void require_pieces(const RunCommand& command) {
  const MeshFormat format = command.control.output_options.format;
  if (!command.control.is_in_pieces || command.control.output.empty() ||
      can_be_written_in_pieces(format))
    return;
  std::vector<std::string_view> names;
  for (const FormatInfo& info : mesh_formats())
    if (can_be_written_in_pieces(info.format)) names.push_back(info.name);
  throw InputError(fmt::format("--pieces cannot be {}: these formats have pieces: {}",
                               info_of(format).name, fmt::join(names, ", ")));
}

// Throws InputError.
void require_triangles(const MeshCommand& command) {
  if (!command.options.is_surface_only || command.control.output.empty()) return;
  of_surface(command.control.output_options);
  if (command.control.is_in_pieces)
    throw InputError("--pieces are of cells, of which --surface-only makes none: write one file");
}

// Called by all ranks. `surface()`: of which the first one must not lose the file.
void require_output(const RunPlace& place, const RunControl& control,
                    const std::function<std::filesystem::path()>& surface) {
  if (control.output.empty()) return;
  do_on_all(place.exchange, [&] {
    if (place.is_first()) require_output(control.output, control.output_options, surface());
  });
  if (place.is_of_ranks && !control.is_in_pieces)
    require_seen_by_all(control.output, place.exchange);
}

// The file that is read; what a pipe is through, if it is one.
std::filesystem::path file_of(const std::filesystem::path& input) {
  return input == kFromStandardInput ? "/dev/stdin" : input;
}

// By default the ranks of one machine share half of what is free.
std::uint64_t cap_of(std::uint64_t asked, const RunPlace& place) {
  if (asked > 0 || !place.is_of_ranks) return memory_cap(asked);
  return memory_cap(memory_cap(0) / static_cast<std::uint64_t>(num_ranks_here(place.exchange)));
}

// The first rank chooses it, and all throw Stopped if that is stopped.
Size chosen_size(const SurfaceSource& surface, const MeshOptions& options, std::uint64_t cap,
                 const RunPlace& place, ProgressLine& line) {
  double size = 0;
  do_on_all(place.exchange, [&] {
    if (place.is_first()) size = chosen_size(surface, options, cap, line).value;
  });
  return {gather_values(place.exchange, size).front(), false};
}

int mesh_at(const RunPlace& place, const MeshCommand& command) {
  const StopSignal& stop = StopSignal::install();
  try {
    require_pieces(command);
    require_triangles(command);
    MeshCommand own = command;
    own.is_quiet = command.is_quiet || !place.is_first();
    require_output(place, command.control, [&] { return file_of(command.options.input); });
    const std::uint64_t cap = cap_of(command.control.memory_bytes, place);
    ProgressLine line(progress_style(own), cap);
    if (command.is_output_chosen)
      line.tell(
          "output",
          [&] {
            return Json{{"file", command.control.output.string()}};
          },
          fmt::format("no -o is given: the mesh goes to {}", command.control.output.string()));
    const SurfaceSource surface =
        surface_at(command.options.input, command.options.more_inputs, place.own());
    own.options.size =
        command.size ? *command.size : chosen_size(surface, command.options, cap, place, line);
    own.options.store = place.stores;
    const bool is_removable =
        command.options.store.empty() && !command.is_store_kept && is_absent_or_store(place.own());

    const TimedRun run = run_with_progress(own.control, cap, line, [&](const RunControl& control) {
      return place.is_of_ranks ? mesh_as_rank(surface, own.options, control, place.exchange)
                               : mesh(surface, own.options, control);
    });
    const int code = finish(run, place, own, stop, line);
    if (code == kExitDone && is_removable) remove_store(place.own());
    return code;
  } catch (const VisitError& error) {
    fail(error, place.own());
  } catch (const Stopped&) {
    return tell_read_in_vain(place, command.is_json);
  }
}

int resume_at(const RunPlace& place, const ResumeCommand& command) {
  const StopSignal& stop = StopSignal::install();
  try {
    require_pieces(command);
    ResumeCommand own = command;
    own.is_quiet = command.is_quiet || !place.is_first();
    require_output(place, command.control, [&]() -> std::filesystem::path {
      // Ranks say together what is wrong with their stores.
      if (place.is_of_ranks && !Store::owns(place.own())) return {};
      return run_of(open_to_read(place.own())).surface.file;
    });
    const std::uint64_t cap = cap_of(command.control.memory_bytes, place);
    ProgressLine line(progress_style(own), cap);
    const TimedRun run = run_with_progress(own.control, cap, line, [&](const RunControl& control) {
      return place.is_of_ranks ? resume_as_rank(place.stores, control, place.exchange)
                               : resume(place.stores, control);
    });
    return finish(run, place, own, stop, line);
  } catch (const VisitError& error) {
    fail(error, place.own());
  }
}

}  // namespace

std::filesystem::path store_of(const MeshCommand& command, bool is_of_ranks) {
  const std::filesystem::path& named = command.options.store;
  if (!named.empty()) return named;
  return command.control.output.string() + (is_of_ranks ? ".locvol-%r" : ".locvol");
}

int run_mesh(const MeshCommand& command) {
  return mesh_at({.stores = store_of(command, false)}, command);
}

int run_mesh_as_rank(const MeshCommand& command, Exchange& exchange) {
  return mesh_at({store_of(command, true), exchange, true}, command);
}

int run_resume(const ResumeCommand& command) {
  return resume_at({.stores = command.store}, command);
}

int run_resume_as_rank(const ResumeCommand& command, Exchange& exchange) {
  return resume_at({command.store, exchange, true}, command);
}

int run_export_as_rank(const ExportCommand& command, Exchange& exchange) {
  ResumeCommand resume;
  resume.store = command.store;
  resume.control.output = command.output;
  resume.control.output_options = command.output_options;
  resume.control.memory_bytes = command.memory_bytes;
  resume.control.num_threads = command.num_threads;
  resume.is_quiet = command.is_quiet;
  resume.is_json = command.is_json;
  resume.control.is_in_pieces = command.is_in_pieces;
  finished_by_ranks(command.store, exchange);
  return run_resume_as_rank(resume, exchange);
}

int run_join(const JoinCommand& command, Exchange& exchange) {
  RunControl control;
  control.memory_bytes = cap_of(0, {command.stores, exchange, true});
  join_ranks(command.stores, command.whole, control, exchange);
  if (exchange.rank() != 0) return kExitDone;
  const RunSummary summary = summarize(open_to_read(command.whole).snapshot());
  if (command.is_json) {
    Json json = {{"outcome", outcome_name(summary.outcome)}, {"store", command.whole.string()}};
    json.update(to_json(summary));
    print_json(json);
  } else {
    fmt::print("{}{}", summary_text(summary), line_text("store", command.whole.string()));
  }
  return exit_code(summary.outcome);
}

int run_export(const ExportCommand& command) {
  const Store store = open_whole(command.store);
  require_done(store);
  const RunRecord run = run_of(store);
  require_output(command.output, command.output_options, run.surface.file);
  require_format(run, command.output, command.output_options);
  require_room(run, command.store, command.output, command.output_options);
  ProgressLine line(progress_style(command), 0);
  const WriteSummary written = with_steps(RunStage::kWrite, line, [&](const StepProgress& on_step) {
    return write_mesh(store, command.output, command.output_options,
                      num_streaming_threads(command.num_threads, memory_cap(command.memory_bytes)),
                      on_step);
  });
  if (command.output_options.has_faces)
    write_faces(store, command.output, command.output_options.splits_interfaces);
  line.clear();
  if (command.is_json) {
    print_json(written_json(command.output, command.output_options, written));
  } else {
    fmt::print("{}", written_text(command.output, command.output_options, written));
  }
  return kExitDone;
}

namespace {

// Returns the exit code. `run_audit(on_step)` gives the report, which goes to stdout unless another
// rank tells it.
int tell_audit(const AuditCommand& command, bool is_told,
               const std::function<AuditReport(const StepProgress&)>& run_audit) {
  ProgressLine line(progress_style(command), 0);
  const AuditReport report = with_steps(RunStage::kAudit, line, run_audit);
  line.clear();
  if (is_told && command.is_json) print_json(to_json(report));
  if (is_told && !command.is_json) fmt::print("{}", audit_text(report));
  return report.is_valid() ? kExitDone : kExitError;
}

}  // namespace

int run_audit(const AuditCommand& command) {
  const Store store = open_whole(command.store);
  require_done(store);
  return tell_audit(command, true, [&](const StepProgress& on_step) {
    return audit(store, on_step, command.one_in);
  });
}

int run_audit_as_rank(const AuditCommand& command, Exchange& exchange) {
  const bool is_first = exchange.rank() == 0;
  AuditCommand own = command;
  own.is_quiet = command.is_quiet || !is_first;
  const Store store = open_part(command.store, exchange);
  return tell_audit(own, is_first, [&](const StepProgress& on_step) {
    return audit_as_rank(store, exchange, on_step, command.one_in);
  });
}

namespace {

// Finds them as `mesh` would, in a store that is then thrown away. `run` gets to know them.
SizeReport found_sizes(const SurfaceSource& surface, const InfoCommand& command, double size,
                       RunRecord& run) {
  if (run.parameters.sizes().is_uniform())
    throw InputError(
        "sizes do not vary: --vtu has nothing to show without --growth, --sizes, "
        "--per-circle, --deviation or --layers");
  if (!command.vtu.empty()) require_writable(command.vtu);
  const ScratchDirectory scratch(temporary_directory());
  MeshOptions options = command.options;
  options.input = command.surface;
  options.size = {size, false};
  options.store = scratch.path() / "run";
  RunControl control;
  control.is_stopped = StopSignal::is_requested;
  run = find_sizes(surface, options, control).run;
  const RunPart found = whole_run(open_to_read(options.store));
  if (!command.vtu.empty()) write_sizes_vtu(found, run, command.vtu);
  return report_sizes(found, run);
}

}  // namespace

int run_info(const InfoCommand& command) {
  MeshOptions options = command.options;
  const SurfaceSource surface =
      surface_at(command.surface, options.more_inputs, temporary_directory());
  options.size = command.size.value_or(Size{});
  const StopSource stop(StopSignal::is_requested);
  settle_faces(surface, options, memory_cap(0), &stop);
  const std::optional<Size> asked = command.size ? std::optional(options.size) : std::nullopt;
  const SurveyLaw law{options.weld,
                      options.sharp_angle,
                      options.sharp_polylines,
                      true,
                      asked,
                      body_law(options.has_bodies, options.voids, options.more_inputs.size()),
                      options.gap,
                      options.inside,
                      options.wrap_alpha,
                      options.wrap_offset,
                      memory_cap(0)};
  const SurveyedSurface input = surveyed(surface, law, memory_cap(0));
  const SurfaceFacts& facts = input.facts;
  Json json = to_json(facts);
  json["sheets"] = to_json(input.sheets);
  json["bodies"] = bodies_json(input.sheets);
  std::string text = facts_text(facts) + sheets_text(input.sheets);
  const double size = asked ? absolute_size(*asked, facts.box) : input.default_size();
  if (size > 0) {
    RunRecord run = run_of_size(input, command.surface, size, options);
    for (const std::string& note : notes_on_shapes(options, run.parameters, facts.box)) {
      json["notes"].push_back(note);
      text += line_text("note", note);
    }
    std::optional<SizeReport> sizes;
    if (run.parameters.has_nodes() || !command.vtu.empty())
      sizes = found_sizes(surface, command, size, run);
    const int num_threads = num_usable_threads();
    const RunEstimate estimate = estimate_run(run, command.output_options, num_threads);
    const std::uint64_t memory = least_memory(run);
    json["size"] = size;
    json["is_default_size"] = !command.size;
    json["estimated_cells"] = std::round(estimate.num_cells);
    json["estimate"] = to_json(estimate);
    json["estimate"]["format"] = info_of(command.output_options.format).name;
    json["estimate"]["num_threads"] = num_threads;
    json["estimate"]["least_memory_bytes"] = memory;
    if (!command.size) {
      const std::string reason = default_size_reason(facts, input.has_sharp_edges, size);
      json["default_size_reason"] = reason;
      text += line_text("", "with the size that mesh would choose" +
                                (reason.empty() ? ":" : ", " + reason + ":"));
    }
    text += estimate_text(estimate, command.output_options.format, num_threads, memory);
    if (sizes) {
      json["sizes"] = to_json(*sizes);
      text += sizes_text(*sizes);
    }
  }
  if (command.is_json) {
    json["digest"] = input.digest;
    print_json(json);
  } else {
    fmt::print("{}", text);
  }
  return kExitDone;
}

int run_generate(const GenerateCommand& command) {
  require_writable(command.output);
  const GeneratedSurface surface =
      command.num_grains > 0
          ? generate_polycrystal(command.num_grains, command.grains_seed, command.output)
          : generate(command.shape, command.num_triangles, command.output);
  if (command.is_json) {
    print_json({{"file", command.output.string()},
                {"num_vertices", surface.num_vertices},
                {"num_triangles", surface.num_triangles},
                {"bytes", surface.bytes}});
  } else {
    fmt::print("{}: {} triangles, {} vertices, {}\n", command.output.string(),
               surface.num_triangles, surface.num_vertices, bytes_text(surface.bytes));
  }
  return kExitDone;
}

}  // namespace locvol
