#include "engine/exchange/exchange.h"

#include <algorithm>
#include <chrono>
#include <cstring>
#include <exception>
#include <limits>

#include "octree/stop.h"

namespace locvol {
namespace {

using Numbers = std::vector<std::uint64_t>;

// By rank.
std::vector<Numbers> gather_lists(Exchange& exchange, std::span<const std::uint64_t> numbers) {
  std::string message(numbers.size_bytes(), '\0');
  std::memcpy(message.data(), numbers.data(), message.size());
  std::vector<Numbers> lists;
  for (const std::string& bytes : exchange.gather(message)) {
    if (bytes.size() != message.size())
      throw ExchangeError("ranks disagree on what they are saying: this is a bug of locvol");
    lists.emplace_back(numbers.size());
    std::memcpy(lists.back().data(), bytes.data(), bytes.size());
  }
  return lists;
}

// Null: it did not throw.
std::exception_ptr failure_of(const std::function<void()>& work) {
  try {
    work();
    return nullptr;
  } catch (...) {
    return std::current_exception();
  }
}

}  // namespace

bool Exchange::work() {
  if (!work_) return false;
  const auto start = std::chrono::steady_clock::now();
  const bool was_any = work_();
  seconds_of_work_ +=
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return was_any;
}

Numbers gather_numbers(Exchange& exchange, std::uint64_t number) {
  Numbers numbers;
  for (const Numbers& list : gather_lists(exchange, {&number, 1})) numbers.push_back(list.front());
  return numbers;
}

SumOfRanks sum(Exchange& exchange, std::uint64_t number) {
  const Numbers numbers = gather_numbers(exchange, number);
  SumOfRanks sum;
  for (int rank = 0; rank < exchange.num_ranks(); ++rank) {
    if (rank == exchange.rank()) sum.before = sum.all;
    sum.all += numbers[static_cast<std::size_t>(rank)];
  }
  return sum;
}

Numbers sums(Exchange& exchange, std::span<const std::uint64_t> numbers) {
  Numbers sums(numbers.size());
  for (const Numbers& list : gather_lists(exchange, numbers))
    for (std::size_t i = 0; i < sums.size(); ++i) sums[i] += list[i];
  return sums;
}

std::uint64_t smallest(Exchange& exchange, std::uint64_t number) {
  return std::ranges::min(gather_numbers(exchange, number));
}

bool any(Exchange& exchange, bool is_true) {
  return std::ranges::max(gather_numbers(exchange, is_true ? 1 : 0)) == 1;
}

void wait_for_all(Exchange& exchange) { exchange.gather({}); }

void do_on_all(Exchange& exchange, const std::function<void()>& work) {
  enum Outcome : std::uint64_t { kDone, kStopped, kFailed };
  Outcome outcome = kDone;
  std::exception_ptr failure;
  try {
    work();
  } catch (const Stopped&) {
    outcome = kStopped;
  } catch (...) {
    outcome = kFailed;
    failure = std::current_exception();
  }
  std::uint64_t worst = outcome;
  try {
    worst = std::ranges::max(gather_numbers(exchange, outcome));
  } catch (const ExchangeError&) {
    if (!failure) throw;  // who has failed by itself tells that
  }
  if (failure) std::rethrow_exception(failure);
  if (worst == kFailed) throw ExchangeError("another process has failed");
  if (worst == kStopped) throw Stopped();
}

void check_on_all(Exchange& exchange, const std::function<void()>& check) {
  constexpr std::uint64_t kNone = std::numeric_limits<std::uint64_t>::max();
  const auto own = static_cast<std::uint64_t>(exchange.rank());
  const std::exception_ptr failure = failure_of(check);
  const std::uint64_t first = smallest(exchange, failure ? own : kNone);
  if (first == own) std::rethrow_exception(failure);
  while (first != kNone) wait_for_all(exchange);  // for what never comes
}

}  // namespace locvol
