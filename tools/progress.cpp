#include "tools/progress.h"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>

#include "engine/shared/memory_budget.h"
#include "tools/tell_user.h"

namespace locvol {
namespace {

constexpr double kTerminalInterval = 0.2;  // seconds
constexpr double kLogInterval = 15;
constexpr double kEventInterval = 1;
constexpr double kLeastOfARate = 0.5;

// Never more than what is done.
double percent_done(double fraction) { return std::floor(100 * fraction); }

// A longer line would not be redrawn in its place. The text has one byte a column.
std::string cut_to_terminal(const std::string& text) {
  winsize size = {};
  if (ioctl(STDERR_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_col < 2) return text;
  return text.substr(0, size.ws_col - std::size_t{1});
}

void print_event(const Json& json) { tell_user("{}\n", json_line(json)); }

}  // namespace

std::string progress_text(const Standing& standing) {
  const Progress& progress = standing.progress;
  const auto count = [](std::uint64_t number) { return count_text(static_cast<double>(number)); };
  const bool is_run = standing.stage <= RunStage::kRefine;
  std::string text =
      fmt::format("{} {}: ", duration_text(standing.seconds), stage_name(standing.stage));
  if (standing.stage == RunStage::kIngest)
    text += fmt::format("{} triangles read, checked and cut", progress.num_triangles);
  else
    text += fmt::format("{:.0f}%", percent_done(standing.fraction));
  // First, for a narrow terminal cuts off the end.
  if (standing.seconds_left)
    text += fmt::format(", about {} left", duration_text(*standing.seconds_left));
  if (is_run && standing.stage != RunStage::kIngest) {
    text += fmt::format(", {} cells", count(progress.counts.num_cells));
    if (standing.cells_per_second.value_or(0) > 0)
      text += fmt::format(" ({}/s)", count_text(*standing.cells_per_second));
    text += fmt::format(", {} of {} leaves wait", progress.num_queued, progress.num_leaves);
    if (standing.stage == RunStage::kRefine) text += fmt::format(", epoch {}", progress.epoch);
  } else if (!is_run && standing.all > 0) {
    text += fmt::format(", of {} {}", count(standing.all),
                        standing.stage == RunStage::kAudit ? "leaves" : "cells");
  }
  constexpr double kMiB = 1 << 20;
  if (standing.memory_cap > 0)
    text += fmt::format(", {:.0f}/{:.0f} MiB", static_cast<double>(standing.resident) / kMiB,
                        static_cast<double>(standing.memory_cap) / kMiB);
  return text;
}

Json progress_json(const Standing& standing) {
  const Progress& progress = standing.progress;
  Json json = {{"event", "progress"},
               {"seconds", standing.seconds},
               {"phase", stage_name(standing.stage)},
               {"fraction", standing.fraction},
               {"num_triangles", progress.num_triangles},
               {"num_leaves", progress.num_leaves},
               {"num_waiting", progress.num_queued},
               {"num_in_epoch", progress.num_in_epoch},
               {"epoch", progress.epoch},
               {"num_visits", progress.counts.num_visits},
               {"num_points", progress.counts.num_points},
               {"num_cells", progress.counts.num_cells},
               {"cells_per_second", nullptr},
               {"seconds_left", nullptr},
               {"resident_bytes", standing.resident},
               {"peak_resident_bytes", standing.peak_resident},
               {"memory_cap_bytes", standing.memory_cap}};
  if (standing.cells_per_second) json["cells_per_second"] = *standing.cells_per_second;
  if (standing.seconds_left) json["seconds_left"] = *standing.seconds_left;
  return json;
}

void StageClock::note(RunStage stage, double seconds) {
  if (stage == stage_) return;
  seconds_ = seconds_by_stage(seconds);
  stage_ = stage;
  last_seconds_ = seconds;
}

std::array<double, StageClock::kNumStages> StageClock::seconds_by_stage(double seconds) const {
  auto all = seconds_;
  all[static_cast<std::size_t>(stage_)] += seconds - last_seconds_;
  return all;
}

ProgressLine::ProgressLine(ProgressStyle style, std::uint64_t memory_cap)
    : style_(style),
      is_terminal_(style == ProgressStyle::kText && isatty(STDERR_FILENO) == 1),
      start_(std::chrono::steady_clock::now()) {
  standing_.memory_cap = memory_cap;
}

ProgressLine::~ProgressLine() { clear(); }

double ProgressLine::seconds() const {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
}

void ProgressLine::expect(const RunEstimate& estimate, bool writes) {
  forecast_.expect(estimate, writes);
}

void ProgressLine::update(const Progress& progress) {
  const double now = seconds(), worked = this->worked(now);
  stages_.note(stage_of(progress.phase), now);
  forecast_.note(progress, worked);
  if (progress.phase == Phase::kDone) return;  // the measures are next
  const std::uint64_t num_triangles = standing_.progress.num_triangles;
  standing_.progress = progress;
  standing_.progress.num_triangles = std::max(progress.num_triangles, num_triangles);
  if (progress.phase != Phase::kIngest) {
    if (!run_seen_) num_cells_before_ = progress.counts.num_cells;
    if (!run_seen_) run_seen_ = worked;
    const auto num_new =
        static_cast<double>(progress.counts.num_cells) - static_cast<double>(num_cells_before_);
    const double took = worked - *run_seen_;
    if (took > kLeastOfARate) standing_.cells_per_second = num_new / took;
  }
  show(now, worked, false);
}

void ProgressLine::update(RunStage stage, std::uint64_t done, std::uint64_t all) {
  const double now = seconds(), worked = this->worked(now);
  forecast_.note(stage, done, all, worked);
  standing_.done = done;
  standing_.all = all;
  show(now, worked, stage == RunStage::kWrite && done == all && all > 0);
}

double ProgressLine::worked(double now) {
  return working_time_.at(now, static_cast<double>(std::clock()) / CLOCKS_PER_SEC);
}

void ProgressLine::show(double now, double worked, bool is_last) {
  if (style_ == ProgressStyle::kNone) return;
  const double interval = style_ == ProgressStyle::kJson ? kEventInterval
                          : is_terminal_                 ? kTerminalInterval
                                                         : kLogInterval;
  const RunStage stage = forecast_.stage();
  const bool is_event = is_last && style_ == ProgressStyle::kJson;
  if (stage == last_stage_ && now - last_seconds_ < interval && !is_event) return;
  last_stage_ = stage;
  last_seconds_ = now;
  standing_.stage = stage;
  standing_.seconds = now;
  standing_.fraction = forecast_.fraction_done();
  standing_.seconds_left = forecast_.seconds_left(worked);
  standing_.resident = resident_memory();
  standing_.peak_resident = peak_resident_memory();
  if (style_ == ProgressStyle::kJson)
    print_event(progress_json(standing_));
  else
    draw(progress_text(standing_));
}

void ProgressLine::note(const std::string& text) {
  tell(
      "note",
      [&] {
        return Json{{"text", text}};
      },
      text);
}

void ProgressLine::tell(std::string_view event, const std::function<Json()>& json,
                        const std::string& text) {
  if (style_ == ProgressStyle::kJson) {
    Json whole = {{"event", event}, {"seconds", seconds()}};
    whole.update(json());
    print_event(whole);
  } else if (style_ == ProgressStyle::kText) {
    clear();
    tell_user("locvol: {}\n", text);
  }
}

void ProgressLine::clear() {
  if (is_line_open_) tell_user("\r\x1b[K");
  is_line_open_ = false;
}

void ProgressLine::draw(const std::string& text) {
  clear();
  if (is_terminal_)
    tell_user("{}", cut_to_terminal(text));
  else
    tell_user("{}\n", text);
  is_line_open_ = is_terminal_;
}

}  // namespace locvol
