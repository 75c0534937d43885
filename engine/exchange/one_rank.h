// OneRank is the exchange of a process that has a run to itself.
#pragma once

#include <string>
#include <vector>

#include "engine/exchange/exchange.h"

namespace locvol {

// Threads: any.
class OneRank : public Exchange {
 public:
  int rank() const override { return 0; }
  int num_ranks() const override { return 1; }
  std::vector<std::string> swap(std::vector<std::string> messages) override { return messages; }
  std::vector<std::string> gather(const std::string& message) override { return {message}; }
  ExchangeStats stats() const override { return {}; }
  void set_work(Work) override {}  // it waits for nobody
};

// The one that all processes have who have a run to themselves.
inline Exchange& alone() {
  static OneRank alone;
  return alone;
}

}  // namespace locvol
