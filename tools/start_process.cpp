#include "tools/start_process.h"

#include <pthread.h>
#include <signal.h>
#include <sys/resource.h>

#include <algorithm>
#include <cstdlib>
#include <system_error>

#include "engine/locvol.h"
#include "engine/shared/standard_streams.h"
#include "tools/exit_code.h"

namespace locvol {
namespace {

constexpr rlim_t kStackBytes = rlim_t{8} << 20;
constexpr rlim_t kOpenFiles = 1024;

void lift_limit(__rlimit_resource resource, rlim_t wanted) {
  rlimit limit{};
  if (getrlimit(resource, &limit) != 0 || limit.rlim_cur >= wanted) return;
  limit.rlim_cur = std::min(wanted, limit.rlim_max);
  setrlimit(resource, &limit);
}

void set_stack_of_threads() {
  pthread_attr_t attributes;
  if (pthread_attr_init(&attributes) != 0) return;
  if (pthread_attr_setstacksize(&attributes, kStackBytes) == 0)
    pthread_setattr_default_np(&attributes);
  pthread_attr_destroy(&attributes);
}

}  // namespace

void start_process() {
  lift_limit(RLIMIT_NOFILE, kOpenFiles);
  lift_limit(RLIMIT_STACK, kStackBytes);
  try {
    open_standard_streams();
  } catch (const std::system_error&) {
    std::_Exit(kExitError);  // without a stream to tell it
  }
  sigset_t none;
  sigemptyset(&none);
  sigprocmask(SIG_SETMASK, &none, nullptr);
  signal(SIGXFSZ, SIG_IGN);
  set_stack_of_threads();
  share_one_heap();
}

}  // namespace locvol
