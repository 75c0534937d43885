#include "engine/exchange/thread_ranks.h"

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

  // take() would not wait.
  bool is_ready() {
    const std::lock_guard lock(mutex_);
    return is_known();
  }

  // Nothing: it has not come by then, or never will.
  std::optional<std::string> take(Clock::time_point until) {
    std::unique_lock lock(mutex_);
    changed_.wait_until(lock, until, [&] { return is_known(); });
    const auto next = waiting_.extract(num_taken_);
    if (!next) return std::nullopt;
    ++num_taken_;
    return std::move(next.mapped());
  }

  // No more will be put.
  void end() {
    const std::lock_guard lock(mutex_);
    has_ended_ = true;
    changed_.notify_one();
  }

 private:
  bool is_known() const { return waiting_.contains(num_taken_) || has_ended_; }

  std::mutex mutex_;
  std::condition_variable changed_;
  std::map<std::uint64_t, std::string> waiting_;
  std::uint64_t num_taken_ = 0;
  bool has_ended_ = false;
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
  // What the rank has said by now still arrives: others may have to hear it to end as it did.
  void end(int rank) {
    for (int to = 0; to < num_ranks; ++to) channel(rank, to).end();
  }

  const int num_ranks;
  const ThreadRanksOptions& options;
  std::vector<Channel> channels;
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
      while (!channel.is_ready() && work()) {
      }
      const Clock::time_point start = Clock::now();
      auto message = channel.take(start + network_.options.patience);
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
      network.end(rank);
    }
  };
  {
    std::vector<std::jthread> others;  // which do not wait for one that cannot be started
    run(0, [&] {
      int rank = 1;
      try {
        for (; rank < num_ranks; ++rank) others.emplace_back([&, rank] { run(rank, [] {}); });
      } catch (...) {
        for (; rank < num_ranks; ++rank) network.end(rank);
        throw;
      }
    });
  }
  std::exception_ptr error;
  for (const std::exception_ptr& e : errors)
    if (e && (!error || (is_of_another(error) && !is_of_another(e)))) error = e;
  if (error) std::rethrow_exception(error);
}

}  // namespace locvol
