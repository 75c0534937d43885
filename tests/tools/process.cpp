#include "tests/tools/process.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/resource.h>
#include <sys/wait.h>

#include <cerrno>
#include <system_error>

#include "tests/file_bytes.h"

extern char** environ;

namespace locvol {
namespace {

double seconds(const timeval& time) {
  return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
}

}  // namespace

std::string locvol_command() { return LOCVOL_COMMAND; }

Process::Process(const std::vector<std::string>& arguments, std::uint64_t data_bytes,
                 const std::filesystem::path& input) {
  std::string command = locvol_command();
  std::vector<std::string> copies = arguments;
  std::vector<char*> argv = {command.data()};
  for (std::string& copy : copies) argv.push_back(copy.data());
  argv.push_back(nullptr);

  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_addopen(&files, 0, input.c_str(), O_RDONLY | O_NOCTTY, 0);
  posix_spawn_file_actions_addopen(&files, 1, (output_ / "out").c_str(), O_WRONLY | O_CREAT, 0600);
  posix_spawn_file_actions_addopen(&files, 2, (output_ / "err").c_str(), O_WRONLY | O_CREAT, 0600);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  // Whoever runs the tests in the background may ignore it.
  sigset_t interrupts;
  sigemptyset(&interrupts);
  sigaddset(&interrupts, SIGINT);
  posix_spawnattr_setsigdefault(&attributes, &interrupts);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGDEF);
  const int error = posix_spawn(&pid_, command.c_str(), &files, &attributes, argv.data(), environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&files);
  if (error == 0 && data_bytes > 0) {
    const rlimit limit{data_bytes, data_bytes};  // while the process is still being linked
    if (prlimit(pid_, RLIMIT_DATA, &limit, nullptr) != 0)
      throw std::system_error(errno, std::generic_category(), "prlimit");
  }
  if (error != 0) throw std::system_error(error, std::generic_category(), command);
}

Process::~Process() {
  if (pid_ == 0) return;
  kill(pid_, SIGKILL);
  waitpid(pid_, nullptr, 0);
}

void Process::send(int signal) { kill(pid_, signal); }

bool Process::has_ended() const {
  siginfo_t info = {};  // si_pid stays 0 while the process runs
  waitid(P_PID, static_cast<id_t>(pid_), &info, WEXITED | WNOHANG | WNOWAIT);
  return info.si_pid != 0;
}

std::string Process::err() const { return bytes_of(output_ / "err"); }

ProcessResult Process::wait() {
  int status = 0;
  rusage usage = {};
  wait4(pid_, &status, 0, &usage);
  pid_ = 0;
  return {.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : -1,
          .signal = WIFSIGNALED(status) ? WTERMSIG(status) : 0,
          .peak_bytes = 1024 * static_cast<std::uint64_t>(usage.ru_maxrss),
          .cpu_seconds = seconds(usage.ru_utime) + seconds(usage.ru_stime),
          .out = bytes_of(output_ / "out"),
          .err = err()};
}

ProcessResult run_locvol(const std::vector<std::string>& arguments, std::uint64_t data_bytes) {
  return Process(arguments, data_bytes).wait();
}

}  // namespace locvol
