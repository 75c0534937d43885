#include "tools/stop_signal.h"

#include <signal.h>
#include <time.h>
#include <unistd.h>

#include <atomic>
#include <initializer_list>
#include <string_view>

#include "engine/shared/unfinished_name.h"
#include "tools/exit_code.h"

namespace locvol {
namespace {

std::atomic<bool> is_stop_requested = false;
static_assert(std::atomic<bool>::is_always_lock_free);  // so a signal handler may use it

timer_t patience;
bool has_patience = false;

// ---- In a signal handler, where little is allowed

void start_patience() {
  if (!has_patience) return;
  constexpr auto kMilliseconds = StopSignal::kPatience.count();
  itimerspec once{};
  once.it_value = {kMilliseconds / 1000, kMilliseconds % 1000 * 1'000'000};
  timer_settime(patience, 0, &once, nullptr);
}

[[noreturn]] void end_interrupted() {
  UnfinishedName::remove_all();
  _exit(kExitInterrupted);
}

void on_stop(int) {
  if (is_stop_requested.exchange(true)) end_interrupted();
  start_patience();
}

void on_patience_over(int) {
  constexpr std::string_view kText =
      "\nlocvol: interrupted, in the middle of a step: what was committed is kept, and the same "
      "command goes on\n";
  [[maybe_unused]] const auto written = write(STDERR_FILENO, kText.data(), kText.size());
  end_interrupted();
}

void on_end(int signal) {
  UnfinishedName::remove_all();
  raise(signal);  // once more, after the handler: by then it means what it does by default
}

// ----

void handle(int signal, void (*handler)(int), int flags) {
  struct sigaction action {};
  action.sa_handler = handler;
  action.sa_flags = flags;
  sigaction(signal, &action, nullptr);
}

bool is_ignored(int signal) {
  struct sigaction action {};
  return sigaction(signal, nullptr, &action) == 0 && action.sa_handler == SIG_IGN;
}

}  // namespace

const StopSignal& StopSignal::install() {
  static const StopSignal stop;
  sigevent event{};
  event.sigev_notify = SIGEV_SIGNAL;
  event.sigev_signo = SIGALRM;
  has_patience = timer_create(CLOCK_MONOTONIC, &event, &patience) == 0;
  for (const int signal : {SIGINT, SIGTERM, SIGUSR1, SIGXCPU}) {
    // A shell without job control starts what it does not wait for with SIGINT ignored: Ctrl-C is
    // then meant for others.
    if (signal != SIGINT || !is_ignored(signal)) handle(signal, on_stop, SA_RESTART);
  }
  // That nobody reads any more what a run tells is no reason to end it.
  handle(SIGPIPE, SIG_IGN, 0);
  handle(SIGALRM, on_patience_over, SA_RESTART);
  return stop;
}

bool StopSignal::is_requested() { return is_stop_requested; }

void clean_up_on_signals() {
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    struct sigaction before {};
    sigaction(signal, nullptr, &before);
    if (before.sa_handler == SIG_DFL) handle(signal, on_end, SA_RESETHAND);
  }
}

}  // namespace locvol
