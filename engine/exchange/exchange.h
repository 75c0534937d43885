// What processes that work on one run, its ranks, say to each other: a few verbs, which all ranks
// call in the same order. An implementation knows nothing of runs, and the engine nothing of MPI.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

namespace locvol {

// Another rank failed, or what it said did not arrive: nothing can go on but from the stores.
class ExchangeError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// What a rank has sent to others, and how long it has waited for them.
struct ExchangeStats {
  std::uint64_t num_messages = 0, num_bytes = 0;
  double seconds = 0;
  friend bool operator==(const ExchangeStats&, const ExchangeStats&) = default;
};

// Threads: used by one at a time. Errors: ExchangeError. After any, no verb may be called.
class Exchange {
 public:
  virtual ~Exchange() = default;
  virtual int rank() const = 0;  // from 0 on
  virtual int num_ranks() const = 0;
  // A message to each rank, which may be empty, in order of rank, to the own one, too; gives those
  // to this rank. REQUIRES: messages.size() == num_ranks()
  virtual std::vector<std::string> swap(std::vector<std::string> messages) = 0;
  // The same message to each. Takes as much memory as all of them.
  virtual std::vector<std::string> gather(const std::string& message) = 0;
  virtual ExchangeStats stats() const = 0;
};

// Each rank's number.
std::vector<std::uint64_t> gather_numbers(Exchange& exchange, std::uint64_t number);
// Of all ranks' numbers, the sum, and of those before this rank's.
struct SumOfRanks {
  std::uint64_t all = 0, before = 0;
};
SumOfRanks sum(Exchange& exchange, std::uint64_t number);
// Element by element. REQUIRES: as many on each rank
std::vector<std::uint64_t> sums(Exchange& exchange, std::span<const std::uint64_t> numbers);
std::uint64_t smallest(Exchange& exchange, std::uint64_t number);
// Is it true on any rank?
bool any(Exchange& exchange, bool is_true);
// Returns when all ranks have called it.
void wait_for_all(Exchange& exchange);

// Of what is sent in parts, about as much as a rank sends at once, to all others together.
inline constexpr std::size_t kMessageBytes = std::size_t{1} << 20;

}  // namespace locvol
