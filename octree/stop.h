// How work that takes long learns that it is to end: who wants its result gives it a StopToken, and
// it asks that in its loops.
#pragma once

#include <cstdint>
#include <exception>

namespace locvol {

// Thrown where work is given up because it is to end. No error: of the work nothing is left, and it
// can be done again.
class Stopped : public std::exception {
 public:
  const char* what() const noexcept override { return "stopped"; }
};

// StopToken says whether work is to end. Any threads ask it at once, and often: it takes some
// nanoseconds.
class StopToken {
 public:
  virtual ~StopToken() = default;
  virtual bool is_stopped() const = 0;
};

// `stop` may be null: then it never throws.
inline void throw_if_stopped(const StopToken* stop) {
  if (stop != nullptr && stop->is_stopped()) throw Stopped();
}

// StopPoll is for loops with short turns, in which asking would show. It is called once a turn, and
// asks in one of `period` turns, a power of two.
class StopPoll {
 public:
  explicit StopPoll(const StopToken* stop, std::uint32_t period = 64)
      : stop_(stop), mask_(period - 1) {}
  void operator()() {
    if ((++num_turns_ & mask_) == 0) throw_if_stopped(stop_);
  }

 private:
  const StopToken* stop_;
  std::uint32_t mask_, num_turns_ = 0;
};

}  // namespace locvol
