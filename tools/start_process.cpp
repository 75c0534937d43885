#include "tools/start_process.h"

#include <gmp.h>
#include <pthread.h>
#include <signal.h>
#include <sys/resource.h>

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <new>
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

// GMP ends the process where it finds no memory for an exact number.
void* allocate(std::size_t size) {
  void* memory = std::malloc(size);
  if (memory == nullptr) throw std::bad_alloc();
  return memory;
}
void* reallocate(void* old, std::size_t, std::size_t size) {
  void* memory = std::realloc(old, size);
  if (memory == nullptr) throw std::bad_alloc();
  return memory;
}
void release(void* memory, std::size_t) { std::free(memory); }

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
  mp_set_memory_functions(allocate, reallocate, release);
}

}  // namespace locvol
