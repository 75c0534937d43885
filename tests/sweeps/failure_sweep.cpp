#include <fmt/format.h>

#include <algorithm>

#include "tests/sweeps/sweeps.h"
#include "tests/sweeps/trial.h"

namespace locvol::sweeps {
namespace {

// With visits again of leaves that had been clean, which depend on more than first ones.
const Model kModel = {"three-holes", "2k", "10%", "150"};

// Beside the store, of whichever leaf it is.
std::filesystem::path visit_file_of(const Trial& trial) {
  const std::string start = trial.store().filename().string() + ".";
  for (const auto& entry : std::filesystem::directory_iterator(trial.store().parent_path()))
    if (entry.path().filename().string().starts_with(start)) return entry.path();
  throw Failure("there is no file of the visit that failed");
}

// "leaf 1a00...: WHAT; this is a bug of locvol": WHAT, which says where.
std::string failure_in(const std::string& err) {
  const std::size_t leaf = err.find("leaf "), from = err.find(": ", leaf);
  const std::size_t end = err.find("; this is a bug", from);
  require(end != std::string::npos, "the message is another: " + err);
  return err.substr(from + 2, end - from - 2);
}

void try_failure(Trial& trial, std::uint64_t number) {
  const std::string what = fmt::format("failing visits from {} on", number);
  trial.start_anew();
  const Disturbance failing = Disturbance::fail_visits_from(number);
  const Ending ending = trial.run(failing);
  require(ending.exit_code == 1, what + ": " + ending.text());
  const std::filesystem::path file = visit_file_of(trial);
  const auto says = [&](const std::string& text) {
    require(ending.err.find(text) != std::string::npos,
            what + ": no `" + text + "` in " + ending.err);
  };
  says("locvol replay --from " + file.string());
  const std::string key = file.stem().extension().string().substr(1);
  says("leaf " + key);
  const std::string failure = failure_in(ending.err);

  const auto replay = [&](const std::vector<std::string>& words, const Disturbance& disturbance) {
    std::vector<std::string> all = {"replay", "--json"};
    all.insert(all.end(), words.begin(), words.end());
    return run_locvol(trial.store().parent_path(), all, disturbance);
  };
  const std::vector<std::string> from_file = {"--from", file.string()},
                                 from_store = {trial.store().string(), "--leaf", key};
  const Disturbance again = Disturbance::fail_visits_from(1);
  for (const auto& words : {from_file, from_store}) {
    const Ending same = replay(words, again);
    require(same.exit_code == 1 && same.out.find(failure) != std::string::npos,
            what + ": `" + failure + "` is not repeated: " + same.out.substr(0, 400) + same.text());
    require(replay(words, {}).exit_code == 0, what + ": without the fault, it fails as well");
  }
  std::filesystem::remove(file);
  trial.require_same_bytes(what);
}

}  // namespace

void sweep_failures(const SweepOptions& options) {
  Trial trial(kModel, options.directory / "failures");
  fmt::print("visits that fail: {}, {} visits\n", kModel.name(), trial.num_steps('r'));
  const std::uint64_t how_many = options.is_brief ? 4 : 24;
  // The last ones insert nothing, so that they cannot fail.
  const std::uint64_t last = trial.num_steps('r') * 2 / 3;
  for (const std::uint64_t number : some_of(last, how_many)) try_failure(trial, number);
}

}  // namespace locvol::sweeps
