#include "engine/exchange/thread_ranks.h"

#include <atomic>
#include <cassert>
#include <condition_variable>
#include <exception>
#include <map>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

namespace locvol {
namespace {

using Clock = std::chrono::steady_clock;

// Messages to one rank from one other. They carry numbers: one that comes twice is dropped, and one
// that comes before its turn has to wait for it.
class Channel {
 public:
  void put(std::uint64_t number, const std::string& message) {
    const std::lock_guard lock(mutex_);
    if (number >= num_taken_) waiting_.emplace(number, message);
    changed_.notify_one();
  }

  bool has_next() {
    const std::lock_guard lock(mutex_);
    return waiting_.contains(num_taken_);
  }

  // Nothing: it has not come by then, or a rank has failed.
  std::optional<std::string> take(Clock::time_point until, const std::atomic<bool>& has_failed) {
    std::unique_lock lock(mutex_);
    changed_.wait_until(lock, until, [&] { return waiting_.contains(num_taken_) || has_failed; });
    const auto next = waiting_.extract(num_taken_);
    if (!next) return std::nullopt;
    ++num_taken_;
    return std::move(next.mapped());
  }

  void wake() {
    const std::lock_guard lock(mutex_);
    changed_.notify_one();
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::map<std::uint64_t, std::string> waiting_;
  std::uint64_t num_taken_ = 0;
};

// What the ranks share.
struct Network {
  Network(int num, const ThreadRanksOptions& the_options)
      : num_ranks(num),
        options(the_options),
        channels(static_cast<std::size_t>(num) * static_cast<std::size_t>(num)) {}

  Channel& channel(int from, int to) {
    return channels[static_cast<std::size_t>(from) * static_cast<std::size_t>(num_ranks) +
                    static_cast<std::size_t>(to)];
  }
  void fail() {
    has_failed = true;
    for (Channel& channel : channels) channel.wake();
  }

  const int num_ranks;
  const ThreadRanksOptions& options;
  std::vector<Channel> channels;
  std::atomic<bool> has_failed = false;
};

class ThreadRank : public Exchange {
 public:
  ThreadRank(Network& network, int rank) : network_(network), rank_(rank) {}

  int rank() const override { return rank_; }
  int num_ranks() const override { return network_.num_ranks; }

  std::vector<std::string> swap(std::vector<std::string> messages) override {
    assert(messages.size() == static_cast<std::size_t>(num_ranks()));
    for (int to = 0; to < num_ranks(); ++to)
      if (to != rank_) send(to, messages[static_cast<std::size_t>(to)]);
    return receive(std::move(messages[static_cast<std::size_t>(rank_)]));
  }

  std::vector<std::string> gather(const std::string& message) override {
    for (int to = 0; to < num_ranks(); ++to)
      if (to != rank_) send(to, message);
    return receive(message);
  }

  ExchangeStats stats() const override { return stats_; }

 private:
  // Each rank sends as many to each other, so that they share their numbers.
  void send(int to, const std::string& message) {
    const auto& fault_of = network_.options.fault;
    const MessageFault fault = fault_of ? fault_of(rank_, to, num_verbs_) : MessageFault::kNone;
    Channel& channel = network_.channel(rank_, to);
    if (fault == MessageFault::kLate)
      late_.emplace(to, std::pair(num_verbs_, message));
    else if (fault != MessageFault::kLost)
      channel.put(num_verbs_, message);
    if (fault == MessageFault::kDoubled) channel.put(num_verbs_, message);
    // After one that was sent later.
    if (const auto late = late_.find(to); late != late_.end() && late->second.first < num_verbs_) {
      channel.put(late->second.first, late->second.second);
      late_.erase(late);
    }
    if (message.empty()) return;
    ++stats_.num_messages;
    stats_.num_bytes += message.size();
  }

  std::vector<std::string> receive(std::string own) {
    std::vector<std::string> messages;
    for (int from = 0; from < num_ranks(); ++from) {
      if (from == rank_) {
        messages.push_back(std::move(own));
        continue;
      }
      Channel& channel = network_.channel(from, rank_);
      while (!channel.has_next() && !network_.has_failed && work()) {
      }
      const Clock::time_point start = Clock::now();
      auto message = channel.take(start + network_.options.patience, network_.has_failed);
      if (!message)
        throw ExchangeError("rank " + std::to_string(rank_) + " waits for message " +
                            std::to_string(num_verbs_) + " from rank " + std::to_string(from) +
                            " in vain");
      stats_.seconds += std::chrono::duration<double>(Clock::now() - start).count();
      messages.push_back(std::move(*message));
    }
    ++num_verbs_;
    return messages;
  }

  Network& network_;
  int rank_;
  std::uint64_t num_verbs_ = 0;
  std::map<int, std::pair<std::uint64_t, std::string>> late_;  // by receiver, with their numbers
  ExchangeStats stats_;
};

bool is_of_another(const std::exception_ptr& error) try {
  std::rethrow_exception(error);
} catch (const ExchangeError&) {
  return true;
} catch (...) {
  return false;
}

}  // namespace

void run_as_ranks(int num_ranks, const std::function<void(Exchange&)>& work,
                  const ThreadRanksOptions& options) {
  Network network(num_ranks, options);
  std::vector<std::exception_ptr> errors(static_cast<std::size_t>(num_ranks));
  const auto run = [&](int rank, const auto& begin) {
    try {
      begin();
      ThreadRank exchange(network, rank);
      work(exchange);
    } catch (...) {
      errors[static_cast<std::size_t>(rank)] = std::current_exception();
      network.fail();
    }
  };
  {
    std::vector<std::jthread> others;  // which do not wait for one that cannot be started
    run(0, [&] {
      for (int rank = 1; rank < num_ranks; ++rank)
        others.emplace_back([&, rank] { run(rank, [] {}); });
    });
  }
  std::exception_ptr error;
  for (const std::exception_ptr& e : errors)
    if (e && (!error || (is_of_another(error) && !is_of_another(e)))) error = e;
  if (error) std::rethrow_exception(error);
}

}  // namespace locvol
