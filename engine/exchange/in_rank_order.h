// What all ranks have, one rank's after another's: what comes in the order of leaves, comes so.
#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "engine/exchange/exchange.h"
#include "engine/exchange/pack.h"

namespace locvol {

// The first values of all ranks' lists, at most `max`, for all ranks.
template <class T>
std::vector<T> first_of_ranks(Exchange& exchange, std::vector<T> own, std::uint64_t max) {
  const std::uint64_t before = std::min(max, sum(exchange, own.size()).before);
  if (own.size() > max - before) own.resize(max - before);
  return gather_all(exchange, own);
}

// Called by all ranks. next() gives an optional value after another, which this rank tells the
// first one; there, take(value) gets those of all others. A value is a message.
template <class Next, class Take>
void tell_first_rank(Exchange& exchange, const Next& next, const Take& take) {
  using Value = typename decltype(next())::value_type;
  for (int rank = 1; rank < exchange.num_ranks(); ++rank) {
    bool has_told = false;
    do {
      std::vector<std::string> messages(static_cast<std::size_t>(exchange.num_ranks()));
      const auto value = rank == exchange.rank() ? next() : std::nullopt;
      has_told = value.has_value();
      if (has_told) messages.front() = pack(*value);
      messages = exchange.swap(std::move(messages));
      const std::string& told = messages[static_cast<std::size_t>(rank)];
      if (!told.empty()) take(unpack<Value>(told));
    } while (any(exchange, has_told));
  }
}

}  // namespace locvol
