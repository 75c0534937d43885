// SIGINT, SIGTERM, SIGUSR1, which batch systems and mpirun can send, and SIGXCPU, which says that
// the CPU time of a limit is nearly over.
//
// A run is asked to end, once StopSignal is installed, and does so within a fraction of a second.
// What cannot be asked (a commit to a slow disk, CGAL, the unexpected) is given kPatience: then the
// process ends, as it does at once at a second signal, with the same exit code. The store survives
// that as it does a crash. Any other command ends by the signal. Unfinished files are removed.
#pragma once

#include <chrono>

#include "octree/stop.h"

namespace locvol {

class StopSignal : public StopToken {
 public:
  static constexpr std::chrono::milliseconds kPatience{1500};

  // Installs the handlers, from now to the end of the process.
  static const StopSignal& install();
  static bool is_requested();
  bool is_stopped() const override { return is_requested(); }

 private:
  StopSignal() = default;
};

// Has a signal that ends the process, until StopSignal::install(), remove its unfinished files.
void clean_up_on_signals();

}  // namespace locvol
