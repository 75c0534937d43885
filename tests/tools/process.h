// Runs the locvol command as its users do: arguments in, exit code, stdout and stderr out.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "tests/temp_dir.h"

namespace locvol {

struct ProcessResult {
  int exit_code = -1;            // -1: a signal ended the process
  int signal = 0;                // that signal
  std::uint64_t peak_bytes = 0;  // of resident memory
  double cpu_seconds = 0;        // of all threads, in the program and in the system
  std::string out, err;
};

std::string locvol_command();  // its path

class Process {
 public:
  // `data_bytes`: limit on the process's private memory (RLIMIT_DATA), or 0. `input`: the file that
  // is its standard input.
  explicit Process(const std::vector<std::string>& arguments, std::uint64_t data_bytes = 0,
                   const std::filesystem::path& input = "/dev/null");
  ~Process();  // kills it, if it still runs
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  pid_t id() const { return pid_; }
  void send(int signal);
  bool has_ended() const;
  std::string err() const;  // so far
  ProcessResult wait();

 private:
  TempDir output_;
  pid_t pid_ = 0;  // 0: waited for
};

ProcessResult run_locvol(const std::vector<std::string>& arguments, std::uint64_t data_bytes = 0);

}  // namespace locvol
