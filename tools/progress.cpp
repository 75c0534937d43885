#include "tools/progress.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace locvol {
namespace {

constexpr double kTerminalInterval = 0.2;  // seconds
constexpr double kLogInterval = 15;        // seconds

}  // namespace

std::string_view phase_name(Phase phase) {
  switch (phase) {
    case Phase::kIngest:
      return "ingest";
    case Phase::kInitialize:
      return "initialize";
    case Phase::kRefine:
      return "refine";
    case Phase::kDone:
      return "done";
  }
  return "unknown";
}

std::string duration_text(double seconds) {
  const auto total = static_cast<std::uint64_t>(std::llround(seconds));
  const std::uint64_t hours = total / 3600, minutes = total / 60 % 60;
  return hours > 0 ? fmt::format("{}:{:02}:{:02}", hours, minutes, total % 60)
                   : fmt::format("{}:{:02}", minutes, total % 60);
}

std::string progress_text(const Progress& progress, double seconds,
                          std::optional<double> seconds_left) {
  if (progress.phase == Phase::kIngest)
    return fmt::format("{} ingest: {} triangles read, checked and cut", duration_text(seconds),
                       progress.num_triangles);
  std::string text =
      fmt::format("{} {}: {} leaves, {} queued", duration_text(seconds), phase_name(progress.phase),
                  progress.num_leaves, progress.num_queued);
  if (progress.phase >= Phase::kRefine) {
    text += fmt::format(", epoch {}, {} visits", progress.epoch, progress.num_visits);
  }
  text += fmt::format(", {} points, {} cells", progress.num_points, progress.num_cells);
  if (seconds_left) text += fmt::format(", about {} left", duration_text(*seconds_left));
  return text;
}

std::optional<double> Pace::seconds_left(const Progress& progress, double seconds) {
  if (progress.phase != Phase::kRefine) return std::nullopt;
  if (!start_) start_ = Start{seconds, progress.num_visits};
  const std::uint64_t visits = progress.num_visits - start_->num_visits;
  if (visits == 0) return std::nullopt;
  return (seconds - start_->seconds) / static_cast<double>(visits) *
         static_cast<double>(progress.num_queued);
}

void PhaseClock::note(Phase phase, double seconds) {
  const Phase working = std::min(phase, Phase::kRefine);
  if (working == phase_) return;
  seconds_ = seconds_by_phase(seconds);
  phase_ = working;
  last_seconds_ = seconds;
}

std::array<double, PhaseClock::kNumPhases> PhaseClock::seconds_by_phase(double seconds) const {
  auto all = seconds_;
  all[static_cast<std::size_t>(phase_)] += seconds - last_seconds_;
  return all;
}

ProgressLine::ProgressLine(bool is_quiet)
    : is_quiet_(is_quiet),
      is_terminal_(isatty(STDERR_FILENO) == 1),
      start_(std::chrono::steady_clock::now()) {}

ProgressLine::~ProgressLine() { clear(); }

double ProgressLine::seconds() const {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
}

void ProgressLine::update(const Progress& progress) {
  const double now = seconds();
  phases_.note(progress.phase, now);
  const auto left = pace_.seconds_left(progress, now);
  const double interval = is_terminal_ ? kTerminalInterval : kLogInterval;
  const bool is_due = progress.phase != last_phase_ || now - last_seconds_ >= interval;
  if (is_quiet_ || !is_due) return;
  last_phase_ = progress.phase;
  last_seconds_ = now;
  draw(progress_text(progress, now, left));
}

void ProgressLine::note(const std::string& text) {
  if (is_quiet_) return;
  clear();
  fmt::print(stderr, "locvol: {}\n", text);
}

void ProgressLine::clear() {
  if (is_line_open_) fmt::print(stderr, "\r\x1b[K");
  is_line_open_ = false;
}

void ProgressLine::draw(const std::string& text) {
  clear();
  fmt::print(stderr, "{}{}", text, is_terminal_ ? "" : "\n");
  is_line_open_ = is_terminal_;
}

}  // namespace locvol
