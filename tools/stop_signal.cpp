#include "tools/stop_signal.h"

#include <unistd.h>

#include <atomic>

#include "tools/commands.h"

namespace locvol {
namespace {

std::atomic<bool> is_stop_requested = false;
static_assert(std::atomic<bool>::is_always_lock_free);  // so a signal handler may use it

void on_signal(int) {
  if (is_stop_requested.exchange(true)) _exit(kExitInterrupted);
}

}  // namespace

StopSignal::StopSignal() {
  is_stop_requested = false;
  struct sigaction action {};
  action.sa_handler = on_signal;
  action.sa_flags = SA_RESTART;
  sigaction(SIGINT, &action, &old_interrupt_);
  sigaction(SIGTERM, &action, &old_terminate_);
}

StopSignal::~StopSignal() {
  sigaction(SIGINT, &old_interrupt_, nullptr);
  sigaction(SIGTERM, &old_terminate_, nullptr);
}

bool StopSignal::is_requested() { return is_stop_requested; }

}  // namespace locvol
