// Progress on stderr, for people and for programs.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "engine/engine.h"
#include "tools/forecast.h"
#include "tools/results.h"

namespace locvol {

// Where a command stands.
struct Standing {
  RunStage stage = RunStage::kIngest;
  Progress progress;                // of a run
  std::uint64_t done = 0, all = 0;  // of a stage after it: listed cells to measure, cells to write
  double fraction = 0;              // done of the stage's work
  double seconds = 0;               // since the command began
  std::optional<double> seconds_left;  // until all is done
  std::optional<double> cells_per_second;
  std::uint64_t resident = 0, peak_resident = 0, memory_cap = 0;  // bytes
};

// The line that shows progress, without its end.
std::string progress_text(const Standing& standing);
// The event that tells progress (tools/runs.md).
Json progress_json(const Standing& standing);

// Seconds spent in each stage of a run, as far as its progress tells: what passes before a stage is
// first seen belongs to the one before it. So opening the store that `resume` goes on with counts
// as ingest, and closing that of a finished run as refinement.
class StageClock {
 public:
  static constexpr std::size_t kNumStages = 3;  // up to kRefine

  void note(RunStage stage, double seconds);  // since the start of the run, as of Pace
  // REQUIRES: `seconds` is not less than in the last note().
  std::array<double, kNumStages> seconds_by_stage(double seconds) const;

 private:
  RunStage stage_ = RunStage::kIngest;
  double last_seconds_ = 0;  // when stage_ began
  std::array<double, kNumStages> seconds_{};
};

enum class ProgressStyle { kNone, kText, kJson };

// Text: on a terminal one line, redrawn; in a log a line at each stage, and now and then. JSON: an
// object a line, at each stage, and each second. Called by one thread at a time.
class ProgressLine {
 public:
  ProgressLine(ProgressStyle style, std::uint64_t memory_cap);
  ~ProgressLine();  // leaves stderr at the start of a line
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;

  // The run is known: from now on the time left is told.
  void expect(const RunEstimate& estimate, bool writes);
  void update(const Progress& progress);
  void update(RunStage stage, std::uint64_t done, std::uint64_t all);
  void note(const std::string& text);
  // Tells something: in JSON, as an event of this name; as text, the text. Only for JSON `json` is
  // asked: to destroy a Json takes memory, and where there is none, its library ends the process.
  void tell(std::string_view event, const std::function<Json()>& json, const std::string& text);
  void clear();            // leaves stderr at the start of a line
  double seconds() const;  // since construction
  const StageClock& stages() const { return stages_; }

 private:
  double worked(double now);  // seconds of work until now
  void show(double now, double worked, bool is_last);
  void draw(const std::string& text);

  const ProgressStyle style_;
  const bool is_terminal_;
  const std::chrono::steady_clock::time_point start_;
  Forecast forecast_;
  WorkingTime working_time_;
  StageClock stages_;
  Standing standing_;
  std::uint64_t num_cells_before_ = 0;  // of a run that goes on
  std::optional<double> run_seen_;      // in seconds of work
  std::optional<RunStage> last_stage_;
  double last_seconds_ = 0;  // of the last line
  bool is_line_open_ = false;
};

}  // namespace locvol
