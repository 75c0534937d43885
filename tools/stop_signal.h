// While a StopSignal lives, the first SIGINT or SIGTERM only asks the run to stop at its next
// commit; the second ends the process at once, which the store survives as it does a crash.
#pragma once

#include <csignal>

namespace locvol {

class StopSignal {
 public:
  StopSignal();
  ~StopSignal();
  StopSignal(const StopSignal&) = delete;
  StopSignal& operator=(const StopSignal&) = delete;

  static bool is_requested();

 private:
  struct sigaction old_interrupt_ {};
  struct sigaction old_terminate_ {};
};

}  // namespace locvol
