// StopSource asks the user of a run whether it is to end, on behalf of all its threads.
//
// The user's functions (RunControl) are called by one thread at a time: who calls one has the turn.
// A thread in the middle of a visit does not wait for the turn: whoever has it asks soon, or has
// asked just now.
#pragma once

#include <atomic>
#include <chrono>
#include <exception>
#include <functional>
#include <mutex>
#include <utility>

#include "octree/stop.h"

namespace locvol {

// Once stopped, it stays so.
class StopSource : public StopToken {
 public:
  // The next question is due so long after the last one.
  static constexpr std::chrono::milliseconds kInterval{100};

  // `ask` may be empty: it is never stopped. What it throws stops, too: see rethrow().
  explicit StopSource(std::function<bool()> ask);

  // What is known; the user is asked if that is due.
  bool is_stopped() const override;
  // The user is asked.
  bool ask() const;
  // Throws what the user has thrown when asked.
  void rethrow() const;
  // Gives a function that makes the same call, in turn with the question.
  template <class... Arguments>
  std::function<void(Arguments...)> in_turn(std::function<void(Arguments...)> call) const {
    if (!call) return nullptr;
    return [this, call = std::move(call)](Arguments... arguments) {
      const std::lock_guard turn(turn_);
      call(std::forward<Arguments>(arguments)...);
    };
  }

 private:
  bool ask_in_turn() const;

  const std::function<bool()> ask_;
  mutable std::atomic<bool> is_stopped_ = false;
  mutable std::atomic<std::int64_t> due_;  // milliseconds of a coarse clock
  mutable std::mutex turn_;
  mutable std::exception_ptr error_;
};

}  // namespace locvol
