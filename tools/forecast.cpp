#include "tools/forecast.h"

#include <algorithm>

namespace locvol {
namespace {

// A leaf's later visits are of its borders alone: what one takes of a first one, and how many
// follow each first visit, and each of a later one. Of recorded runs (forecast_test.cpp).
constexpr double kLaterVisit = 0.2, kSecondVisits = 0.8, kFurtherVisits = 0.05;
// Of a leaf's first points: what filling its holes takes of covering it.
constexpr double kFill = 0.55;
// As a part of a stage's work: what must have been done before its pace weighs as much as the
// guess.
constexpr double kTrustInPace = 0.05;
// As a part of the whole run: what must have been measured before it weighs as much as the law.
constexpr double kTrustInLaw = 0.02;

// A pause is at least so long, and had at most this part of the usual CPU time.
constexpr double kLeastPause = 2, kBusyInPause = 0.125;

std::size_t index(RunStage stage) { return static_cast<std::size_t>(stage); }

// What a visit of the open epoch takes, in those of its phase's first one.
double unit_of(const Progress& progress) {
  if (progress.phase == Phase::kFill) return kFill;
  if (!are_first_points_known(progress.phase)) return 1;
  return progress.epoch <= progress.first_epoch ? 1 : kLaterVisit;
}

// Of the leaves that wait, in those; with those that will yet have to wait.
double units_left(const Progress& progress) {
  const auto now = static_cast<double>(progress.num_in_epoch);
  const auto next = static_cast<double>(progress.num_queued - progress.num_in_epoch);
  if (progress.phase == Phase::kFill) return kFill * (now + next);
  if (!are_first_points_known(progress.phase)) return now + kFill * (next + now);
  if (progress.epoch <= progress.first_epoch)
    return now + kLaterVisit * (next + kSecondVisits * now);
  return kLaterVisit * (now + next + kFurtherVisits * now);
}

}  // namespace

std::string_view stage_name(RunStage stage) {
  switch (stage) {
    case RunStage::kIngest:
      return "ingest";
    case RunStage::kInitialize:
      return "initialize";
    case RunStage::kRefine:
      return "refine";
    case RunStage::kMeasure:
      return "measure";
    case RunStage::kWrite:
      return "write";
    case RunStage::kAudit:
      return "audit";
  }
  return "unknown";
}

void Forecast::expect(const RunEstimate& estimate, bool writes) {
  estimate_ = estimate;
  writes_ = writes;
  // The surface has been read and checked, and has yet to be cut.
  if (stage_ == RunStage::kIngest) set_work(0.8, 0.2, began_);
}

void Forecast::note(const Progress& progress, double seconds) {
  if (progress.phase == Phase::kDone) return enter(RunStage::kMeasure, seconds);
  enter(stage_of(progress.phase), seconds);
  if (stage_ == RunStage::kIngest) return;
  if (progress.epoch != epoch_ || num_in_epoch_ == 0) {
    units_before_ += unit_ * static_cast<double>(num_in_epoch_);
    epoch_ = progress.epoch;
    unit_ = unit_of(progress);
    num_in_epoch_ = progress.num_in_epoch;
  }
  const auto num_done = static_cast<double>(num_in_epoch_ - progress.num_in_epoch);
  set_work(units_before_ + unit_ * num_done, units_left(progress), seconds);
}

void Forecast::note(RunStage stage, std::uint64_t done, std::uint64_t all, double seconds) {
  enter(stage, seconds);
  if (all > 0) set_work(static_cast<double>(done), static_cast<double>(all - done), seconds);
}

void Forecast::enter(RunStage stage, double seconds) {
  if (stage == stage_) return;
  taken_ += seconds - began_;
  guessed_ += law(stage_);
  stage_ = stage;
  began_ = seconds;
  done_ = first_done_ = first_seconds_ = units_before_ = 0;
  left_ = 1;
  epoch_ = 0;
  num_in_epoch_ = 0;
}

void Forecast::set_work(double done, double left, double seconds) {
  if (done_ == 0 && done > 0) {
    // What comes before the first steps of the output is not at their pace.
    const bool is_step = stage_ > RunStage::kRefine;
    first_done_ = is_step ? done : 0;
    first_seconds_ = is_step ? seconds : began_;
  }
  done_ = done;
  left_ = left;
}

double Forecast::fraction_done() const { return done_ + left_ > 0 ? done_ / (done_ + left_) : 1; }

double Forecast::law(RunStage stage) const {
  const bool has_law = estimate_ && index(stage) < kNumStages;
  if (!has_law || (stage == RunStage::kWrite && !writes_)) return 0;
  return estimate_->seconds[index(stage)];
}

// What the run has taken against the law.
double Forecast::slowness(double seconds) const {
  if (!estimate_) return 1;
  const double trust = kTrustInLaw * estimate_->total_seconds();
  const double taken = taken_ + (seconds - began_),
               guessed = guessed_ + fraction_done() * law(stage_);
  return (taken + trust) / (guessed + trust);
}

std::optional<double> Forecast::seconds_left(double seconds) const {
  const bool has_pace = stage_ > RunStage::kRefine && done_ > first_done_;
  if (!estimate_ && !has_pace) return std::nullopt;
  const double slow = slowness(seconds);
  double later = 0;
  for (std::size_t i = index(stage_) + 1; i < kNumStages; ++i)
    later += slow * law(static_cast<RunStage>(i));
  const double all = done_ + left_;
  if (!(all > 0)) return later;
  const bool is_begun = done_ > 0;
  const double before = is_begun ? first_seconds_ - began_ : 0;
  const double guess = std::max(0.0, slow * law(stage_) - before) / all;  // for a unit
  const double trust = guess > 0 || !has_pace ? kTrustInPace * all : 0;
  const double per_unit =
      ((is_begun ? seconds - first_seconds_ : 0) + trust * guess) / (done_ - first_done_ + trust);
  return per_unit * left_ + later;
}

double WorkingTime::at(double seconds, double cpu_seconds) {
  const double gap = seconds - seconds_;
  const double work =
      cpu_seconds_ > 0 ? (cpu_seconds - cpu_seconds_) * worked_ / cpu_seconds_ : gap;
  worked_ += gap > kLeastPause && work < kBusyInPause * gap ? work : gap;
  seconds_ = seconds;
  cpu_seconds_ = cpu_seconds;
  return worked_;
}

}  // namespace locvol
