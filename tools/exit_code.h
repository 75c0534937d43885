#pragma once

namespace locvol {

// Documented in --help and tools/mesh.md.
enum ExitCode : int {
  kExitDone = 0,
  kExitError = 1,
  kExitUsage = 2,
  kExitUnresolved = 3,
  kExitInterrupted = 4,
};

}  // namespace locvol
