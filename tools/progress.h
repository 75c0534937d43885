// Progress on stderr: on a terminal one line, redrawn; in a log a line now and then.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <optional>
#include <string>

#include "engine/engine.h"

namespace locvol {

std::string_view phase_name(Phase phase);
// "1:02:03", "4:05"; rounded to seconds. REQUIRES: seconds >= 0
std::string duration_text(double seconds);
// One line, without its end. `seconds_left` is empty while nothing is known of it.
std::string progress_text(const Progress& progress, double seconds,
                          std::optional<double> seconds_left);

// Guesses the time left from the visits so far. A lower bound in spirit: visits may queue more.
class Pace {
 public:
  // `seconds`: since any fixed instant, never less than in the call before.
  std::optional<double> seconds_left(const Progress& progress, double seconds);

 private:
  struct Start {
    double seconds;
    std::uint64_t num_visits;
  };
  std::optional<Start> start_;  // of refinement, in this process
};

// Seconds spent in each phase, as far as a run's progress tells: what passes before a phase is
// first seen belongs to the one before it. So opening the store that `resume` goes on with counts
// as ingest, and closing that of a finished run as refinement.
class PhaseClock {
 public:
  static constexpr std::size_t kNumPhases = 3;  // those in which there is work: up to kRefine

  void note(Phase phase, double seconds);  // since the start of the run, as of Pace
  // REQUIRES: `seconds` is not less than in the last note().
  std::array<double, kNumPhases> seconds_by_phase(double seconds) const;

 private:
  Phase phase_ = Phase::kIngest;
  double last_seconds_ = 0;  // when phase_ began
  std::array<double, kNumPhases> seconds_{};
};

class ProgressLine {
 public:
  explicit ProgressLine(bool is_quiet);
  ~ProgressLine();  // leaves stderr at the start of a line
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;

  void update(const Progress& progress);
  void note(const std::string& text);
  double seconds() const;  // since construction
  const PhaseClock& phases() const { return phases_; }

 private:
  void clear();
  void draw(const std::string& text);

  const bool is_quiet_;
  const bool is_terminal_;
  const std::chrono::steady_clock::time_point start_;
  Pace pace_;
  PhaseClock phases_;
  std::optional<Phase> last_phase_;
  double last_seconds_ = 0;  // of the last line
  bool is_line_open_ = false;
};

}  // namespace locvol
