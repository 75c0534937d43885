// crash_sweep kill|write|fault|memory|stop|visit|all|overhead [--brief] [--seed N] [--kills N]
//             [--directory DIR]
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <random>

#include "tests/sweeps/sweeps.h"
#include "tests/temp_dir.h"

int main(int argc, char** argv) {
  using namespace locvol::sweeps;
  CLI::App app("Tries to break runs of locvol: kills, full disks, failing devices, no memory");
  SweepOptions options;
  options.seed = std::random_device()();
  std::string what;
  app.add_option("SWEEP", what,
                 "kill, write, fault, memory, stop, visit, all of these, or overhead")
      ->required()
      ->check(
          CLI::IsMember({"kill", "write", "fault", "memory", "stop", "visit", "all", "overhead"}));
  app.add_flag("--brief", options.is_brief, "A few dozen trials");
  app.add_option("--seed", options.seed, "Of the random instants (default: another one each time)");
  app.add_option("--kills", options.num_kills, "Or stops, at random instants (default: 240)");
  app.add_option("--directory", options.directory, "Where the runs take place, and stay");
  CLI11_PARSE(app, argc, argv);
  const locvol::TempDir temporary;
  if (options.directory.empty()) options.directory = temporary.path();
  options.memory_directory = "/dev/shm/" + temporary.path().filename().string();
  std::setvbuf(stdout, nullptr, _IOLBF, 0);
  try {
    if (what == "kill" || what == "all") sweep_kills(options);
    if (what == "write" || what == "all") sweep_writers(options);
    if (what == "fault" || what == "all") sweep_faults(options);
    if (what == "memory" || what == "all") sweep_allocations(options);
    if (what == "stop" || what == "all") sweep_stops(options);
    if (what == "visit" || what == "all") sweep_failures(options);
    if (what == "overhead") {
      measure_overhead(options);
      std::filesystem::remove_all(options.memory_directory);
    } else {
      fmt::print("nothing broke\n");
    }
    return 0;
  } catch (const std::exception& failure) {
    fmt::print(stderr, "crash_sweep: {}\n", failure.what());
    return 1;
  }
}
