#include "engine/exchange/thread_ranks.h"

#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <numeric>
#include <stdexcept>
#include <string>
#include <thread>

#include "octree/stop.h"
#include "tests/engine/exchange/talk.h"

namespace locvol {
namespace {

TEST(ThreadRanks, HearWhatIsSaidToThem) {
  for (const int num_ranks : {1, 2, 3, 8})
    run_as_ranks(num_ranks, [&](Exchange& exchange) {
      EXPECT_EQ(exchange.num_ranks(), num_ranks);
      talk(exchange, 50);
      const auto others = static_cast<std::uint64_t>(num_ranks - 1);
      EXPECT_EQ(exchange.stats().num_messages, 100 * others);
    });
}

TEST(ThreadRanks, AddUp) {
  run_as_ranks(5, [](Exchange& exchange) {
    const auto rank = static_cast<std::uint64_t>(exchange.rank());
    const SumOfRanks total = sum(exchange, 10 * rank);
    EXPECT_EQ(total.all, 100U);
    EXPECT_EQ(total.before, 10 * (rank * (rank - 1)) / 2);
    EXPECT_EQ(smallest(exchange, 7 - rank), 3U);
    EXPECT_TRUE(any(exchange, rank == 3));
    EXPECT_FALSE(any(exchange, rank == 5));
    const std::vector<std::uint64_t> numbers = {rank, 1};
    EXPECT_EQ(sums(exchange, numbers), (std::vector<std::uint64_t>{10, 5}));
    EXPECT_EQ(gather_numbers(exchange, rank), (std::vector<std::uint64_t>{0, 1, 2, 3, 4}));
  });
}

// What several find out, one tells.
TEST(ThreadRanks, CheckTogether) {
  run_as_ranks(4, [](Exchange& exchange) {
    check_on_all(exchange, [] {});
    talk(exchange, 3);
  });
  for (const int first : {0, 2, 3}) {
    std::atomic<int> num_told = 0, num_ended = 0;
    const auto check = [&](Exchange& exchange) {
      try {
        check_on_all(exchange, [&] {
          if (exchange.rank() >= first) throw std::domain_error(std::to_string(exchange.rank()));
        });
        ADD_FAILURE() << "it went on";
      } catch (const std::domain_error& e) {
        EXPECT_EQ(e.what(), std::to_string(first));
        ++num_told;
        throw;
      } catch (const ExchangeError&) {
        ++num_ended;
        throw;
      }
    };
    EXPECT_THROW(run_as_ranks(4, check), std::domain_error);
    EXPECT_EQ(num_told, 1);
    EXPECT_EQ(num_ended, 3);
  }
}

TEST(ThreadRanks, WorkWhileTheyWait) {
  std::atomic<int> num_done = 0;
  run_as_ranks(2, [&](Exchange& exchange) {
    if (exchange.rank() == 1) {
      while (num_done < 5) std::this_thread::yield();
      wait_for_all(exchange);
    } else {
      const WorkWhileWaiting work(exchange, [&] { return ++num_done < 100; });
      wait_for_all(exchange);
    }
    wait_for_all(exchange);
    const int num_then = num_done;
    talk(exchange, 20);
    EXPECT_EQ(num_done, num_then);
  });
}

TEST(ThreadRanks, EndWhenTheirWorkFails) {
  EXPECT_THROW(run_as_ranks(3,
                            [&](Exchange& exchange) {
                              const bool is_late = exchange.rank() == 2;
                              const WorkWhileWaiting work(
                                  exchange, [&]() -> bool { throw std::domain_error("of work"); });
                              if (!is_late) talk(exchange, 1);
                            }),
               std::domain_error);
}

TEST(ThreadRanks, EndWhenOneFails) {
  std::atomic<int> num_ended = 0;
  try {
    run_as_ranks(4, [&](Exchange& exchange) {
      try {
        talk(exchange, 3);
        if (exchange.rank() == 2) throw std::runtime_error("the disk is full");
        talk(exchange, 3);
      } catch (const ExchangeError&) {
        ++num_ended;
        throw;
      }
    });
    FAIL();
  } catch (const std::runtime_error& e) {
    EXPECT_EQ(std::string(e.what()), "the disk is full");
  }
  EXPECT_EQ(num_ended, 3);
}

TEST(ThreadRanks, EndTogetherWhenTheirWorkFails) {
  std::array<bool, 3> has_ended{};
  EXPECT_THROW(run_as_ranks(3,
                            [&](Exchange& exchange) {
                              const int rank = exchange.rank();
                              do_on_all(exchange, [] {});
                              try {
                                do_on_all(exchange, [rank] {
                                  if (rank == 1) throw std::invalid_argument("no room");
                                });
                              } catch (const std::invalid_argument&) {
                                has_ended[1] = rank == 1;
                                throw;
                              } catch (const ExchangeError&) {
                                has_ended[static_cast<std::size_t>(rank)] = true;
                                throw;
                              }
                            }),
               std::invalid_argument);
  EXPECT_EQ(has_ended, (std::array{true, true, true}));
}

TEST(ThreadRanks, StopTogetherUnlessOneHasFailed) {
  for (const bool fails : {false, true}) {
    std::array<bool, 3> is_stopped{};
    const auto run = [&] {
      run_as_ranks(3, [&](Exchange& exchange) {
        const int rank = exchange.rank();
        try {
          do_on_all(exchange, [&] {
            if (rank == 1) throw Stopped();
            if (rank == 2 && fails) throw std::invalid_argument("no room");
          });
        } catch (const Stopped&) {
          is_stopped[static_cast<std::size_t>(rank)] = true;
          throw;
        }
      });
    };
    if (fails) {
      EXPECT_THROW(run(), std::invalid_argument);
      EXPECT_EQ(is_stopped, (std::array{false, false, false}));
    } else {
      EXPECT_THROW(run(), Stopped);
      EXPECT_EQ(is_stopped, (std::array{true, true, true}));
    }
  }
}

TEST(ThreadRanks, NoticeEachMessageThatIsLost) {
  for (std::uint64_t lost = 0; lost < 6; ++lost) {
    const ThreadRanksOptions options{.fault =
                                         [&](int from, int to, std::uint64_t number) {
                                           return from == 1 && to == 0 && number == lost
                                                      ? MessageFault::kLost
                                                      : MessageFault::kNone;
                                         },
                                     .patience = std::chrono::milliseconds(50)};
    EXPECT_THROW(run_as_ranks(
                     3, [](Exchange& exchange) { talk(exchange, 3); }, options),
                 ExchangeError);
  }
}

TEST(ThreadRanks, HearEachMessageOnceAndInOrder) {
  for (const MessageFault fault : {MessageFault::kDoubled, MessageFault::kNone}) {
    const ThreadRanksOptions options{.fault = [&](int from, int to, std::uint64_t number) {
      return (from + to + int(number)) % 3 == 0 ? fault : MessageFault::kNone;
    }};
    run_as_ranks(
        4, [](Exchange& exchange) { talk(exchange, 20); }, options);
  }
}

// One that comes after the next is waited for, unless there is no next.
TEST(ThreadRanks, WaitForAMessageThatIsLate) {
  for (const std::uint64_t number : {2, 3, 5}) {
    const ThreadRanksOptions options{.fault =
                                         [&](int from, int, std::uint64_t n) {
                                           return from == 0 && n == number ? MessageFault::kLate
                                                                           : MessageFault::kNone;
                                         },
                                     .patience = std::chrono::seconds(2)};
    const auto run = [&] {
      run_as_ranks(
          3, [](Exchange& exchange) { talk(exchange, 3); }, options);
    };
    if (number == 5) {
      EXPECT_THROW(run(), ExchangeError);
    } else {
      EXPECT_NO_THROW(run());
    }
  }
}

}  // namespace
}  // namespace locvol
