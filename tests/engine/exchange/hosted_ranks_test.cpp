#include "engine/exchange/hosted_ranks.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cstdint>
#include <functional>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "engine/exchange/thread_ranks.h"
#include "tests/engine/exchange/talk.h"

namespace locvol {
namespace {

// Throws where another thread than the first that has it calls a verb.
class OfOneThread : public Exchange {
 public:
  explicit OfOneThread(Exchange& exchange) : exchange_(exchange) {}
  int rank() const override { return exchange_.rank(); }
  int num_ranks() const override { return exchange_.num_ranks(); }
  std::vector<std::string> swap(std::vector<std::string> messages) override {
    require_thread();
    return exchange_.swap(std::move(messages));
  }
  std::vector<std::string> gather(const std::string& message) override {
    require_thread();
    return exchange_.gather(message);
  }
  ExchangeStats stats() const override { return exchange_.stats(); }

 private:
  void require_thread() const {
    if (std::this_thread::get_id() != thread_) throw std::logic_error("called by another thread");
  }
  Exchange& exchange_;
  const std::thread::id thread_ = std::this_thread::get_id();
};

void run_hosted(int num_ranks, int num_processes, const std::function<void(Exchange&)>& work) {
  run_as_ranks(num_processes, [&](Exchange& exchange) {
    OfOneThread processes(exchange);
    run_hosted_ranks(num_ranks, processes, work);
    talk(processes, 2);  // and all processes are where they should be
  });
}

TEST(HostedRanks, HearWhatIsSaidToThem) {
  for (const int num_processes : {1, 2, 3, 5})
    for (const int num_ranks : {1, 2, 3, 4, 8}) {
      SCOPED_TRACE(std::to_string(num_ranks) + " by " + std::to_string(num_processes));
      std::vector<std::atomic<int>> num_calls(static_cast<std::size_t>(num_ranks));
      run_hosted(num_ranks, num_processes, [&](Exchange& exchange) {
        EXPECT_EQ(exchange.num_ranks(), num_ranks);
        ++num_calls.at(static_cast<std::size_t>(exchange.rank()));
        talk(exchange, 20);
        exchange.swap(std::vector<std::string>(static_cast<std::size_t>(num_ranks)));
        talk(exchange, 1);
      });
      for (const std::atomic<int>& num : num_calls) EXPECT_EQ(num, 1);
    }
}

TEST(HostedRanks, AreOnTheProcessThatTheyFallTo) {
  run_as_ranks(3, [](Exchange& processes) {
    std::vector<int> here = ranks_hosted(8, processes);
    run_hosted_ranks(8, processes, [&](Exchange& exchange) {
      EXPECT_EQ(exchange.rank() % 3, processes.rank());
      EXPECT_EQ(here.at(static_cast<std::size_t>(exchange.rank() / 3)), exchange.rank());
    });
  });
}

// All that the verbs, and what is made of them, give to a rank.
std::vector<std::uint64_t> numbers_heard(Exchange& exchange) {
  const auto rank = static_cast<std::uint64_t>(exchange.rank());
  std::vector<std::uint64_t> heard = gather_numbers(exchange, rank * rank);
  const SumOfRanks total = sum(exchange, 10 + rank);
  heard.insert(heard.end(), {total.all, total.before, smallest(exchange, 7 - rank)});
  heard.insert(heard.end(), {any(exchange, rank == 3), any(exchange, rank == 5)});
  const std::vector<std::uint64_t> own = {rank, 1};
  for (const std::uint64_t of_all : sums(exchange, own)) heard.push_back(of_all);
  do_on_all(exchange, [&] { heard.push_back(rank); });
  wait_for_all(exchange);
  return heard;
}

TEST(HostedRanks, HearWhatThreadsHear) {
  using Heard = std::vector<std::vector<std::uint64_t>>;
  for (const int num_ranks : {1, 4, 6}) {
    Heard expected(static_cast<std::size_t>(num_ranks));
    const auto hear_into = [](Heard& heard) {
      return [&heard](Exchange& exchange) {
        heard.at(static_cast<std::size_t>(exchange.rank())) = numbers_heard(exchange);
      };
    };
    run_as_ranks(num_ranks, hear_into(expected));
    for (const int num_processes : {1, 2, 4, 7}) {
      Heard heard(expected.size());
      run_hosted(num_ranks, num_processes, hear_into(heard));
      EXPECT_EQ(heard, expected) << num_processes;
    }
  }
}

// Wherever it is: alone on its process, or not, or the one that speaks with the other processes.
TEST(HostedRanks, EndAllWhenOneFails) {
  for (const int num_processes : {1, 2, 3, 5, 6})
    for (int failing = 0; failing < 5; ++failing) {
      std::atomic<int> num_ended = 0;
      try {
        run_hosted(5, num_processes, [&](Exchange& exchange) {
          try {
            talk(exchange, 3);
            if (exchange.rank() == failing) throw std::runtime_error("the disk is full");
            talk(exchange, 3);
          } catch (const ExchangeError&) {
            ++num_ended;
            throw;
          }
        });
        ADD_FAILURE();
      } catch (const std::runtime_error& e) {
        EXPECT_EQ(std::string(e.what()), "the disk is full");
      }
      EXPECT_EQ(num_ended, 4) << failing << " of " << num_processes;
    }
}

TEST(HostedRanks, EndTogetherWhenTheirWorkFails) {
  std::atomic<int> num_ended = 0;
  EXPECT_THROW(run_hosted(5, 2,
                          [&](Exchange& exchange) {
                            try {
                              do_on_all(exchange, [&] {
                                if (exchange.rank() == 3) throw std::invalid_argument("no room");
                              });
                            } catch (const ExchangeError&) {
                              ++num_ended;
                              throw;
                            }
                          }),
               std::invalid_argument);
  EXPECT_EQ(num_ended, 4);
}

}  // namespace
}  // namespace locvol
