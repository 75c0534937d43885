// Code run in a child process, and signals between it and its parent.
#pragma once

#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <stdexcept>

namespace locvol::testing_samples {

// A child process that runs `body` and exits with its result; 99 if it throws. REQUIRES: no store
// is open that the child would use.
class Child {
 public:
  template <class Body>
  explicit Child(const Body& body) : id_(fork()) {
    if (id_ != 0) return;
    int result = 99;
    try {
      result = body();
    } catch (...) {
    }
    _exit(result);
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;
  ~Child() {
    if (id_ > 0) wait();
  }
  pid_t id() const { return id_; }

  // What waitpid() says of it.
  int wait() {
    int status = -1;
    waitpid(id_, &status, 0);
    id_ = 0;
    return status;
  }
  int exit_code() {
    const int status = wait();
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

 private:
  pid_t id_;
};

// One byte at a time between parent and child.
class Signal {
 public:
  Signal() {
    if (pipe(ends_) != 0) throw std::runtime_error("cannot make a pipe");
  }
  ~Signal() {
    close(ends_[0]);
    close(ends_[1]);
  }
  Signal(const Signal&) = delete;
  Signal& operator=(const Signal&) = delete;
  void raise() const {
    if (write(ends_[1], "!", 1) != 1) std::abort();
  }
  void await() const {
    char byte = 0;
    if (read(ends_[0], &byte, 1) != 1) std::abort();
  }

 private:
  int ends_[2];
};

}  // namespace locvol::testing_samples
