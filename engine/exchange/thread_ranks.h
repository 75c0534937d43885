// Ranks that are threads of one process. Whatever goes over a network in a run of many machines can
// so be tried, and go wrong, in a test.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>

#include "engine/exchange/exchange.h"

namespace locvol {

// What may become of a message on its way.
enum class MessageFault { kNone, kLost, kLate, kDoubled };

struct ThreadRanksOptions {
  // What goes wrong with message `number` (from 0 on) from one rank to another; empty: nothing
  // does. It is called by one thread at a time for each `from`.
  std::function<MessageFault(int from, int to, std::uint64_t number)> fault = {};
  // A rank that waits longer for a message gives up.
  std::chrono::milliseconds patience = std::chrono::minutes(10);
};

// Has each of the ranks do `work`, at once, in a thread of its own, the first in the caller's. If
// any throws, the others end with ExchangeError when they next wait for it; then throws what the
// first of those threw that had a reason of their own.
void run_as_ranks(int num_ranks, const std::function<void(Exchange&)>& work,
                  const ThreadRanksOptions& options = {});

}  // namespace locvol
