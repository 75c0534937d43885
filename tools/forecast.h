// Forecast tells how long a run will still take, with what follows refinement: the measures and the
// output.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "engine/engine.h"
#include "engine/plan/run_estimate.h"

namespace locvol {

std::string_view stage_name(RunStage stage);

// A stage yet to come is guessed from the law of estimate_run(), corrected by what the run has
// taken so far against that law. Of the stage under way the pace tells, ever more: of the work left
// at its end, nothing is guessed. The work left in refinement is that of the open epoch and of the
// next ones, which is known more and more from the leaves that wait for them.
// Instants are seconds since any fixed one, and never go back.
class Forecast {
 public:
  // What is known of the run, once. `writes`: it ends with an output file.
  void expect(const RunEstimate& estimate, bool writes);
  void note(const Progress& progress, double seconds);
  // Notes how far a stage after refinement is; `all`: 0 while it is not known.
  void note(RunStage stage, std::uint64_t done, std::uint64_t all, double seconds);

  RunStage stage() const { return stage_; }
  // The part of the stage's work that is done, from 0 to 1, as far as it is known.
  double fraction_done() const;
  // The time left; nothing before expect(), and of a later stage alone, once there is a pace.
  std::optional<double> seconds_left(double seconds) const;

 private:
  void enter(RunStage stage, double seconds);
  void set_work(double done, double left, double seconds);
  double law(RunStage stage) const;  // seconds
  double slowness(double seconds) const;

  std::optional<RunEstimate> estimate_;
  bool writes_ = true;
  RunStage stage_ = RunStage::kIngest;
  double began_ = 0;  // the stage
  // The stage's work, in a unit of its own; and when some of it was first known to be done.
  double done_ = 0, left_ = 1;
  double first_done_ = 0, first_seconds_ = 0;
  double taken_ = 0, guessed_ = 0;  // seconds of the stages before, and by the law

  // The visits' work: units done in the epochs before, what one takes, and the epoch's leaves when
  // it was first seen.
  std::uint32_t epoch_ = 0;
  double units_before_ = 0, unit_ = 1;
  std::uint64_t num_in_epoch_ = 0;
};

// WorkingTime tells time at work from time in which the process was stopped or its machine asleep:
// a pause is seconds between two calls in which the process had hardly any CPU time, against what
// it had before. It counts as long as that CPU time would have taken before.
class WorkingTime {
 public:
  // Seconds of work so far. `seconds`: since the start; `cpu_seconds`: of the process. Neither goes
  // back.
  double at(double seconds, double cpu_seconds);

 private:
  double seconds_ = 0, cpu_seconds_ = 0;  // of the last call
  double worked_ = 0;
};

}  // namespace locvol
