#include "tools/commands.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <optional>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "engine/audit.h"
#include "engine/memory_budget.h"
#include "engine/mesh_statistics.h"
#include "engine/surface_input.h"
#include "engine/writer.h"
#include "tools/arguments.h"
#include "tools/generate.h"
#include "tools/progress.h"
#include "tools/report.h"
#include "tools/stop_signal.h"
#include "tools/stored_run.h"

namespace locvol {
namespace {

constexpr std::size_t kMaxListedSites = 20;  // on stderr; `inspect` lists all
constexpr double kCellsPerCubicSize =
    2.4;  // of volume over λ³: a BCC mesh has 2.24, a boundary more

// Only what this command may remove when it is done with it.
bool is_absent_or_store(const std::filesystem::path& directory) {
  return !std::filesystem::exists(directory) || Store::owns(directory);
}

void remove_store(const std::filesystem::path& directory) {
  std::error_code error;
  std::filesystem::remove_all(directory, error);
  if (error) {
    fmt::print(stderr, "locvol: cannot remove the store {}: {}\n", directory.string(),
               error.message());
  }
}

using Seconds = std::vector<std::pair<std::string_view, double>>;  // by phase

struct TimedRun {
  RunSummary summary;
  Seconds seconds;
  int num_writers = 1;  // threads for the output
};

int num_writers(int num_threads, std::uint64_t memory_bytes) {
  return num_streaming_threads(num_threads, memory_bytes > 0 ? memory_bytes : free_memory() / 2);
}

// `command`: a MeshCommand or a ResumeCommand.
TimedRun run_with_progress(const auto& command,
                           const std::function<RunSummary(const RunControl&)>& run) {
  ProgressLine line(command.is_quiet);
  const RunControl control{
      .on_progress = [&](const Progress& progress) { line.update(progress); },
      .is_stopped = StopSignal::is_requested,
      .on_note = [&](const std::string& text) { line.note(text); },
      .memory_bytes = command.memory_bytes,
      .num_threads = command.num_threads,
  };
  TimedRun timed{run(control), {}, num_writers(command.num_threads, command.memory_bytes)};
  const auto seconds = line.phases().seconds_by_phase(line.seconds());
  for (std::size_t i = 0; i < seconds.size(); ++i)
    timed.seconds.emplace_back(phase_name(static_cast<Phase>(i)), seconds[i]);
  return timed;
}

MeshStatistics measure_timed(const Store& store, int num_threads, Seconds& seconds) {
  const auto start = std::chrono::steady_clock::now();
  MeshStatistics statistics = mesh_statistics(store, num_threads);
  const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - start;
  seconds.emplace_back("measure", taken.count());
  return statistics;
}

WriteSummary write_timed(const Store& store, const std::filesystem::path& output, int num_threads,
                         Seconds& seconds) {
  const auto start = std::chrono::steady_clock::now();
  const WriteSummary written = write_vtu(store, output, num_threads);
  const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - start;
  seconds.emplace_back("write", taken.count());
  return written;
}

double total(const Seconds& seconds) {
  double sum = 0;
  for (const auto& [phase, value] : seconds) sum += value;
  return sum;
}

Json by_phase_json(const Seconds& seconds) {
  Json json;
  for (const auto& [phase, value] : seconds) json[std::string(phase)] = value;
  return json;
}

// "2:05: ingest 1.2 s, initialize 3.4 s, refine 120 s, write 0.6 s"
std::string time_text(const Seconds& seconds) {
  std::vector<std::string> phases;
  for (const auto& [phase, value] : seconds)
    phases.push_back(fmt::format("{} {:.{}f} s", phase, value, value < 10 ? 1 : 0));
  return fmt::format("{}: {}", duration_text(total(seconds)), fmt::join(phases, ", "));
}

// "63 MiB at most, under a cap of 256 MiB"
std::string peak_text(const MemoryRecord& memory) {
  return fmt::format("{} at most, under a cap of {}", in_mebibytes(peak_resident_memory()),
                     in_mebibytes(memory.cap));
}

std::string_view outcome_name(RunOutcome outcome) {
  switch (outcome) {
    case RunOutcome::kDone:
      return "done";
    case RunOutcome::kUnresolved:
      return "unresolved";
    case RunOutcome::kInterrupted:
      return "interrupted";
  }
  return "unknown";
}

int exit_code(RunOutcome outcome) {
  switch (outcome) {
    case RunOutcome::kDone:
      return kExitDone;
    case RunOutcome::kUnresolved:
      return kExitUnresolved;
    case RunOutcome::kInterrupted:
      return kExitInterrupted;
  }
  return kExitError;
}

void print_how_to_resume(const std::filesystem::path& store, const std::filesystem::path& output) {
  const std::string option = output.empty() ? "" : fmt::format(" -o {}", output.string());
  fmt::print(stderr, "locvol: interrupted; `locvol resume {}{}` goes on\n", store.string(), option);
}

void print_unresolved(const Store& store) {
  const auto sites = unresolved_sites(store.snapshot());
  fmt::print(stderr,
             "locvol: {} sites are unresolved: the surface is not smooth there at scale λ\n",
             sites.size());
  for (std::size_t i = 0; i < std::min(sites.size(), kMaxListedSites); ++i) {
    fmt::print(stderr, "  {}\n", site_text(sites[i]));
  }
  if (sites.size() > kMaxListedSites) {
    fmt::print(stderr, "  and {} more: `locvol inspect {} --unresolved` lists all\n",
               sites.size() - kMaxListedSites, store.directory().string());
  }
}

std::string written_text(const std::filesystem::path& output, const WriteSummary& written) {
  return fmt::format("{:<16} {}: {} cells, {} vertices, {}\n", "written", output.string(),
                     written.num_cells, written.num_vertices, bytes_text(written.bytes));
}

Json written_json(const std::filesystem::path& output, const WriteSummary& written) {
  Json json = to_json(written);
  json["file"] = output.string();
  return json;
}

// What is the same after `mesh` and `resume`: the output, the lists, the result. Returns the exit
// code.
int finish(const TimedRun& run, const std::filesystem::path& directory,
           const std::filesystem::path& output, bool is_json) {
  std::optional<WriteSummary> written;
  std::optional<MeshStatistics> statistics;
  std::optional<MemoryRecord> memory;
  Seconds seconds = run.seconds;
  const RunOutcome outcome = run.summary.outcome;
  if (outcome == RunOutcome::kInterrupted) {
    print_how_to_resume(directory, output);
  } else {
    const Store store = open_to_read(directory);
    memory = store.snapshot().memory();
    statistics = measure_timed(store, run.num_writers, seconds);
    if (!output.empty()) written = write_timed(store, output, run.num_writers, seconds);
    if (outcome == RunOutcome::kUnresolved) print_unresolved(store);
  }
  if (is_json) {
    Json json = {{"outcome", outcome_name(outcome)},
                 {"seconds", total(seconds)},
                 {"seconds_by_phase", by_phase_json(seconds)}};
    json.update(to_json(run.summary));
    json["peak_resident_bytes"] = peak_resident_memory();
    if (memory) json["memory_cap_bytes"] = memory->cap;
    if (statistics) json["statistics"] = to_json(*statistics);
    if (written) json["written"] = written_json(output, *written);
    print_json(json);
  } else {
    fmt::print("{}{}", summary_text(run.summary), line_text("time", time_text(seconds)));
    if (memory) fmt::print("{}", line_text("memory", peak_text(*memory)));
    if (written) fmt::print("{}", written_text(output, *written));
    if (statistics) fmt::print("{}", statistics_text(*statistics, run.summary.run.surface));
  }
  return exit_code(outcome);
}

}  // namespace

std::filesystem::path store_of(const MeshCommand& command) {
  const std::filesystem::path& named = command.options.store;
  if (!named.empty()) return named;
  return command.output.string() + ".locvol";
}

int run_mesh(const MeshCommand& command) {
  require_writable(command.output);
  MeshOptions options = command.options;
  options.store = store_of(command);
  const bool is_removable =
      command.options.store.empty() && !command.is_store_kept && is_absent_or_store(options.store);

  const StopSignal stop_signal;
  const TimedRun run =
      run_with_progress(command, [&](const RunControl& control) { return mesh(options, control); });
  const int code = finish(run, options.store, command.output, command.is_json);
  if (code == kExitDone && is_removable) remove_store(options.store);
  return code;
}

int run_resume(const ResumeCommand& command) {
  if (!command.output.empty()) require_writable(command.output);
  const StopSignal stop_signal;
  const TimedRun run = run_with_progress(
      command, [&](const RunControl& control) { return resume(command.store, control); });
  return finish(run, command.store, command.output, command.is_json);
}

int run_export(const ExportCommand& command) {
  require_writable(command.output);
  const Store store = open_to_read(command.store);
  require_done(store);
  const WriteSummary written = write_vtu(store, command.output, num_writers(0, 0));
  if (command.is_json) {
    print_json(written_json(command.output, written));
  } else {
    fmt::print("{}", written_text(command.output, written));
  }
  return kExitDone;
}

int run_audit(const AuditCommand& command) {
  const Store store = open_to_read(command.store);
  require_done(store);
  const AuditReport report = audit(store);
  if (command.is_json) {
    print_json(to_json(report));
  } else {
    fmt::print("{}", audit_text(report));
  }
  return report.is_valid() ? kExitDone : kExitError;
}

int run_info(const InfoCommand& command) {
  IngestWatch watch;
  RawSurface raw = read_surface(command.surface, std::filesystem::temp_directory_path(), watch);
  const std::string digest = raw.digest;
  const Frame frame = frame_of(raw.box);
  Workers workers(num_streaming_threads(0, memory_cap(0)));
  const SurfaceFacts facts = check_surface(std::move(raw), frame, watch, workers).facts;
  Json json = to_json(facts);
  std::string text = facts_text(facts);
  if (command.size) {
    const double size = absolute_size(*command.size, facts.box);
    const double num_cells = std::round(kCellsPerCubicSize * facts.volume / std::pow(size, 3));
    json["size"] = size;
    json["estimated_cells"] = num_cells;
    text += fmt::format("{:<16} {}\n{:<16} about {:.3g}\n", "size λ", size, "cells", num_cells);
  }
  if (command.is_json) {
    json["digest"] = digest;
    print_json(json);
  } else {
    fmt::print("{}", text);
  }
  return kExitDone;
}

int run_generate(const GenerateCommand& command) {
  require_writable(command.output);
  const GeneratedSurface surface = generate(command.shape, command.num_triangles, command.output);
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
