#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <vector>

#include "tests/sweeps/sweeps.h"
#include "tests/sweeps/trial.h"

namespace locvol::sweeps {
namespace {

double median(std::vector<double> values) {
  std::ranges::sort(values);
  return values[values.size() / 2];
}

double seconds_of(Trial& trial, const Disturbance& how) {
  trial.start_anew();
  const Ending ending = trial.run(how);
  require(ending.exit_code == 0, trial.model().name() + ": " + ending.text());
  return ending.seconds;
}

void measure(const Model& model, int num_rounds, const SweepOptions& options) {
  Trial disk(model, options.directory / "overhead");
  Trial memory(model, options.memory_directory / "overhead");
  const Disturbance unsynced = Disturbance::fault("sync:1:skip:always");
  std::vector<double> on_disk, without_sync, in_memory;
  for (int round = 0; round < num_rounds; ++round) {  // in turn, for the machine's load changes
    on_disk.push_back(seconds_of(disk, {}));
    without_sync.push_back(seconds_of(disk, unsynced));
    in_memory.push_back(seconds_of(memory, {}));
  }
  std::vector<double> durability, file_system;
  for (std::size_t i = 0; i < on_disk.size(); ++i) {
    durability.push_back(on_disk[i] / without_sync[i]);
    file_system.push_back(on_disk[i] / in_memory[i]);
  }
  fmt::print("{}: {:.2f} s on disk; over no syncs {:.3f}, over tmpfs {:.3f} (medians of {})\n",
             model.name(), median(on_disk), median(durability), median(file_system), num_rounds);
}

}  // namespace

void measure_overhead(const SweepOptions& options) {
  std::filesystem::create_directories(options.memory_directory);
  measure({"three-holes", "50k", "5%", "20k"}, options.is_brief ? 1 : 9, options);
  measure({"three-holes", "50k", "2%", "20k"}, options.is_brief ? 1 : 3, options);
}

}  // namespace locvol::sweeps
