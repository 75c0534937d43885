#include <fmt/format.h>
#include <signal.h>

#include <algorithm>
#include <map>
#include <random>
#include <string>
#include <vector>

#include "engine/formats/mesh_format.h"
#include "tests/sweeps/sweeps.h"
#include "tests/sweeps/trial.h"

namespace locvol::sweeps {
namespace {

using Files = std::map<std::string, std::string>;  // contents by name

// `locvol export` of one finished run in one format, again and again, into a directory of its own.
class Export {
 public:
  Export(const std::filesystem::path& store, const std::filesystem::path& directory,
         const FormatInfo& format)
      : store_(store), directory_(directory / "out"), format_(format) {
    start_anew();
    // A fault that never comes, so that the calls are counted.
    undisturbed_ = run(Disturbance::fault("write:1000000000:5"));
    require(undisturbed_.exit_code == 0, name() + " undisturbed: " + undisturbed_.text());
    whole_ = files();
    require(whole_.size() == files_of({format.format}, output()).size(), name() + ": other files");
  }

  std::string name() const { return std::string(format_.name); }
  const Ending& undisturbed() const { return undisturbed_; }
  long long num_calls(const std::string& group) {
    start_anew();
    return run(Disturbance::fault(group + ":1000000000:5")).num_calls;
  }

  void start_anew() {
    std::filesystem::remove_all(directory_);
    std::filesystem::create_directories(directory_);
  }
  Ending run(const Disturbance& disturbance = {}) {
    std::vector<std::string> words = {
        "export",   store_.string(), "-o",        output().string(),
        "--format", name(),          "--threads", std::to_string(kNumThreads),
        "--quiet"};
    if (format_.has_cell_data) words.insert(words.end(), {"--cell-data", "quality"});
    return run_locvol(directory_, words, disturbance);
  }

  // Under its name, a file is whole; beside it lies at most the beginning of another one. Returns
  // whether one does.
  bool require_whole_or_absent(const std::string& after) const {
    bool is_begun = false;
    for (const auto& [file, content] : files()) {
      const bool is_partial = file.ends_with(".partial");
      is_begun = is_begun || is_partial;
      const auto whole = whole_.find(is_partial ? file.substr(0, file.rfind('.')) : file);
      require(whole != whole_.end(), name() + " after " + after + ": " + file + " is left behind");
      require(is_partial || whole->second == content,
              name() + " after " + after + ": " + file + " is not whole");
    }
    return is_begun;
  }
  void require_whole(const std::string& after) {
    const Ending ending = run();
    require(ending.exit_code == 0,
            name() + " after " + after + ": the same command ends with " + ending.text());
    require(files() == whole_, name() + " after " + after + ": other files");
  }

 private:
  std::filesystem::path output() const { return directory_ / "mesh"; }
  Files files() const {
    Files all;
    for (const auto& entry : std::filesystem::directory_iterator(directory_))
      all[entry.path().filename().string()] = content_of(entry.path());
    return all;
  }

  std::filesystem::path store_, directory_;
  FormatInfo format_;
  Ending undisturbed_;
  Files whole_;
};

struct Tally {
  int num_kills = 0, num_begun = 0;  // with a file half written
};

// At most three kills, one after another, over what the last one left; then the end.
void kill_at_instants(Export& trial, int num_kills, std::mt19937_64& random, Tally& tally) {
  const double seconds = trial.undisturbed().seconds;
  const int last = tally.num_kills + num_kills;
  while (tally.num_kills < last) {
    trial.start_anew();
    std::string history;
    for (auto lives = 1 + random() % 3; lives > 0 && tally.num_kills < last; --lives) {
      Disturbance kill;
      kill.kill_after_seconds = std::uniform_real_distribution<double>(0, seconds)(random);
      history += fmt::format("kill -9 at {:.4f} s, ", *kill.kill_after_seconds);
      const Ending ending = trial.run(kill);
      require(ending.signal == SIGKILL || ending.exit_code == 0,
              trial.name() + " after " + history + ending.text());
      tally.num_begun += trial.require_whole_or_absent(history);
      if (ending.signal != SIGKILL) break;
      ++tally.num_kills;
    }
    trial.require_whole(history);
  }
}

// In the middle of a write, and around what makes the file whole and gives it its name.
void kill_at_calls(Export& trial, std::uint64_t most, Tally& tally) {
  const std::vector<std::pair<std::string, std::string>> kinds = {
      {"write", "torn"}, {"sync", "kill"}, {"name", "kill"}, {"name", "killed"}};
  for (const auto& [group, action] : kinds) {
    const auto count = static_cast<std::uint64_t>(trial.num_calls(group));
    require(count > 0, trial.name() + ": no call of the group " + group);
    for (const std::uint64_t number : some_of(count, most)) {
      const std::string place = fmt::format("{}:{}:{}", group, number, action);
      trial.start_anew();
      const Ending ending = trial.run(Disturbance::fault(place));
      // With two threads, the order of calls differs from time to time, and so may their number.
      require(ending.signal == SIGKILL || ending.exit_code == 0,
              trial.name() + ", kill -9 at call " + place + ": " + ending.text());
      tally.num_begun += trial.require_whole_or_absent(place);
      tally.num_kills += ending.signal == SIGKILL;
      trial.require_whole("kill -9 at call " + place);
    }
  }
}

}  // namespace

void sweep_writers(const SweepOptions& options) {
  std::mt19937_64 random(options.seed);
  fmt::print("kill -9 of each writer, seed {}\n", options.seed);
  // 170,000 cells, two thirds of them in the core; or a few, where time is short.
  const Model model{"sphere", "2k", options.is_brief ? "5%" : "2%", "2000"};
  const std::filesystem::path directory = options.directory / "writers";
  std::filesystem::create_directories(directory);
  const std::string surface = (directory / "surface.stl").string(),
                    store = (directory / "store").string();
  for (const std::vector<std::string>& words : std::vector<std::vector<std::string>>{
           {"generate", model.shape, "-n", model.num_triangles, "-o", surface},
           {"mesh", surface, "-o", (directory / "mesh.stl").string(), "--size", model.size,
            "--leaf-capacity", model.leaf_capacity, "--store", store, "--quiet"}}) {
    const Ending made = run_locvol(directory, words);
    require(made.exit_code == 0, words.front() + ": " + made.text());
  }
  for (const FormatInfo& format : mesh_formats()) {
    Export trial(store, directory, format);
    Tally tally;
    kill_at_instants(trial, options.is_brief ? 1 : options.num_kills / 6, random, tally);
    kill_at_calls(trial, options.is_brief ? 2 : 6, tally);
    require(tally.num_begun > 0, trial.name() + ": no kill came while the file was written");
    fmt::print("  {:<9} {} kills, {} of them with a file half written\n", trial.name(),
               tally.num_kills, tally.num_begun);
  }
}

}  // namespace locvol::sweeps
