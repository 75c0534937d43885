// A library to preload: makes one call of the C library fail, or kills the process at it.
//
//   LOCVOL_FAULT=GROUPS:N:ACTION[:always]   at the N-th call of the groups (from 1; "always": at
//                                           all from there on too)
//   LOCVOL_FAULT_DIR=DIR                    only calls on files below DIR count
//   LOCVOL_FAULT_LOG=FILE                   "fired CALL FILE" is appended when it happens, and
//                                           "calls N" at the end of the process
//
// GROUPS, joined by "+": write sync size open name read map alloc. ACTION: a number is an errno to
// fail with; "short" writes half; "kill" before the call, "killed" after it, "torn" after half.
// Allocations count from the start of main() on: what fails before is nobody's to handle.
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

#include <atomic>
#include <new>

namespace {

enum Group : unsigned {
  kWrite = 1,
  kSync = 2,
  kSize = 4,
  kOpen = 8,
  kName = 16,
  kRead = 32,
  kMap = 64,
  kAlloc = 128
};
constexpr struct {
  const char* name;
  Group group;
} kGroups[] = {{"write", kWrite}, {"sync", kSync}, {"size", kSize}, {"open", kOpen},
               {"name", kName},   {"read", kRead}, {"map", kMap},   {"alloc", kAlloc}};

enum class Action { kNone, kFail, kShort, kKill, kKilled, kTorn };

struct Plan {
  unsigned groups = 0;
  long long at = 0;
  Action action = Action::kNone;
  int error = 0;
  bool is_always = false;
  const char* directory = nullptr;
  const char* log = nullptr;
};
Plan plan;
std::atomic<long long> num_calls{0};
std::atomic<bool> is_in_main{false};
thread_local bool is_inside = false;  // one interposed call may use another

void read_plan() {
  const char* text = getenv("LOCVOL_FAULT");
  if (text == nullptr) return;
  plan.directory = getenv("LOCVOL_FAULT_DIR");
  plan.log = getenv("LOCVOL_FAULT_LOG");
  const char* const end = strchr(text, ':');
  if (end == nullptr) return;
  for (const auto& [name, group] : kGroups)
    for (const char* at = strstr(text, name); at != nullptr && at < end; at = strstr(at + 1, name))
      plan.groups |= group;
  char* rest = nullptr;
  plan.at = strtoll(end + 1, &rest, 10);
  const char* const action = rest + 1;
  plan.is_always = strstr(action, ":always") != nullptr;
  plan.error = atoi(action);
  plan.action = plan.error != 0                     ? Action::kFail
                : strncmp(action, "short", 5) == 0  ? Action::kShort
                : strncmp(action, "killed", 6) == 0 ? Action::kKilled
                : strncmp(action, "kill", 4) == 0   ? Action::kKill
                : strncmp(action, "torn", 4) == 0   ? Action::kTorn
                                                    : Action::kNone;
}

// By system calls alone: nothing here may allocate or be counted.
void log(const char* call, const char* file, long long number) {
  if (plan.log == nullptr) return;
  char text[4600];
  const int size = number < 0 ? snprintf(text, sizeof text, "fired %s %s\n", call, file)
                              : snprintf(text, sizeof text, "calls %lld\n", number);
  const long to = syscall(SYS_openat, AT_FDCWD, plan.log, O_WRONLY | O_CREAT | O_APPEND, 0600);
  if (to < 0) return;
  syscall(SYS_write, to, text, size);
  syscall(SYS_close, to);
}

[[noreturn]] void die() {
  syscall(SYS_kill, syscall(SYS_getpid), SIGKILL);
  for (;;) pause();
}

bool is_below_directory(const char* path) {
  return plan.directory == nullptr || strncmp(path, plan.directory, strlen(plan.directory)) == 0;
}

// What to do at this call; kNone: let it through.
Action turn(Group group, const char* call, const char* path) {
  if (is_inside || plan.action == Action::kNone || (plan.groups & group) == 0 ||
      !is_below_directory(path))
    return Action::kNone;
  const long long number = ++num_calls;
  if (number < plan.at || (number > plan.at && !plan.is_always)) return Action::kNone;
  if (number == plan.at) log(call, path, -1);
  if (plan.action == Action::kKill) die();
  if (plan.action == Action::kFail) errno = plan.error;
  return plan.action;
}

Action turn(Group group, const char* call, int file) {
  if (is_inside || plan.action == Action::kNone || (plan.groups & group) == 0) return Action::kNone;
  char name[64], path[4400];
  snprintf(name, sizeof name, "/proc/self/fd/%d", file);
  const long size = syscall(SYS_readlinkat, AT_FDCWD, name, path, sizeof path - 1);
  if (size < 0) return Action::kNone;
  path[size] = '\0';
  return turn(group, call, path);
}

template <class Function>
Function* next(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

// Lets the call through, and counts nothing that it calls in turn.
template <class Call>
auto through(Action action, const Call& call) {
  is_inside = true;
  const auto result = call();
  is_inside = false;
  if (action == Action::kKilled || action == Action::kTorn) die();
  return result;
}

__attribute__((constructor)) void begin() { read_plan(); }
__attribute__((destructor)) void end() {
  if (plan.action != Action::kNone) log("", "", num_calls);
}

}  // namespace

#define NEXT(name) static auto* const real = next<decltype(::name)>(#name)

extern "C" {

// -- Writing

#define DEFINE_PWRITE(name, Offset)                                                                \
  ssize_t name(int file, const void* bytes, size_t size, Offset offset) {                          \
    NEXT(name);                                                                                    \
    const Action action = turn(kWrite, #name, file);                                               \
    if (action == Action::kFail) return -1;                                                        \
    const bool is_half = action == Action::kShort || action == Action::kTorn;                      \
    return through(                                                                                \
        action, [&] { return real(file, bytes, is_half && size > 1 ? size / 2 : size, offset); }); \
  }
DEFINE_PWRITE(pwrite, off_t)
DEFINE_PWRITE(pwrite64, off64_t)

ssize_t write(int file, const void* bytes, size_t size) {
  NEXT(write);
  const Action action = turn(kWrite, "write", file);
  if (action == Action::kFail) return -1;
  const bool is_half = action == Action::kShort || action == Action::kTorn;
  return through(action, [&] { return real(file, bytes, is_half && size > 1 ? size / 2 : size); });
}

// Half of the first piece, when it is to be cut short.
#define DEFINE_PWRITEV(name, Offset)                                                      \
  ssize_t name(int file, const iovec* pieces, int count, Offset offset) {                 \
    NEXT(name);                                                                           \
    const Action action = turn(kWrite, #name, file);                                      \
    if (action == Action::kFail) return -1;                                               \
    iovec first = pieces[0];                                                              \
    first.iov_len = first.iov_len / 2 + 1;                                                \
    const bool is_half = action == Action::kShort || action == Action::kTorn;             \
    return through(action, [&] {                                                          \
      return is_half ? real(file, &first, 1, offset) : real(file, pieces, count, offset); \
    });                                                                                   \
  }
DEFINE_PWRITEV(pwritev, off_t)
DEFINE_PWRITEV(pwritev64, off64_t)

ssize_t writev(int file, const iovec* pieces, int count) {
  NEXT(writev);
  const Action action = turn(kWrite, "writev", file);
  if (action == Action::kFail) return -1;
  iovec first = pieces[0];
  first.iov_len = first.iov_len / 2 + 1;
  const bool is_half = action == Action::kShort || action == Action::kTorn;
  return through(action,
                 [&] { return is_half ? real(file, &first, 1) : real(file, pieces, count); });
}

// -- Syncing, sizes, reading

#define DEFINE_BY_FILE(group, Result, name, parameters, arguments) \
  Result name parameters {                                         \
    NEXT(name);                                                    \
    const Action action = turn(group, #name, file);                \
    if (action == Action::kFail) return -1;                        \
    return through(action, [&] { return real arguments; });        \
  }
DEFINE_BY_FILE(kSync, int, fsync, (int file), (file))
DEFINE_BY_FILE(kSync, int, fdatasync, (int file), (file))
DEFINE_BY_FILE(kSize, int, ftruncate, (int file, off_t size) noexcept, (file, size))
DEFINE_BY_FILE(kSize, int, ftruncate64, (int file, off64_t size) noexcept, (file, size))
DEFINE_BY_FILE(kSize, int, fallocate, (int file, int mode, off_t at, off_t size),
               (file, mode, at, size))
DEFINE_BY_FILE(kSize, int, fallocate64, (int file, int mode, off64_t at, off64_t size),
               (file, mode, at, size))
DEFINE_BY_FILE(kRead, ssize_t, pread, (int file, void* bytes, size_t size, off_t at),
               (file, bytes, size, at))
DEFINE_BY_FILE(kRead, ssize_t, pread64, (int file, void* bytes, size_t size, off64_t at),
               (file, bytes, size, at))
DEFINE_BY_FILE(kRead, ssize_t, read, (int file, void* bytes, size_t size), (file, bytes, size))

size_t fread(void* bytes, size_t size, size_t count, FILE* stream) {
  NEXT(fread);
  const Action action = turn(kRead, "fread", fileno(stream));
  if (action == Action::kFail) {
    stream->_flags |= _IO_ERR_SEEN;
    return 0;
  }
  return through(action, [&] { return real(bytes, size, count, stream); });
}

int msync(void* address, size_t size, int flags) {
  NEXT(msync);
  const Action action = turn(kSync, "msync", plan.directory ? plan.directory : "");
  if (action == Action::kFail) return -1;
  return through(action, [&] { return real(address, size, flags); });
}

// -- Opening and naming

#define DEFINE_OPEN(name)                                                             \
  int name(const char* path, int flags, ...) {                                        \
    NEXT(name);                                                                       \
    va_list arguments;                                                                \
    va_start(arguments, flags);                                                       \
    const bool has_mode = (flags & O_CREAT) != 0 || (flags & O_TMPFILE) == O_TMPFILE; \
    const mode_t mode = has_mode ? va_arg(arguments, mode_t) : 0;                     \
    va_end(arguments);                                                                \
    const Action action = turn(kOpen, #name, path);                                   \
    if (action == Action::kFail) return -1;                                           \
    return through(action, [&] { return real(path, flags, mode); });                  \
  }
DEFINE_OPEN(open)
DEFINE_OPEN(open64)

FILE* fopen(const char* path, const char* mode) {
  NEXT(fopen);
  const Action action = turn(kOpen, "fopen", path);
  if (action == Action::kFail) return nullptr;
  return through(action, [&] { return real(path, mode); });
}
FILE* fopen64(const char* path, const char* mode) {
  NEXT(fopen64);
  const Action action = turn(kOpen, "fopen64", path);
  if (action == Action::kFail) return nullptr;
  return through(action, [&] { return real(path, mode); });
}

#define DEFINE_BY_PATH(group, name, parameters, arguments)  \
  int name parameters {                                     \
    NEXT(name);                                             \
    const Action action = turn(group, #name, path);         \
    if (action == Action::kFail) return -1;                 \
    return through(action, [&] { return real arguments; }); \
  }
DEFINE_BY_PATH(kOpen, mkostemp, (char* path, int flags), (path, flags))
DEFINE_BY_PATH(kOpen, mkostemp64, (char* path, int flags), (path, flags))
DEFINE_BY_PATH(kName, rename, (const char* path, const char* to) noexcept, (path, to))
DEFINE_BY_PATH(kName, unlink, (const char* path) noexcept, (path))
DEFINE_BY_PATH(kName, mkdir, (const char* path, mode_t mode) noexcept, (path, mode))

// -- Maps of files

void* mmap(void* address, size_t size, int protection, int flags, int file, off_t at) noexcept {
  NEXT(mmap);
  const Action action = file < 0 ? Action::kNone : turn(kMap, "mmap", file);
  if (action == Action::kFail) return MAP_FAILED;
  return through(action, [&] { return real(address, size, protection, flags, file, at); });
}
void* mmap64(void* address, size_t size, int protection, int flags, int file, off64_t at) noexcept {
  NEXT(mmap64);
  const Action action = file < 0 ? Action::kNone : turn(kMap, "mmap64", file);
  if (action == Action::kFail) return MAP_FAILED;
  return through(action, [&] { return real(address, size, protection, flags, file, at); });
}

// -- The heap

#ifdef LOCVOL_FAULTS_OF_THE_HEAP
void* __libc_malloc(size_t);
void* __libc_calloc(size_t, size_t);
void* __libc_realloc(void*, size_t);
void* __libc_memalign(size_t, size_t);

static bool is_refused(const char* call) {
  if (!is_in_main.load(std::memory_order_relaxed) || (plan.groups & kAlloc) == 0) return false;
  return turn(kAlloc, call, plan.directory ? plan.directory : "") == Action::kFail;
}

void* malloc(size_t size) noexcept { return is_refused("malloc") ? nullptr : __libc_malloc(size); }
void* calloc(size_t count, size_t size) noexcept {
  return is_refused("calloc") ? nullptr : __libc_calloc(count, size);
}
void* realloc(void* old, size_t size) noexcept {
  return is_refused("realloc") ? nullptr : __libc_realloc(old, size);
}
void* memalign(size_t alignment, size_t size) noexcept {
  return is_refused("memalign") ? nullptr : __libc_memalign(alignment, size);
}
void* aligned_alloc(size_t alignment, size_t size) noexcept {
  return is_refused("aligned_alloc") ? nullptr : __libc_memalign(alignment, size);
}
int posix_memalign(void** result, size_t alignment, size_t size) noexcept {
  if (is_refused("posix_memalign")) return ENOMEM;
  *result = __libc_memalign(alignment, size);
  return *result == nullptr ? ENOMEM : 0;
}
#endif

using Main = int(int, char**, char**);
static Main* the_main;

static int counted_main(int count, char** arguments, char** environment) {
  is_in_main = true;
  const int code = the_main(count, arguments, environment);
  is_in_main = false;
  return code;
}

int __libc_start_main(Main* main, int count, char** arguments, void (*init)(), void (*fini)(),
                      void (*rtld_fini)(), void* stack_end) {
  the_main = main;
  auto* const real = next<decltype(__libc_start_main)>("__libc_start_main");
  return real(counted_main, count, arguments, init, fini, rtld_fini, stack_end);
}

}  // extern "C"
