#include <fmt/format.h>
#include <signal.h>

#include <algorithm>
#include <map>
#include <random>
#include <vector>

#include "tests/sweeps/sweeps.h"
#include "tests/sweeps/trial.h"

namespace locvol::sweeps {
namespace {

constexpr double kMostSeconds = 2;  // from the signal to the end

// Many commits; mostly the ingest; one visit that is nearly all of the run; a large file.
const std::vector<Model> kModels = {{"three-holes", "2k", "10%", "150"},
                                    {"gyroid-ball", "60k", "60%", "20000"},
                                    {"octahandles", "2k", "3.5%", "1000000", {"--init", "paper"}},
                                    {"sphere", "2k", "2%", "20000"}};
const std::vector<Model> kLargeModels = {
    {"gyroid-ball", "8M", "40%", "20000"},
    {"octahandles", "20k", "2.5%", "10000000", {"--init", "paper"}},
    {"sphere", "50k", "0.4%", "20000"}};

// Of one model.
struct Latencies {
  std::vector<double> seconds;
  std::map<std::string, int> by_phase;
  int num_abrupt = 0;  // ended in the middle of a step, which took too long
  int num_runs = 0;

  void add(const Ending& ending, const StoreState& left, bool has_output) {
    constexpr const char* kNames[] = {"ingest", "measure", "size", "scatter",           "cover",
                                      "fill",   "refine",  "mend", "measure and write", "crease"};
    seconds.push_back(*ending.stop_seconds);
    num_abrupt += ending.err.find("in the middle of a step") != std::string::npos;
    ++by_phase[ending.exit_code == 0 || has_output ? "end"
               : left.phase                        ? kNames[static_cast<std::size_t>(*left.phase)]
                                                   : "reading"];
  }
  double longest() const { return std::ranges::max(seconds); }
  double median() {
    const auto middle = seconds.begin() + static_cast<std::ptrdiff_t>(seconds.size() / 2);
    std::ranges::nth_element(seconds, middle);
    return *middle;
  }
};

void require_nothing_partial(const std::filesystem::path& directory, const std::string& what) {
  for (const auto& entry : std::filesystem::directory_iterator(directory))
    require(entry.path().string().find(".partial") == std::string::npos,
            what + ": " + entry.path().string() + " is left behind");
}

// False: the run came to its end before the signal, or with it.
bool stop_once(Trial& trial, double instant, Latencies& latencies) {
  const std::string what = fmt::format("{}, SIGTERM at {:.4f} s", trial.model().name(), instant);
  const Ending ending = trial.run(Disturbance::stop_after(instant));
  require(!ending.is_hung && (ending.exit_code == 0 || ending.exit_code == 4),
          what + ": " + ending.text());
  const bool has_output = std::filesystem::exists(trial.output());
  require(has_output == (ending.exit_code == 0), what + ": its file, and " + ending.text());
  require_nothing_partial(trial.output().parent_path(), what);
  if (ending.stop_seconds) {
    require(*ending.stop_seconds < kMostSeconds,
            fmt::format("{}: it went on for {:.2f} s", what, *ending.stop_seconds));
    latencies.add(ending, trial.store_state(), has_output);
  }
  if (ending.exit_code == 4)
    require(ending.err.find("interrupted") != std::string::npos, what + ": it says nothing");
  return ending.exit_code == 4;
}

// Several lives of a run, at instants over the whole of an undisturbed one; then its end.
void sweep_run(Trial& trial, int num_stops, std::mt19937_64& random, Latencies& latencies) {
  const double seconds = trial.undisturbed().seconds;
  while (static_cast<int>(latencies.seconds.size()) < num_stops) {
    ++latencies.num_runs;
    trial.start_anew();
    bool is_over = false;
    for (auto num_lives = 1 + random() % 6; num_lives > 0 && !is_over; --num_lives)
      is_over =
          !stop_once(trial, std::uniform_real_distribution<double>(0, seconds)(random), latencies);
    if (is_over)
      trial.require_undisturbed_bytes("SIGTERM");
    else
      trial.require_same_bytes("SIGTERM");
  }
}

void print(const std::string& name, Latencies& latencies) {
  fmt::print("  {}: {} stops in {} runs, gone after {:.3f} s at most, {:.3f} s in the median;",
             name, latencies.seconds.size(), latencies.num_runs, latencies.longest(),
             latencies.median());
  for (const auto& [phase, count] : latencies.by_phase) fmt::print(" {}: {}", phase, count);
  if (latencies.num_abrupt > 0) fmt::print("; {} in the middle of a step", latencies.num_abrupt);
  fmt::print("\n");
}

// A command that cannot go on ends by the signal, and leaves no file.
void sweep_command(const std::filesystem::path& directory, const std::vector<std::string>& words,
                   int num_stops, std::mt19937_64& random) {
  const std::filesystem::path output = words.back();
  const double seconds = run_locvol(directory, words).seconds;
  double longest = 0;
  for (int i = 0; i < num_stops; ++i) {
    std::filesystem::remove(output);
    const double instant = std::uniform_real_distribution<double>(0, seconds)(random);
    const Ending ending = run_locvol(directory, words, Disturbance::stop_after(instant));
    const std::string what =
        fmt::format("{}, SIGTERM at {:.4f} s: {}", words.front(), instant, ending.text());
    require(ending.exit_code == 0 || ending.signal == SIGTERM, what);
    require(ending.exit_code != 0 || std::filesystem::exists(output), what);
    require_nothing_partial(directory, what);
    longest = std::max(longest, ending.stop_seconds.value_or(0));
  }
  require(longest < kMostSeconds, words.front() + " went on for too long");
  fmt::print("  {}: {} stops, gone after {:.3f} s at most\n", words.front(), num_stops, longest);
}

void sweep_commands(const SweepOptions& options, std::mt19937_64& random) {
  const std::filesystem::path directory = options.directory / "stopped-commands";
  std::filesystem::create_directories(directory);
  const auto name = [&](const char* file) { return (directory / file).string(); };
  const std::string size = options.is_brief ? "50k" : "2M";
  const int num_stops = options.is_brief ? 4 : 40;
  for (const char* surface : {"surface.stl", "surface.ply"})
    sweep_command(directory, {"generate", "sphere", "-n", size, "-o", name(surface)}, num_stops,
                  random);
  const Ending made =
      run_locvol(directory, {"generate", "sphere", "-n", "5k", "-o", name("surface.stl")});
  require(made.exit_code == 0, made.text());
  const Ending meshed =
      run_locvol(directory, {"mesh", name("surface.stl"), "--size", options.is_brief ? "5%" : "1%",
                             "--store", name("store"), "-o", name("mesh.stl")});
  require(meshed.exit_code == 0, meshed.text());
  for (const char* file : {"mesh.vtu", "mesh.ply", "mesh.mesh"})
    sweep_command(directory, {"export", name("store"), "-o", name(file)}, num_stops, random);
  sweep_command(directory, {"report", name("store"), "-o", name("page.html")}, num_stops, random);
}

}  // namespace

void sweep_stops(const SweepOptions& options) {
  std::mt19937_64 random(options.seed);
  fmt::print("SIGTERM, seed {}\n", options.seed);
  std::vector<Model> models = kModels;
  if (!options.is_brief) models.insert(models.end(), kLargeModels.begin(), kLargeModels.end());
  for (std::size_t m = 0; m < models.size(); ++m) {
    const std::filesystem::path directory = options.directory / fmt::format("stopped-{}", m);
    Trial trial(models[m], directory);
    Latencies latencies;
    const int num_stops =
        options.is_brief ? 6 : std::max(options.num_kills / static_cast<int>(models.size()), 1);
    sweep_run(trial, num_stops, random, latencies);
    print(fmt::format("{}, {:.2f} s", models[m].name(), trial.undisturbed().seconds), latencies);
    std::filesystem::remove_all(directory);
  }
  sweep_commands(options, random);
}

}  // namespace locvol::sweeps
