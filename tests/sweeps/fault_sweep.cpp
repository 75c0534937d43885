#include <errno.h>
#include <fmt/format.h>
#include <string.h>

#include <algorithm>
#include <map>
#include <vector>

#include "tests/sweeps/sweeps.h"
#include "tests/sweeps/trial.h"

namespace locvol::sweeps {
namespace {

// Small, yet with several commits, all phases, and an output of more than one write.
const Model kModel = {"octahandles", "2k", "6%", "100"};

struct Kind {
  std::string group;
  std::vector<std::string> actions;
};

const std::vector<Kind> kKinds = {
    {"write", {std::to_string(ENOSPC), std::to_string(EIO), "short"}},
    {"sync", {std::to_string(EIO), std::to_string(ENOSPC)}},
    {"size", {std::to_string(ENOSPC), std::to_string(EIO)}},
    {"open", {std::to_string(ENOSPC), std::to_string(EMFILE), std::to_string(EACCES)}},
    {"name", {std::to_string(EIO), std::to_string(ENOSPC)}},
    {"read", {std::to_string(EIO)}},
    {"map", {std::to_string(ENOMEM), std::to_string(EAGAIN)}},
};

struct Tally {
  int num_trials = 0, num_harmless = 0;
  std::map<std::string, int> messages;

  void add(const Ending& ending) {
    ++num_trials;
    num_harmless += ending.exit_code == 0;
    if (ending.exit_code != 1) return;
    std::string kind = ending.err;  // without what differs from time to time
    std::ranges::replace_if(
        kind, [](char c) { return c >= '0' && c <= '9'; }, '#');
    ++messages[kind];
  }
};

// The error says where: a file of the run, or their directory. REQUIRES: exit code 1
bool names_a_file(const Ending& ending, const Trial& trial) {
  return ending.err.find(trial.output().parent_path().string()) != std::string::npos;
}

// ... and what to do: all of these can be made good.
bool says_what_to_do(const Ending& ending) {
  return ending.err.find("again") != std::string::npos ||
         ending.err.find("check") != std::string::npos;
}

bool is_one_error(const std::string& text) {
  return text.starts_with("locvol: error: ") && text.ends_with("\n") && text.size() > 30;
}

// One fault, and what must hold then. False: the run had no such call any more.
bool try_fault(Trial& trial, const std::string& fault, bool must_name_file, Tally& tally) {
  trial.start_anew();
  const Ending ending = trial.run(Disturbance::fault(fault));
  const std::string what = fault + " (" + ending.fired + ")";
  const auto claim = [&](bool holds, const char* broken) {
    require(holds, trial.model().name() + ", fault " + what + ": " + broken + "\n" + ending.text());
  };
  claim(!ending.is_hung, "hung");
  claim(ending.signal == 0, "crashed");
  claim(ending.exit_code == 0 || ending.exit_code == 1, "another exit code than 0 and 1");
  if (ending.exit_code == 0) {
    trial.require_undisturbed_bytes("fault " + what);
  } else {
    claim(is_one_error(ending.err), "no error message");
    claim(!must_name_file || names_a_file(ending, trial), "the message names no file");
    claim(says_what_to_do(ending), "the message does not say what to do");
    const std::uint64_t committed = trial.store_state().num_visits;
    const auto performed = static_cast<std::uint64_t>(std::ranges::count(ending.steps, 'r'));
    claim(committed + kMaxVisitsInHand >= performed, "more is lost than the visits in hand");
    const Ending again = trial.require_same_bytes("fault " + what);
    const auto repeated = static_cast<std::uint64_t>(std::ranges::count(again.steps, 'r'));
    claim(trial.store_state().phase || committed + repeated == trial.num_steps('r'),
          "what was committed was done again");
  }
  if (!ending.fired.empty()) tally.add(ending);
  return !ending.fired.empty();
}

void print(const char* group, const Tally& tally) {
  fmt::print("  {}: {} faults, {} harmless\n", group, tally.num_trials, tally.num_harmless);
  for (const auto& [message, count] : tally.messages) fmt::print("    {:>4} x {}", count, message);
}

}  // namespace

void sweep_faults(const SweepOptions& options) {
  Trial trial(kModel, options.directory / "faults");
  fmt::print("faults of system calls: {}, {:.2f} s, {} visits\n", kModel.name(),
             trial.undisturbed().seconds, trial.num_steps('r'));
  for (const Kind& kind : kKinds) {
    Tally tally;
    const std::size_t num_actions = options.is_brief ? 1 : kind.actions.size();
    for (std::size_t i = 0; i < num_actions; ++i) {
      const std::string& action = kind.actions[i];
      int step = 1;
      for (int n = 1; try_fault(trial, fmt::format("{}:{}:{}", kind.group, n, action), true, tally);
           n += step)
        if (options.is_brief) step = kind.group == "read" ? 31 : 2 * step;
    }
    // A disk that stays full, a device that stays broken.
    const int last = options.is_brief ? 1 : 12;
    for (int n = 1; n <= last; ++n)
      try_fault(trial, fmt::format("{}:{}:{}:always", kind.group, n * n, kind.actions[0]), true,
                tally);
    print(kind.group.c_str(), tally);
  }
}

void sweep_allocations(const SweepOptions& options) {
  Trial trial(kModel, options.directory / "allocations");
  fmt::print("faults of allocations: {}\n", kModel.name());
  for (const bool is_always : {false, true}) {
    Tally tally;
    const long num_dense = options.is_brief ? 0 : is_always ? 200 : 2000;
    const double growth = options.is_brief ? 3.1 : 1.03;
    const auto fault = [&](long n) {
      return fmt::format("alloc:{}:{}{}", n, ENOMEM, is_always ? ":always" : "");
    };
    long n = 1;
    while (try_fault(trial, fault(n), false, tally))
      n = n < num_dense ? n + 1
                        : std::max(n + 1, static_cast<long>(static_cast<double>(n) * growth));
    fmt::print("up to {}\n", n);
    print(is_always ? "all from one on" : "one", tally);
  }
}

}  // namespace locvol::sweeps
