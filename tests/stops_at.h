#pragma once

#include <atomic>
#include <cstdint>
#include <limits>

#include "octree/stop.h"

namespace locvol {

// Says so at one question, counted from 1, and at all after it.
class StopsAt : public StopToken {
 public:
  static constexpr std::uint64_t kNever = std::numeric_limits<std::uint64_t>::max();

  explicit StopsAt(std::uint64_t question) : question_(question) {}
  bool is_stopped() const override { return ++num_asked_ >= question_; }
  std::uint64_t num_asked() const { return num_asked_; }

 private:
  std::uint64_t question_;
  mutable std::atomic<std::uint64_t> num_asked_ = 0;
};

}  // namespace locvol
