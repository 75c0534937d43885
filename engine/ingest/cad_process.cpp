#include "engine/ingest/cad_process.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdint>
#include <cstdlib>
#include <system_error>
#include <utility>

extern char** environ;

namespace locvol {
namespace {

[[noreturn]] void fail(int error, const std::string& what) {
  throw std::system_error(error, std::generic_category(), what);
}

struct Pipe {
  OpenFile read, write;
};

// A pair of sockets: who writes to one that nobody reads any more gets no signal.
Pipe new_pipe() {
  std::array<int, 2> ends{};
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0)
    fail(errno, "cannot make a pipe");
  return {OpenFile(ends[0], kCadProgram), OpenFile(ends[1], kCadProgram)};
}

// A descriptor above those that the program gets, so that none is overwritten before it is copied.
OpenFile lifted(int descriptor) {
  const int copy = ::fcntl(descriptor, F_DUPFD_CLOEXEC, kCadInput + 1);
  if (copy < 0) fail(errno, "cannot copy a descriptor");
  return {copy, kCadProgram};
}

// Its own group, so that Ctrl-C in a terminal reaches the one that started it alone; signals as
// they are by default.
class SpawnLaw {
 public:
  SpawnLaw() {
    posix_spawnattr_init(&attributes);
    posix_spawn_file_actions_init(&actions);
    sigset_t all, none;
    sigfillset(&all);
    sigemptyset(&none);
    posix_spawnattr_setsigdefault(&attributes, &all);
    posix_spawnattr_setsigmask(&attributes, &none);
    posix_spawnattr_setpgroup(&attributes, 0);
    posix_spawnattr_setflags(
        &attributes, POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETPGROUP);
  }
  SpawnLaw(const SpawnLaw&) = delete;
  SpawnLaw& operator=(const SpawnLaw&) = delete;
  ~SpawnLaw() {
    posix_spawn_file_actions_destroy(&actions);
    posix_spawnattr_destroy(&attributes);
  }

  posix_spawnattr_t attributes;
  posix_spawn_file_actions_t actions;
};

}  // namespace

std::optional<std::filesystem::path> CadProcess::program() {
  std::error_code unknown;
  if (const char* given = std::getenv("LOCVOL_CAD")) {
    if (std::filesystem::exists(given, unknown)) return given;
    return std::nullopt;
  }
  const std::filesystem::path own = std::filesystem::read_symlink("/proc/self/exe", unknown);
  const std::filesystem::path prefix = own.parent_path().parent_path();
  for (const std::filesystem::path& folder :
       {prefix / LOCVOL_LIBDIR, prefix / "lib", std::filesystem::path(LOCVOL_FULL_LIBDIR)}) {
    const std::filesystem::path place = folder / "locvol" / kCadProgram;
    if (std::filesystem::exists(place, unknown)) return place;
  }
  return std::nullopt;
}

CadProcess::CadProcess(const std::filesystem::path& program, const std::filesystem::path& file,
                       CadFormat format, const OpenFile* bytes) {
  Pipe to = new_pipe(), from = new_pipe();
  const OpenFile in = lifted(to.read.descriptor()), out = lifted(from.write.descriptor());
  std::optional<OpenFile> held;
  if (bytes != nullptr) held.emplace(lifted(bytes->descriptor()));
  SpawnLaw law;
  posix_spawn_file_actions_adddup2(&law.actions, in.descriptor(), STDIN_FILENO);
  posix_spawn_file_actions_addopen(&law.actions, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
  posix_spawn_file_actions_addopen(&law.actions, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
  posix_spawn_file_actions_adddup2(&law.actions, out.descriptor(), kCadOutput);
  if (held) posix_spawn_file_actions_adddup2(&law.actions, held->descriptor(), kCadInput);
  std::array<std::string, 4> texts = {program.string(),
                                      held ? "/proc/self/fd/" + std::to_string(kCadInput)
                                           : std::filesystem::absolute(file).string(),
                                      kCadFormatNames[static_cast<std::size_t>(format)],
                                      kCadVersion};
  std::array<char*, 5> arguments = {texts[0].data(), texts[1].data(), texts[2].data(),
                                    texts[3].data(), nullptr};
  const int error = posix_spawn(&process_, program.c_str(), &law.actions, &law.attributes,
                                arguments.data(), environ);
  if (error != 0) {
    process_ = -1;
    fail(error, "cannot start " + program.string());
  }
  to_.emplace(std::move(to.write));
  from_.emplace(std::move(from.read));
}

CadProcess::~CadProcess() {
  if (process_ < 0) return;
  ::kill(process_, SIGKILL);
  while (::waitpid(process_, nullptr, 0) < 0 && errno == EINTR) {
  }
}

bool CadProcess::read(void* bytes, std::size_t count, const StopToken* stop) {
  constexpr int kMilliseconds = 100;
  auto* place = static_cast<char*>(bytes);
  while (count > 0) {
    throw_if_stopped(stop);
    pollfd ready{from_->descriptor(), POLLIN, 0};
    const int num_ready = ::poll(&ready, 1, kMilliseconds);
    if (num_ready == 0 || (num_ready < 0 && errno == EINTR)) continue;
    if (num_ready < 0) fail(errno, "cannot wait for " + from_->name().string());
    const ssize_t got = ::read(from_->descriptor(), place, count);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) fail(errno, "cannot read from " + from_->name().string());
    if (got == 0) return false;
    place += got;
    count -= static_cast<std::size_t>(got);
  }
  return true;
}

std::optional<CadProcess::Record> CadProcess::next(const StopToken* stop) {
  std::uint8_t kind = 0;
  std::uint64_t length = 0;
  if (!read(&kind, sizeof kind, stop) || !read(&length, sizeof length, stop)) return std::nullopt;
  Record record{static_cast<CadRecord>(kind), std::string(length, '\0')};
  if (!read(record.bytes.data(), length, stop)) return std::nullopt;
  return record;
}

// So little is taken at once. Where the program is gone, next() says so.
void CadProcess::ask(const CadLaw& law) {
  static_cast<void>(::send(to_->descriptor(), &law, sizeof law, MSG_NOSIGNAL));
}

}  // namespace locvol
