#include <fmt/format.h>
#include <signal.h>

#include <algorithm>
#include <array>
#include <map>
#include <random>
#include <vector>

#include "tests/sweeps/steps.h"
#include "tests/sweeps/sweeps.h"
#include "tests/sweeps/trial.h"

namespace locvol::sweeps {
namespace {

// What a commit takes at most (engine/run/README.md): these visits may have to be made again.

const std::array<Model, 4> kModels = {
    {{"three-holes", "2k", "10%", "150"},
     {"octahandles", "40k", "6%", "60"},
     {"torus", "500", "16%", "40"},
     {"sphere",
      "2k",
      "10%",
      "100",
      {"--growth", "0.2", "--max-size", "20%", "--per-circle", "16"}}}};

std::uint64_t num_visits_of(const Ending& ending) {
  return static_cast<std::uint64_t>(std::ranges::count(ending.steps, 'r'));
}

// Lives of one run, each ended by a kill; then its end.
class Lives {
 public:
  explicit Lives(Trial& trial) : trial_(trial) { trial_.start_anew(); }

  // False: the run came to its end before the kill.
  bool live(const Disturbance& disturbance, const std::string& how) {
    history_ += (history_.empty() ? "" : ", ") + how;
    const Ending ending = trial_.run(disturbance);
    if (ending.signal != SIGKILL || ending.is_hung) {
      require(ending.exit_code == 0,
              trial_.model().name() + ", " + history_ + ": " + ending.text());
      trial_.require_undisturbed_bytes(history_);
      return false;
    }
    const StoreState state = trial_.store_state();
    last_phase_ = state.phase;
    // Killed between the removal of the store and the end, it begins anew.
    const bool is_gone = num_visits_ > 0 && state.num_visits == 0 && is_whole();
    if (is_gone) num_visits_ = 0;
    require(state.num_visits >= num_visits_,
            fmt::format("{}, {}: {} visits are lost that were committed", trial_.model().name(),
                        history_, num_visits_ - state.num_visits));
    const std::uint64_t lost = num_visits_ + num_visits_of(ending) - state.num_visits;
    require(
        is_gone || lost <= kMaxVisitsInHand || is_whole(),
        fmt::format("{}, {}: {} visits must be made again", trial_.model().name(), history_, lost));
    num_visits_ = state.num_visits;
    return true;
  }

  void end() { trial_.require_same_bytes(history_); }
  std::optional<Phase> last_phase() const { return last_phase_; }

 private:
  bool is_whole() const { return std::filesystem::exists(trial_.output()); }

  Trial& trial_;
  std::string history_;
  std::uint64_t num_visits_ = 0;  // committed
  std::optional<Phase> last_phase_;
};

const char* name_of(std::optional<Phase> phase) {
  if (!phase) return "no run in the store";
  constexpr std::array kNames = {"ingest", "measure", "size", "scatter", "cover",
                                 "fill",   "refine",  "mend", "done",    "crease"};
  return kNames[static_cast<std::size_t>(*phase)];
}

void sweep_instants(Trial& trial, int num_kills, std::mt19937_64& random) {
  std::map<std::string, int> kills_of_phase;
  int num_done = 0, num_runs = 0;
  while (num_done < num_kills) {
    ++num_runs;
    Lives lives(trial);
    const double seconds = trial.undisturbed().seconds;
    const auto num_lives = 1 + random() % 6;
    bool is_over = false;
    for (std::uint64_t i = 0; i < num_lives && !is_over; ++i) {
      const double instant = std::uniform_real_distribution<double>(0, 1.05 * seconds)(random);
      Disturbance kill;
      kill.kill_after_seconds = instant;
      is_over = !lives.live(kill, fmt::format("kill -9 at {:.4f} s", instant));
      if (is_over) continue;
      ++num_done;
      ++kills_of_phase[name_of(lives.last_phase())];
    }
    if (!is_over) lives.end();
  }
  fmt::print("  random instants: {} kills in {} runs;", num_done, num_runs);
  for (const auto& [phase, count] : kills_of_phase) fmt::print(" {}: {}", phase, count);
  fmt::print("\n");
}

// One life for each place of one step, in one run: each gets some calls further than the last.
void sweep_steps(Trial& trial, bool is_brief) {
  int num_kills = 0;
  for (const StepName& step : kSteps) {
    const std::uint64_t count = trial.num_steps(step.letter);
    if (count == 0) continue;
    for (const std::uint64_t number : some_of(count, is_brief ? 2 : 5))
      for (const char* side : {"before", "after"}) {
        if (is_brief && (number == 1) == (side[0] == 'a')) continue;
        const std::string place = fmt::format("{}:{}:{}", step.name, number, side);
        Lives lives(trial);
        require(lives.live(Disturbance::kill_at(place), "kill -9 at " + place),
                "no kill at " + place);
        lives.live(Disturbance::kill_at(place), "again");  // it may not get that far any more
        lives.end();
        ++num_kills;
      }
  }
  fmt::print("  steps: {} kills\n", num_kills);
}

std::uint64_t num_calls_of(Trial& trial, const std::string& group) {
  trial.start_anew();
  const Ending counted = trial.run(Disturbance::fault(group + ":1000000000:5"));
  require(counted.exit_code == 0, "counting calls: " + counted.text());
  return static_cast<std::uint64_t>(counted.num_calls);
}

// Around the calls that change files: before, after, and in the middle of a write.
void sweep_calls(Trial& trial, bool is_brief) {
  int num_kills = 0;
  for (const std::string group : {"write", "sync", "size", "open", "name"}) {
    const std::uint64_t count = num_calls_of(trial, group);
    const std::uint64_t how_many = is_brief ? (group == "write" ? 5 : 2) : count;
    for (const std::uint64_t number : some_of(count, how_many))
      for (const std::string action : {"kill", "killed", "torn"}) {
        if (action == "torn" && group != "write") continue;
        if (is_brief && action != (group == "write" ? "torn" : "killed")) continue;
        const std::string place = fmt::format("{}:{}:{}", group, number, action);
        Lives lives(trial);
        require(lives.live(Disturbance::fault(place), "kill -9 at call " + place),
                "no kill at call " + place);
        lives.end();
        ++num_kills;
      }
  }
  fmt::print("  calls of the system: {} kills\n", num_kills);
}

}  // namespace

void sweep_kills(const SweepOptions& options) {
  std::mt19937_64 random(options.seed);
  fmt::print("kill -9, seed {}\n", options.seed);
  std::map<char, std::uint64_t> num_steps;
  for (std::size_t m = 0; m < kModels.size(); ++m) {
    Trial trial(kModels[m], options.directory / kModels[m].shape);
    fmt::print("{}: {:.2f} s, {} visits\n", kModels[m].name(), trial.undisturbed().seconds,
               trial.num_steps('r'));
    for (const StepName& step : kSteps) num_steps[step.letter] += trial.num_steps(step.letter);
    const int num_kills =
        options.is_brief ? 4 : options.num_kills / static_cast<int>(kModels.size());
    sweep_instants(trial, num_kills, random);
    if (m == 2 || !options.is_brief) sweep_steps(trial, options.is_brief);
    if (m == 2) sweep_calls(trial, options.is_brief);
  }
  for (const StepName& step : kSteps)
    require(num_steps[step.letter] > 0,
            fmt::format("the step `{}` never happened: see steps.cpp", step.name));
}

}  // namespace locvol::sweeps
