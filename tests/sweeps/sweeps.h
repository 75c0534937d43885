// The sweeps: each tries to break a run in many ways, and throws Failure at the first that works.
#pragma once

#include <cstdint>
#include <filesystem>

namespace locvol::sweeps {

struct SweepOptions {
  std::uint64_t seed = 0;
  bool is_brief = false;  // a few dozen trials, for every build; else all of them
  int num_kills = 240;    // or stops, at random instants, if not brief
  std::filesystem::path directory;
  std::filesystem::path memory_directory;  // on a tmpfs
};

// kill -9 at random instants, at the steps of a run, and around its calls of the system.
void sweep_kills(const SweepOptions& options);
// kill -9 while each format's writer runs: at random instants, and at calls of the system.
void sweep_writers(const SweepOptions& options);
// Each call of the system that can fail fails once, with each error that it can have.
void sweep_faults(const SweepOptions& options);
// Each of the first allocations fails, then ever fewer; and all from there on.
void sweep_allocations(const SweepOptions& options);

// SIGTERM at random instants: of a run, which must end soon and go on; and of other commands.
void sweep_stops(const SweepOptions& options);
// Visits fail: the run ends right before the first one, which can be made again.
void sweep_failures(const SweepOptions& options);

// What the store costs: the same runs on disk, on disk without syncs, and in memory, as ratios.
void measure_overhead(const SweepOptions& options);

}  // namespace locvol::sweeps
