// What ranks say to each other to try an exchange.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "engine/exchange/exchange.h"

namespace locvol {

// What rank `from` says to rank `to` in its n-th call.
inline std::string said(int from, int to, int n) {
  return std::string(static_cast<std::size_t>(from * to + n) % 5, 'x') + std::to_string(from) +
         ">" + std::to_string(to) + "#" + std::to_string(n);
}

// Throws ExchangeError where messages are not what was said.
inline void talk(Exchange& exchange, int num_rounds) {
  for (int n = 0; n < num_rounds; ++n) {
    std::vector<std::string> messages;
    for (int to = 0; to < exchange.num_ranks(); ++to)
      messages.push_back(said(exchange.rank(), to, n));
    messages = exchange.swap(std::move(messages));
    const std::vector<std::string> gathered = exchange.gather(said(exchange.rank(), 99, n));
    for (int from = 0; from < exchange.num_ranks(); ++from) {
      const auto i = static_cast<std::size_t>(from);
      if (messages.at(i) != said(from, exchange.rank(), n) || gathered.at(i) != said(from, 99, n))
        throw ExchangeError("something else arrived");
    }
  }
}

}  // namespace locvol
