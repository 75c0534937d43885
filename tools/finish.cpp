#include "tools/finish.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>

#include "engine/exchange/in_rank_order.h"
#include "engine/exchange/one_rank.h"
#include "engine/inspect/crease_table.h"
#include "engine/inspect/mesh_statistics.h"
#include "engine/output/stored_mesh.h"
#include "engine/plan/run_estimate.h"
#include "engine/ranks/rank_store.h"
#include "engine/shared/memory_budget.h"
#include "engine/shared/workers.h"
#include "tools/exit_code.h"
#include "tools/faces.h"
#include "tools/leaf_site_fields.h"
#include "tools/stored_run.h"
#include "tools/tell_user.h"

namespace locvol {
namespace {

constexpr std::size_t kMaxListedSites = 20;  // on stderr; `inspect` lists all

using Seconds = decltype(TimedRun::seconds);

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

void tell_how_to_resume(const RunPlace& place, const RunCommand& command, ProgressLine& line) {
  const std::filesystem::path& output = command.control.output;
  if (command.is_json)
    return line.tell(
        "interrupted",
        [&] {
          return Json{{"store", place.stores.string()}};
        },
        "");
  std::string arguments = place.stores.string();
  if (!output.empty()) {
    const OutputOptions& options = command.control.output_options;
    arguments += fmt::format(" -o {}", output.string());
    if (format_of(output) != options.format)
      arguments += fmt::format(" --format {}", info_of(options.format).name);
    if (options.has_quality) arguments += " --cell-data quality";
    if (options.has_boundary) arguments += " --boundary";
    if (options.order == 2) arguments += " --order 2";
    if (options.splits_interfaces) arguments += " --split-interfaces";
    if (options.has_faces) arguments += " --faces";
    if (command.control.is_in_pieces) arguments += " --pieces";
  }
  line.clear();
  tell_user("{0}: interrupted; `{0} resume {1}` goes on\n", place.program(), arguments);
}

// `sites`: the first of `num_all`.
void tell_unresolved(const std::vector<LeafSite>& sites, std::uint64_t num_all,
                     const RunPlace& place, bool is_json, ProgressLine& line) {
  if (is_json) {
    const auto json = [&] {
      Json all = {{"num_unresolved", num_all}, {"sites", Json::array()}};
      for (const LeafSite& site : sites) all["sites"].push_back(to_json(site));
      return all;
    };
    return line.tell("unresolved", json, "");
  }
  line.clear();
  tell_user("{}: {} unresolved: the surface is not smooth there at scale λ\n", place.program(),
            num_all == 1 ? "1 site is" : fmt::format("{} sites are", num_all));
  for (const LeafSite& site : sites) tell_user("  {}\n", site_text(site));
  if (num_all > sites.size())
    tell_user("  and {} more: `{} inspect {} --unresolved` lists all\n", num_all - sites.size(),
              place.program(), place.stores.string());
}

// The exit code stays 0, and with --quiet the count is in the summary.
// `cells`: the first of them.
void tell_poor_cells(const std::vector<LeafPoorCell>& cells, const MeshStatistics& statistics,
                     std::string_view program, ProgressLine& line) {
  const auto json = [&] {
    Json all = {{"num_poor_cells", statistics.num_poor_cells},
                {"num_forced_cells", statistics.num_forced_cells},
                {"cells", Json::array()}};
    for (const LeafPoorCell& cell : cells) all["cells"].push_back(to_json(cell));
    return all;
  };
  std::string text = fmt::format(
      "{} cell{} a dihedral angle below {}°, which nothing improved", statistics.num_poor_cells,
      statistics.num_poor_cells == 1 ? " has" : "s have", statistics.min_dihedral_bound);
  if (statistics.num_forced_cells > 0)
    text += fmt::format(": {} forced by thin walls or acute creases", statistics.num_forced_cells);
  for (const LeafPoorCell& cell : cells) text += fmt::format("\n  {}", poor_cell_text(cell));
  if (statistics.num_poor_cells > cells.size())
    text += fmt::format(
        "\n  and {} more: of a store that is kept, `{} inspect DIR --unresolved` lists all",
        statistics.num_poor_cells - cells.size(), program);
  line.tell("poor_cells", json, text);
}

std::vector<std::string> names_of(const std::filesystem::path& output,
                                  const OutputOptions& options) {
  std::vector<std::string> names;
  for (const auto& file : files_of(options, output)) names.push_back(file.string());
  return names;
}

// Of a run that is done.
struct MeasuredMesh {
  std::optional<MemoryRecord> memory;
  std::optional<MeshStatistics> statistics;
  std::optional<CreaseTable> creases;  // if the run keeps some
  std::optional<WriteSummary> written;
};

// What the output's file is called, or that of all pieces, or the first piece.
std::filesystem::path name_of_output(const RunControl& control) {
  const MeshFormat format = control.output_options.format;
  if (!control.is_in_pieces) return control.output;
  return index_of_pieces(control.output, format).value_or(piece_of(control.output, format, 0));
}

WriteSummary write(const Store& store, const RunControl& control, int num_threads,
                   const RunPlace& place, const StopSignal& stop, const StepProgress& on_step) {
  return control.is_in_pieces ? write_piece_as_rank(store, control.output, control.output_options,
                                                    place.exchange, num_threads)
                              : write_mesh(store, control.output, control.output_options,
                                           num_threads, on_step, &stop, place.exchange);
}

// Throws Stopped.
MeasuredMesh measure_and_write(const TimedRun& run, const RunPlace& place,
                               const RunCommand& command, const StopSignal& stop,
                               ProgressLine& line, Seconds& seconds) {
  Exchange& exchange = place.exchange;
  const Store store = open_to_read(place.own());
  MeasuredMesh mesh;
  mesh.memory = store.snapshot().memory();
  // There are no cells to measure in a run of the surface alone.
  const bool has_cells = !run.summary.run.parameters.is_surface_only;
  mesh.statistics = timed(RunStage::kMeasure, line, seconds, [&](const StepProgress& on_step) {
    if (keeps_creases(run.summary.run)) mesh.creases = crease_table(store, &stop, exchange);
    std::optional<MeshStatistics> statistics;
    if (has_cells) statistics = mesh_statistics(store, run.num_writers, on_step, &stop, exchange);
    return statistics;
  });
  if (!command.control.output.empty())
    mesh.written = timed(RunStage::kWrite, line, seconds, [&](const StepProgress& on_step) {
      WriteSummary written = write(store, command.control, run.num_writers, place, stop, on_step);
      if (command.control.output_options.has_faces)
        write_faces(store, command.control.output, command.control.output_options.splits_interfaces,
                    &stop, exchange);
      return written;
    });
  if (run.summary.outcome == RunOutcome::kUnresolved) {
    const std::vector<LeafSite> own = unresolved_sites(store.snapshot());
    const std::uint64_t num_all = sum(exchange, own.size()).all;
    const std::vector<LeafSite> sites = first_of_ranks(exchange, own, kMaxListedSites);
    if (place.is_first()) tell_unresolved(sites, num_all, place, command.is_json, line);
  }
  // To find them takes time. Ranks but the first are quiet.
  if (mesh.statistics && mesh.statistics->num_poor_cells > 0 && any(exchange, !command.is_quiet)) {
    const auto cells = first_poor_cells(store, kMaxListedSites, run.num_writers, exchange);
    if (place.is_first()) tell_poor_cells(cells, *mesh.statistics, place.program(), line);
  }
  return mesh;
}

void print_result(const RunSummary& run, RunOutcome outcome, const MeasuredMesh& mesh,
                  const Seconds& seconds, const RunCommand& command) {
  const auto& [memory, statistics, creases, written] = mesh;
  const OutputOptions& options = command.control.output_options;
  const std::filesystem::path output = name_of_output(command.control);
  if (command.is_json) {
    Json json = {{"outcome", outcome_name(outcome)},
                 {"seconds", total(seconds)},
                 {"seconds_by_phase", by_phase_json(seconds)}};
    json.update(to_json(run));
    if (creases) add_kept_creases(run.sheets, *creases, json);
    json["peak_resident_bytes"] = peak_resident_memory();
    if (memory) json["memory_cap_bytes"] = memory->cap;
    if (statistics) json["statistics"] = to_json(*statistics, run.run);
    if (written) json["written"] = written_json(output, options, *written);
    print_json(json);
  } else {
    fmt::print("{}{}", summary_text(run, creases ? &*creases : nullptr),
               line_text("time", time_text(seconds)));
    if (memory) fmt::print("{}", line_text("memory", peak_text(*memory)));
    if (written) fmt::print("{}", written_text(output, options, *written));
    if (statistics)
      fmt::print("{}{}", body_statistics_text(run.sheets, *statistics),
                 statistics_text(*statistics, run.run));
  }
}

// What each rank has said, taken and waited for.
void tell_ranks(const RunSummary& run, Exchange& exchange, bool is_json, ProgressLine& line) {
  const ExchangeStats said = exchange.stats();
  const Json of_rank = {{"rank", exchange.rank()},
                        {"num_messages_sent", said.num_messages},
                        {"bytes_sent", said.num_bytes},
                        {"seconds_waiting", said.seconds},
                        {"cpu_seconds_of_visits", run.cpu_of_visits},
                        {"peak_resident_bytes", peak_resident_memory()}};
  for (const std::string& text : exchange.gather(of_rank.dump()))
    if (is_json && exchange.rank() == 0)
      line.tell(
          "rank", [&] { return Json::parse(text); }, "");
}

}  // namespace

std::filesystem::path RunPlace::own() const {
  return is_of_ranks ? store_of_rank(stores, exchange.rank()) : stores;
}

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

int finish(const TimedRun& run, const RunPlace& place, const RunCommand& command,
           const StopSignal& stop, ProgressLine& line) {
  RunOutcome outcome = run.summary.outcome;
  MeasuredMesh mesh;
  Seconds seconds = run.seconds;
  if (outcome != RunOutcome::kInterrupted) try {
      if (place.is_of_ranks) tell_ranks(run.summary, place.exchange, command.is_json, line);
      mesh = measure_and_write(run, place, command, stop, line, seconds);
    } catch (const Stopped&) {
      outcome = RunOutcome::kInterrupted;
    }
  if (outcome == RunOutcome::kInterrupted && place.is_first())
    tell_how_to_resume(place, command, line);
  line.clear();
  if (place.is_first()) print_result(run.summary, outcome, mesh, seconds, command);
  return exit_code(outcome);
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

std::string written_text(const std::filesystem::path& output, const OutputOptions& options,
                         const WriteSummary& written) {
  const std::string names = fmt::format("{}", fmt::join(names_of(output, options), ", "));
  if (info_of(options.format).is_surface || written.num_cells == 0)
    return fmt::format("{:<16} {}: {} boundary triangles, {}\n", "written", names,
                       written.num_boundary_facets, bytes_text(written.bytes));
  if (options.order == 1)
    return fmt::format("{:<16} {}: {} cells, {} vertices, {}\n", "written", names,
                       written.num_cells, written.num_vertices, bytes_text(written.bytes));
  const std::string off =
      written.num_nodes_off_surface > 0
          ? fmt::format(" ({} of boundary edges off it)", written.num_nodes_off_surface)
          : "";
  return fmt::format(
      "{:<16} {}: {} cells of order 2, {} vertices, {} nodes in the middle of edges, {} moved to "
      "the "
      "surface{}, {}\n",
      "written", names, written.num_cells, written.num_vertices, written.num_nodes,
      written.num_nodes_on_surface, off, bytes_text(written.bytes));
}

Json written_json(const std::filesystem::path& output, const OutputOptions& options,
                  const WriteSummary& written) {
  Json json = to_json(written);
  json["file"] = names_of(output, options).front();
  json["format"] = info_of(options.format).name;
  json["order"] = options.order;
  json["split_interfaces"] = options.splits_interfaces;
  if (options.order == 2) {
    json["num_nodes"] = written.num_nodes;
    json["num_nodes_on_surface"] = written.num_nodes_on_surface;
    json["num_nodes_off_surface"] = written.num_nodes_off_surface;
  }
  return json;
}

}  // namespace locvol
