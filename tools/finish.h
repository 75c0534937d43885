// What `mesh` and `resume` have in common, by one process and by several ranks: the run under its
// line of progress, and what comes after it: the output, the lists, the result.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "engine/engine.h"
#include "engine/exchange/exchange.h"
#include "engine/exchange/one_rank.h"
#include "engine/formats/writer.h"
#include "tools/progress.h"
#include "tools/results.h"
#include "tools/run_command.h"
#include "tools/stop_signal.h"

namespace locvol {

// The place where a run is kept, and by whom.
struct RunPlace {
  std::filesystem::path stores;  // of ranks, %r is the rank
  Exchange& exchange = alone();
  bool is_of_ranks = false;  // if only one
  std::filesystem::path own() const;
  bool is_first() const { return exchange.rank() == 0; }
  std::string_view program() const { return is_of_ranks ? "locvol-mpi" : "locvol"; }
};

struct TimedRun {
  RunSummary summary;
  std::vector<std::pair<std::string_view, double>> seconds;  // by phase
  int num_writers = 1;                                       // threads for the output
};

ProgressStyle progress_style(const auto& command) {
  if (command.is_quiet) return ProgressStyle::kNone;
  return command.is_json ? ProgressStyle::kJson : ProgressStyle::kText;
}

// The result of `work`, which tells the line of its steps.
template <class Work>
auto with_steps(RunStage stage, ProgressLine& line, const Work& work) {
  line.update(stage, 0, 0);  // there may be something to do before the first step
  return work(
      [&line, stage](std::uint64_t done, std::uint64_t all) { line.update(stage, done, all); });
}

// Under the cap on memory.
TimedRun run_with_progress(RunControl control, std::uint64_t cap, ProgressLine& line,
                           const std::function<RunSummary(const RunControl&)>& run);
// Called by all ranks, of which the first one tells. Returns the exit code.
int finish(const TimedRun& run, const RunPlace& place, const RunCommand& command,
           const StopSignal& stop, ProgressLine& line);

std::string_view outcome_name(RunOutcome outcome);
int exit_code(RunOutcome outcome);
std::string written_text(const std::filesystem::path& output, const OutputOptions& options,
                         const WriteSummary& written);
Json written_json(const std::filesystem::path& output, const OutputOptions& options,
                  const WriteSummary& written);

}  // namespace locvol
