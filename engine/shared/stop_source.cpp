#include "engine/shared/stop_source.h"

#include <time.h>

namespace locvol {
namespace {

// Good to some milliseconds, for a few nanoseconds.
std::int64_t coarse_milliseconds() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC_COARSE, &now);
  return std::int64_t{1000} * now.tv_sec + now.tv_nsec / 1'000'000;
}

}  // namespace

StopSource::StopSource(std::function<bool()> ask)
    : ask_(std::move(ask)), due_(coarse_milliseconds() + kInterval.count()) {}

bool StopSource::is_stopped() const {
  if (is_stopped_.load(std::memory_order_relaxed)) return true;
  if (!ask_ || coarse_milliseconds() < due_.load(std::memory_order_relaxed)) return false;
  const std::unique_lock turn(turn_, std::try_to_lock);
  return turn.owns_lock() && ask_in_turn();
}

bool StopSource::ask() const {
  if (!ask_) return false;
  const std::lock_guard turn(turn_);
  return ask_in_turn();
}

bool StopSource::ask_in_turn() const {
  if (is_stopped_) return true;
  try {
    if (ask_()) is_stopped_ = true;
  } catch (...) {
    error_ = std::current_exception();
    is_stopped_ = true;
  }
  due_ = coarse_milliseconds() + kInterval.count();
  return is_stopped_;
}

void StopSource::rethrow() const {
  const std::lock_guard turn(turn_);
  if (error_) std::rethrow_exception(error_);
}

}  // namespace locvol
