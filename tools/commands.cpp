#include "tools/commands.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <functional>
#include <optional>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "engine/audit/audit.h"
#include "engine/exchange/in_rank_order.h"
#include "engine/formats/writer.h"
#include "engine/ingest/image_sizes.h"
#include "engine/ingest/surface_input.h"
#include "engine/inspect/mesh_statistics.h"
#include "engine/inspect/replay.h"
#include "engine/inspect/size_report.h"
#include "engine/plan/disk_room.h"
#include "engine/plan/run_estimate.h"
#include "engine/plan/run_setup.h"
#include "engine/rank_engine.h"
#include "engine/ranks/move_leaves.h"
#include "engine/ranks/rank_store.h"
#include "engine/run/visit_error.h"
#include "engine/shared/memory_budget.h"
#include "engine/shared/scratch_directory.h"
#include "engine/shared/stop_source.h"
#include "engine/shared/workers.h"
#include "tools/arguments.h"
#include "tools/generate.h"
#include "tools/leaf_site_fields.h"
#include "tools/progress.h"
#include "tools/results.h"
#include "tools/stop_signal.h"
#include "tools/stored_run.h"
#include "tools/visit_file.h"

namespace locvol {
namespace {

constexpr std::size_t kMaxListedSites = 20;  // on stderr; `inspect` lists all
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

ProgressStyle progress_style(const auto& command) {
  if (command.is_quiet) return ProgressStyle::kNone;
  return command.is_json ? ProgressStyle::kJson : ProgressStyle::kText;
}

// What a run will take, with which the line reckons from here on.
struct Expected {
  int num_threads;
  RunEstimate estimate;
};
Expected expected(const RunRecord& run, const RunControl& control, ProgressLine& line) {
  const int num_threads = control.num_threads > 0 ? control.num_threads : num_usable_threads();
  const RunEstimate estimate = estimate_run(run, control.output_options, num_threads);
  line.expect(estimate, !control.output.empty());
  return {num_threads, estimate};
}

// Says which run begins or goes on, and what it will take.
void tell_run(const RunRecord& run, const RunControl& control, ProgressLine& line) {
  const Expected known = expected(run, control, line);
  const bool begins = run.phase == Phase::kIngest;
  const auto json = [&] {
    return Json{{"begins", begins},
                {"phase", phase_name(run.phase)},
                {"num_threads", known.num_threads},
                {"estimate", to_json(known.estimate)}};
  };
  line.tell("run", json,
            begins ? brief_estimate_text(known.estimate, known.num_threads)
                   : fmt::format("goes on with the run in its store, in phase {}",
                                 phase_name(run.phase)));
}

// What it will take, once its sizes tell.
void tell_sizes(const RunRecord& run, const RunControl& control, ProgressLine& line) {
  const Expected known = expected(run, control, line);
  line.tell(
      "sizes",
      [&] {
        return Json{{"estimate", to_json(known.estimate)}};
      },
      "sizes are known: " + brief_estimate_text(known.estimate, known.num_threads));
}

// Under the cap on memory.
TimedRun run_with_progress(RunControl control, std::uint64_t cap, ProgressLine& line,
                           const std::function<RunSummary(const RunControl&)>& run) {
  control.on_progress = [&](const Progress& progress) { line.update(progress); };
  control.is_stopped = StopSignal::is_requested;
  control.on_note = [&](const std::string& text) { line.note(text); };
  control.on_run = [&](const RunRecord& record) { tell_run(record, control, line); };
  control.on_sizes = [&](const RunRecord& record) { tell_sizes(record, control, line); };
  control.memory_bytes = cap;
  TimedRun timed{run(control), {}, num_streaming_threads(control.num_threads, cap)};
  const auto seconds = line.stages().seconds_by_stage(line.seconds());
  for (std::size_t i = 0; i < seconds.size(); ++i)
    timed.seconds.emplace_back(stage_name(static_cast<RunStage>(i)), seconds[i]);
  return timed;
}

// The result of `work`, which tells the line of its steps.
template <class Work>
auto with_steps(RunStage stage, ProgressLine& line, const Work& work) {
  line.update(stage, 0, 0);  // there may be something to do before the first step
  return work(
      [&line, stage](std::uint64_t done, std::uint64_t all) { line.update(stage, done, all); });
}

template <class Work>
auto timed(RunStage stage, ProgressLine& line, Seconds& seconds, const Work& work) {
  const double start = line.seconds();
  auto result = with_steps(stage, line, work);
  seconds.emplace_back(stage_name(stage), line.seconds() - start);
  return result;
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

// Throws InputError if it is no surface to be meshed; Stopped, once StopSignal is installed.
SurveyedSurface surveyed(const std::filesystem::path& file, std::uint64_t cap) {
  const StopSource stop(StopSignal::is_requested);
  IngestWatch watch(&stop, {});
  Workers workers(num_streaming_threads(0, cap));
  return survey_surface(surface_in_file(file), std::filesystem::temp_directory_path(), watch,
                        workers);
}

// The run that `mesh` would begin.
RunRecord run_of_size(const SurveyedSurface& surface, const std::filesystem::path& file,
                      double size, MeshOptions options) {
  options.input = file;
  options.size = {size, false};
  return planned_run(options, surface.digest, surface.facts,
                     survey_size_image(options.size_image, surface.facts.box));
}

// For a user who gives none.
SizeSpec chosen_size(const std::filesystem::path& file, std::uint64_t cap, ProgressLine& line) {
  const SurfaceFacts facts = surveyed(file, cap).facts;
  const double size = default_size(facts);
  if (!(size > 0))
    throw InputError(file.string() +
                     ": its volume is 0, so no size can be chosen for it: give --size");
  const auto cells = [&](double s) {
    return count_text(estimated_num_cells(facts, {.surface = s}));
  };
  line.tell(
      "size",
      [&] {
        return Json{{"size", size}};
      },
      fmt::format("no --size is given: {} is chosen, for about {} tetrahedra; --size {} makes "
                  "about {}, --size {} about {}",
                  size, cells(size), 2 * size, cells(2 * size), size / 2, cells(size / 2)));
  return {size, false};
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

void tell_how_to_resume(const std::filesystem::path& store, const std::filesystem::path& output,
                        const OutputOptions& options, bool is_json, ProgressLine& line) {
  if (is_json)
    return line.tell(
        "interrupted",
        [&] {
          return Json{{"store", store.string()}};
        },
        "");
  std::string arguments = store.string();
  if (!output.empty()) {
    arguments += fmt::format(" -o {}", output.string());
    if (format_of(output) != options.format)
      arguments += fmt::format(" --format {}", info_of(options.format).name);
    if (options.has_quality) arguments += " --cell-data quality";
  }
  line.clear();
  fmt::print(stderr, "locvol: interrupted; `locvol resume {}` goes on\n", arguments);
}

// Before there was a run to go on with. Returns the exit code.
int tell_read_in_vain(bool is_json) {
  fmt::print(stderr,
             "locvol: interrupted while the surface was read, with nothing changed; the same "
             "command reads it again\n");
  if (is_json) print_json({{"outcome", outcome_name(RunOutcome::kInterrupted)}});
  return kExitInterrupted;
}

// `sites`: the first of `num_all`. `inspect`: the command that lists them all.
void tell_unresolved(const std::vector<LeafSite>& sites, std::uint64_t num_all,
                     const std::string& inspect, bool is_json, ProgressLine& line) {
  if (is_json) {
    const auto json = [&] {
      Json all = {{"num_unresolved", num_all}, {"sites", Json::array()}};
      for (const LeafSite& site : sites) all["sites"].push_back(to_json(site));
      return all;
    };
    return line.tell("unresolved", json, "");
  }
  line.clear();
  fmt::print(stderr,
             "locvol: {} sites are unresolved: the surface is not smooth there at scale λ\n",
             num_all);
  for (const LeafSite& site : sites) fmt::print(stderr, "  {}\n", site_text(site));
  if (num_all > sites.size())
    fmt::print(stderr, "  and {} more: `{} --unresolved` lists all\n", num_all - sites.size(),
               inspect);
}

// The exit code stays 0, and with --quiet the count is in the summary.
// `cells`: the first of them.
void tell_poor_cells(const std::vector<LeafPoorCell>& cells, const MeshStatistics& statistics,
                     const char* program, ProgressLine& line) {
  const auto json = [&] {
    Json all = {{"num_poor_cells", statistics.num_poor_cells}, {"cells", Json::array()}};
    for (const LeafPoorCell& cell : cells) all["cells"].push_back(to_json(cell));
    return all;
  };
  std::string text = fmt::format(
      "{} cell{} a dihedral angle below {}°, which nothing improved", statistics.num_poor_cells,
      statistics.num_poor_cells == 1 ? " has" : "s have", statistics.min_dihedral_bound);
  for (const LeafPoorCell& cell : cells) text += fmt::format("\n  {}", poor_cell_text(cell));
  if (statistics.num_poor_cells > cells.size())
    text += fmt::format(
        "\n  and {} more: of a store that is kept, `{} inspect DIR --unresolved` lists all",
        statistics.num_poor_cells - cells.size(), program);
  line.tell("poor_cells", json, text);
}

std::vector<std::string> names_of(const std::filesystem::path& output, MeshFormat format) {
  std::vector<std::string> names;
  for (const auto& file : files_of(format, output)) names.push_back(file.string());
  return names;
}

std::string written_text(const std::filesystem::path& output, MeshFormat format,
                         const WriteSummary& written) {
  const std::string names = fmt::format("{}", fmt::join(names_of(output, format), ", "));
  if (info_of(format).is_surface)
    return fmt::format("{:<16} {}: {} boundary triangles, {}\n", "written", names,
                       written.num_boundary_facets, bytes_text(written.bytes));
  return fmt::format("{:<16} {}: {} cells, {} vertices, {}\n", "written", names, written.num_cells,
                     written.num_vertices, bytes_text(written.bytes));
}

Json written_json(const std::filesystem::path& output, MeshFormat format,
                  const WriteSummary& written) {
  Json json = to_json(written);
  json["file"] = names_of(output, format).front();
  json["format"] = info_of(format).name;
  return json;
}

// Throws std::runtime_error unless the output can be made without overwriting the surface.
void require_output(const std::filesystem::path& output, MeshFormat format,
                    const std::filesystem::path& surface) {
  for (const auto& file : files_of(format, output)) {
    require_writable(file);
    std::error_code absent;  // then they are two
    if (std::filesystem::equivalent(file, surface, absent))
      throw std::runtime_error(fmt::format("cannot write {}: it is the surface", file.string()));
  }
}

// Of a run that is done.
struct MeasuredMesh {
  std::optional<MemoryRecord> memory;
  std::optional<MeshStatistics> statistics;
  std::optional<WriteSummary> written;
};

// Throws Stopped.
MeasuredMesh measure_and_write(const TimedRun& run, const std::filesystem::path& directory,
                               const RunCommand& command, const StopSignal& stop,
                               ProgressLine& line, Seconds& seconds) {
  const Store store = open_to_read(directory);
  MeasuredMesh mesh{.memory = store.snapshot().memory(), .statistics = {}, .written = {}};
  mesh.statistics = timed(RunStage::kMeasure, line, seconds, [&](const StepProgress& on_step) {
    return mesh_statistics(store, run.num_writers, on_step, &stop);
  });
  if (!command.control.output.empty())
    mesh.written = timed(RunStage::kWrite, line, seconds, [&](const StepProgress& on_step) {
      return write_mesh(store, command.control.output, command.control.output_options,
                        run.num_writers, on_step, &stop);
    });
  if (run.summary.outcome == RunOutcome::kUnresolved) {
    std::vector<LeafSite> sites = unresolved_sites(store.snapshot());
    const std::size_t num_all = sites.size();
    sites.resize(std::min(num_all, kMaxListedSites));
    tell_unresolved(sites, num_all, "locvol inspect " + directory.string(), command.is_json, line);
  }
  if (mesh.statistics->num_poor_cells > 0 && !command.is_quiet)  // to find them takes time
    tell_poor_cells(first_poor_cells(store, kMaxListedSites, run.num_writers), *mesh.statistics,
                    "locvol", line);
  return mesh;
}

void print_result(const RunSummary& run, RunOutcome outcome, const MeasuredMesh& mesh,
                  const Seconds& seconds, const RunCommand& command) {
  const auto& [memory, statistics, written] = mesh;
  const MeshFormat format = command.control.output_options.format;
  if (command.is_json) {
    Json json = {{"outcome", outcome_name(outcome)},
                 {"seconds", total(seconds)},
                 {"seconds_by_phase", by_phase_json(seconds)}};
    json.update(to_json(run));
    json["peak_resident_bytes"] = peak_resident_memory();
    if (memory) json["memory_cap_bytes"] = memory->cap;
    if (statistics) json["statistics"] = to_json(*statistics, run.run);
    if (written) json["written"] = written_json(command.control.output, format, *written);
    print_json(json);
  } else {
    fmt::print("{}{}", summary_text(run), line_text("time", time_text(seconds)));
    if (memory) fmt::print("{}", line_text("memory", peak_text(*memory)));
    if (written) fmt::print("{}", written_text(command.control.output, format, *written));
    if (statistics) fmt::print("{}", statistics_text(*statistics, run.run));
  }
}

// What is the same after `mesh` and `resume`: the output, the lists, the result. Returns the exit
// code.
int finish(const TimedRun& run, const std::filesystem::path& directory, const RunCommand& command,
           const StopSignal& stop, ProgressLine& line) {
  RunOutcome outcome = run.summary.outcome;
  MeasuredMesh mesh;
  Seconds seconds = run.seconds;
  try {
    if (outcome != RunOutcome::kInterrupted)
      mesh = measure_and_write(run, directory, command, stop, line, seconds);
  } catch (const Stopped&) {
    outcome = RunOutcome::kInterrupted;
  }
  if (outcome == RunOutcome::kInterrupted)
    tell_how_to_resume(directory, command.control.output, command.control.output_options,
                       command.is_json, line);
  line.clear();
  print_result(run.summary, outcome, mesh, seconds, command);
  return exit_code(outcome);
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

}  // namespace

std::filesystem::path store_of(const MeshCommand& command) {
  const std::filesystem::path& named = command.options.store;
  if (!named.empty()) return named;
  return command.control.output.string() + ".locvol";
}

int run_mesh(const MeshCommand& command) try {
  const StopSignal& stop = StopSignal::install();
  require_output(command.control.output, command.control.output_options.format,
                 command.options.input);
  const std::uint64_t cap = memory_cap(command.control.memory_bytes);
  ProgressLine line(progress_style(command), cap);
  MeshOptions options = command.options;
  options.size = command.size ? *command.size : chosen_size(options.input, cap, line);
  options.store = store_of(command);
  const bool is_removable =
      command.options.store.empty() && !command.is_store_kept && is_absent_or_store(options.store);

  const TimedRun run =
      run_with_progress(command.control, cap, line,
                        [&](const RunControl& control) { return mesh(options, control); });
  const int code = finish(run, options.store, command, stop, line);
  if (code == kExitDone && is_removable) remove_store(options.store);
  return code;
} catch (const VisitError& error) {
  fail(error, store_of(command));
} catch (const Stopped&) {
  return tell_read_in_vain(command.is_json);
}

std::filesystem::path stores_of_ranks(const MeshCommand& command) {
  const std::filesystem::path beside = command.control.output.string() + ".locvol-%r";
  return command.options.store.empty() ? beside : command.options.store;
}

namespace {

// Each rank measures and writes its part. Returns the exit code.
int finish_in_parts(const TimedRun& run, const std::filesystem::path& stores,
                    const RunCommand& command, Exchange& exchange, ProgressLine& line) {
  const Store store = open_to_read(store_of_rank(stores, exchange.rank()));
  MeasuredMesh mesh{.memory = store.snapshot().memory(), .statistics = {}, .written = {}};
  Seconds seconds = run.seconds;
  mesh.statistics = timed(RunStage::kMeasure, line, seconds, [&](const StepProgress&) {
    return mesh_statistics_of_ranks(store, exchange, run.num_writers);
  });
  RunCommand named = command;
  if (command.control.is_in_pieces) {
    const MeshFormat format = command.control.output_options.format;
    named.control.output = index_of_pieces(command.control.output, format)
                               .value_or(piece_of(command.control.output, format, 0));
  }
  if (!command.control.output.empty())
    mesh.written = timed(RunStage::kWrite, line, seconds, [&](const StepProgress&) {
      const auto write = command.control.is_in_pieces ? write_piece_as_rank : write_mesh_as_rank;
      return write(store, command.control.output, command.control.output_options, exchange,
                   run.num_writers);
    });
  const bool is_first = exchange.rank() == 0;
  if (run.summary.outcome == RunOutcome::kUnresolved) {
    std::vector<LeafSite> sites = unresolved_sites(store.snapshot());
    const std::uint64_t num_all = sum(exchange, sites.size()).all;
    sites = first_of_ranks(exchange, std::move(sites), kMaxListedSites);
    const std::string inspect = "locvol-mpi inspect " + stores.string();
    if (is_first) tell_unresolved(sites, num_all, inspect, command.is_json, line);
  }
  // Others are quiet.
  if (mesh.statistics->num_poor_cells > 0 && any(exchange, !command.is_quiet)) {
    const auto cells = first_poor_cells(store, kMaxListedSites, run.num_writers, &exchange);
    if (is_first) tell_poor_cells(cells, *mesh.statistics, "locvol-mpi", line);
  }
  line.clear();
  if (is_first) print_result(run.summary, run.summary.outcome, mesh, seconds, named);
  return exit_code(run.summary.outcome);
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

// The first rank gets all in one store, and goes on as `mesh` does.
int finish_on_first(const TimedRun& run, const std::filesystem::path& stores,
                    const RunCommand& command, Exchange& exchange, const StopSignal& stop,
                    ProgressLine& line) {
  const bool is_first = exchange.rank() == 0;
  const std::filesystem::path directory = store_of_rank(stores, exchange.rank());
  const std::filesystem::path whole = directory.string() + ".whole";
  {
    std::optional<Store> joined;
    if (is_first) {
      remove_store(whole);
      joined = Store::open(whole, {.create = true});
    }
    const Store own = open_to_read(directory);
    join_leaves({&own, 1}, joined ? &*joined : nullptr, exchange);
  }
  std::uint64_t code = kExitDone;
  if (is_first) code = static_cast<std::uint64_t>(finish(run, whole, command, stop, line));
  if (is_first) remove_store(whole);
  return static_cast<int>(gather_numbers(exchange, code).front());
}

// What is the same after `mesh` and `resume` by ranks.
int finish_as_rank(const TimedRun& run, const std::filesystem::path& stores,
                   const RunCommand& command, Exchange& exchange, const StopSignal& stop,
                   ProgressLine& line) {
  const bool is_first = exchange.rank() == 0;
  if (run.summary.outcome == RunOutcome::kInterrupted) {
    line.clear();
    if (is_first)
      fmt::print(stderr, "locvol-mpi: interrupted; the same command, or resume, goes on\n");
    if (is_first && command.is_json) print_json({{"outcome", outcome_name(run.summary.outcome)}});
    return kExitInterrupted;
  }
  const ExchangeStats said = exchange.stats();
  const Json of_rank = {{"rank", exchange.rank()},
                        {"num_messages_sent", said.num_messages},
                        {"bytes_sent", said.num_bytes},
                        {"seconds_waiting", said.seconds},
                        {"cpu_seconds_of_visits", run.summary.cpu_of_visits},
                        {"peak_resident_bytes", peak_resident_memory()}};
  for (const std::string& text : exchange.gather(of_rank.dump()))
    if (command.is_json && is_first)
      line.tell(
          "rank", [&] { return Json::parse(text); }, "");
  const bool is_in_parts = command.control.is_in_pieces || command.control.output.empty() ||
                           can_be_written_in_parts(command.control.output_options.format);
  return is_in_parts ? finish_in_parts(run, stores, command, exchange, line)
                     : finish_on_first(run, stores, command, exchange, stop, line);
}

// By default those of one machine share half of what is free.
std::uint64_t memory_of_rank(std::uint64_t asked, Exchange& exchange) {
  const int num_here = num_ranks_here(exchange);
  return asked > 0 ? asked : memory_cap(0) / static_cast<std::uint64_t>(num_here);
}

}  // namespace

int run_mesh_as_rank(const MeshCommand& command, Exchange& exchange) try {
  const bool is_first = exchange.rank() == 0;
  const StopSignal& stop = StopSignal::install();
  require_pieces(command);
  MeshCommand own = command;
  own.options.store = stores_of_ranks(command);
  own.control.memory_bytes = memory_of_rank(command.control.memory_bytes, exchange);
  own.is_quiet = command.is_quiet || !is_first;
  if (is_first)
    require_output(command.control.output, command.control.output_options.format,
                   command.options.input);
  const std::uint64_t cap = memory_cap(own.control.memory_bytes);
  ProgressLine line(progress_style(own), cap);
  if (!own.size) {
    double size = 0;
    if (is_first) try {
        size = chosen_size(command.options.input, cap, line).value;
      } catch (const Stopped&) {  // all are to know
      }
    size =
        std::bit_cast<double>(gather_numbers(exchange, std::bit_cast<std::uint64_t>(size)).front());
    if (size == 0) throw Stopped();
    own.size = SizeSpec{size, false};
  }
  own.options.size = *own.size;
  const std::filesystem::path store = store_of_rank(own.options.store, exchange.rank());
  const bool is_removable =
      command.options.store.empty() && !command.is_store_kept && is_absent_or_store(store);

  const TimedRun run = run_with_progress(own.control, cap, line, [&](const RunControl& control) {
    return mesh_as_rank(own.options, control, exchange);
  });
  const int code = finish_as_rank(run, own.options.store, own, exchange, stop, line);
  if (code == kExitDone && is_removable) remove_store(store);
  return code;
} catch (const Stopped&) {
  return tell_read_in_vain(command.is_json);
}

int run_resume_as_rank(const ResumeCommand& command, Exchange& exchange) {
  const StopSignal& stop = StopSignal::install();
  require_pieces(command);
  ResumeCommand own = command;
  own.is_quiet = command.is_quiet || exchange.rank() != 0;
  own.control.memory_bytes = memory_of_rank(command.control.memory_bytes, exchange);
  const std::uint64_t cap = memory_cap(own.control.memory_bytes);
  ProgressLine line(progress_style(own), cap);
  const TimedRun run = run_with_progress(own.control, cap, line, [&](const RunControl& control) {
    return resume_as_rank(own.store, control, exchange);
  });
  return finish_as_rank(run, own.store, own, exchange, stop, line);
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
  control.memory_bytes = memory_of_rank(0, exchange);
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

int run_resume(const ResumeCommand& command) try {
  const StopSignal& stop = StopSignal::install();
  if (!command.control.output.empty())
    require_output(command.control.output, command.control.output_options.format,
                   run_of(open_to_read(command.store)).surface.file);
  const std::uint64_t cap = memory_cap(command.control.memory_bytes);
  ProgressLine line(progress_style(command), cap);
  const TimedRun run =
      run_with_progress(command.control, cap, line,
                        [&](const RunControl& control) { return resume(command.store, control); });
  return finish(run, command.store, command, stop, line);
} catch (const VisitError& error) {
  fail(error, command.store);
}

int run_export(const ExportCommand& command) {
  const MeshFormat format = command.output_options.format;
  const Store store = open_whole(command.store);
  require_done(store);
  const RunRecord run = run_of(store);
  require_output(command.output, format, run.surface.file);
  require_format(run, command.output, command.output_options);
  require_room(run, command.store, command.output, command.output_options);
  ProgressLine line(progress_style(command), 0);
  const WriteSummary written = with_steps(RunStage::kWrite, line, [&](const StepProgress& on_step) {
    return write_mesh(store, command.output, command.output_options,
                      num_streaming_threads(command.num_threads, memory_cap(command.memory_bytes)),
                      on_step);
  });
  line.clear();
  if (command.is_json) {
    print_json(written_json(command.output, format, written));
  } else {
    fmt::print("{}", written_text(command.output, format, written));
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
SizeReport found_sizes(const InfoCommand& command, double size, RunRecord& run) {
  if (run.parameters.sizes().is_uniform())
    throw InputError(
        "sizes do not vary: --vtu has nothing to show without --growth, --sizes, "
        "--per-circle, --deviation or --layers");
  if (!command.vtu.empty()) require_writable(command.vtu);
  const ScratchDirectory scratch(std::filesystem::temp_directory_path());
  MeshOptions options = command.options;
  options.input = command.surface;
  options.size = {size, false};
  options.store = scratch.path() / "run";
  RunControl control;
  control.is_stopped = StopSignal::is_requested;
  run = find_sizes(options, control).run;
  OneRank alone;
  const RunPart found = whole_run(open_to_read(options.store), alone);
  if (!command.vtu.empty()) write_sizes_vtu(found, run, command.vtu);
  return report_sizes(found, run);
}

}  // namespace

int run_info(const InfoCommand& command) {
  const SurveyedSurface input = surveyed(command.surface, memory_cap(0));
  const SurfaceFacts& facts = input.facts;
  Json json = to_json(facts);
  std::string text = facts_text(facts);
  const double size = command.size ? absolute_size(*command.size, facts.box) : default_size(facts);
  if (size > 0) {
    RunRecord run = run_of_size(input, command.surface, size, command.options);
    std::optional<SizeReport> sizes;
    if (run.parameters.has_nodes() || !command.vtu.empty()) sizes = found_sizes(command, size, run);
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
    if (!command.size) text += line_text("", "with the size that mesh would choose:");
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
