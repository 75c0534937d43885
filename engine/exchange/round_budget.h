// RoundBudget bounds what goes in one round of messages: all ranks may send to one.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "engine/exchange/exchange.h"

namespace locvol {

class RoundBudget {
 public:
  explicit RoundBudget(int num_ranks) : to_rank_(static_cast<std::size_t>(num_ranks)) {}

  void begin_round() {
    to_rank_.assign(to_rank_.size(), 0);
    to_all_ = to_one_ = 0;
  }
  void add(int rank, std::size_t bytes) {
    to_all_ += bytes;
    to_one_ = std::max(to_one_, to_rank_[static_cast<std::size_t>(rank)] += bytes);
  }
  bool has_room() const {
    return to_all_ < kMessageBytes && to_one_ < std::max(kMessageBytes / to_rank_.size(), kLeast);
  }

 private:
  static constexpr std::size_t kLeast = std::size_t{1} << 17;

  std::vector<std::size_t> to_rank_;     // bytes
  std::size_t to_all_ = 0, to_one_ = 0;  // the latter: to the one that gets most
};

}  // namespace locvol
