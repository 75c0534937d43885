// What processes that work on one run, its ranks, say to each other: a few verbs, which all ranks
// call in the same order. An implementation knows nothing of runs, and the engine nothing of MPI.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
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
  // Says the same message to each rank, and gives those of all. Takes as much memory as all of
  // them.
  virtual std::vector<std::string> gather(const std::string& message) = 0;
  virtual ExchangeStats stats() const = 0;

  // Work of the caller's that may be done while a verb waits for others: it does a piece of it, and
  // tells whether there was one. It calls no verb; what it throws, the verb throws.
  using Work = std::function<bool()>;
  virtual void set_work(Work work) { work_ = std::move(work); }

 protected:
  // Does a piece of the caller's work, if there is any.
  bool work();
  double seconds_of_work() const { return seconds_of_work_; }  // so far

 private:
  Work work_;
  double seconds_of_work_ = 0;
};

// Has an exchange do this work for as long as it lives.
class WorkWhileWaiting {
 public:
  WorkWhileWaiting(Exchange& exchange, Exchange::Work work) : exchange_(exchange) {
    exchange_.set_work(std::move(work));
  }
  WorkWhileWaiting(const WorkWhileWaiting&) = delete;
  WorkWhileWaiting& operator=(const WorkWhileWaiting&) = delete;
  ~WorkWhileWaiting() { exchange_.set_work(nullptr); }

 private:
  Exchange& exchange_;
};

// The numbers of all ranks, by rank.
std::vector<std::uint64_t> gather_numbers(Exchange& exchange, std::uint64_t number);
// The sum of all ranks' numbers, and of those of ranks before this one.
struct SumOfRanks {
  std::uint64_t all = 0, before = 0;
};
SumOfRanks sum(Exchange& exchange, std::uint64_t number);
// Element by element. REQUIRES: as many on each rank
std::vector<std::uint64_t> sums(Exchange& exchange, std::span<const std::uint64_t> numbers);
std::uint64_t smallest(Exchange& exchange, std::uint64_t number);
// Tells whether it is true on any rank.
bool any(Exchange& exchange, bool is_true);
// Returns when all ranks have called it.
void wait_for_all(Exchange& exchange);
// Returns once each rank has done its work, which talks to no other rank. If that throws on any,
// then all throw: there what it was, on others ExchangeError; Stopped, if that is all that any
// throws.
void do_on_all(Exchange& exchange, const std::function<void()>& work);
// Makes a check whose outcome is alike on all ranks, or nearly so. What `check` throws, the first
// rank throws where it does; the others throw nothing but ExchangeError, when it has ended.
void check_on_all(Exchange& exchange, const std::function<void()>& check);

// About as much as a rank sends at once, to all others together, of what is sent in parts.
inline constexpr std::size_t kMessageBytes = std::size_t{1} << 20;

}  // namespace locvol
