// StopSource: when the user is asked, by whom, and what comes of it.
#include "engine/shared/stop_source.h"

#include <gtest/gtest.h>

#include <atomic>
#include <stdexcept>
#include <thread>
#include <vector>

namespace locvol {
namespace {

using Clock = std::chrono::steady_clock;

TEST(StopSource, IsNeverStoppedByNobody) {
  const StopSource stop(nullptr);
  EXPECT_FALSE(stop.ask());
  EXPECT_FALSE(stop.is_stopped());
  EXPECT_NO_THROW(stop.rethrow());
  EXPECT_FALSE(stop.in_turn(std::function<void(int)>()));
}

TEST(StopSource, StaysStopped) {
  int num_asked = 0;
  const StopSource stop([&] { return ++num_asked == 2; });
  EXPECT_FALSE(stop.ask());
  EXPECT_TRUE(stop.ask());
  EXPECT_TRUE(stop.ask());
  EXPECT_TRUE(stop.is_stopped());
  EXPECT_EQ(num_asked, 2);
}

TEST(StopSource, AsksNowAndThenHoweverOftenItIsAsked) {
  int num_asked = 0;
  const auto start = Clock::now();
  const StopSource stop([&] {
    ++num_asked;
    return false;
  });
  while (num_asked < 4) EXPECT_FALSE(stop.is_stopped());
  // Its clock is good to some milliseconds.
  EXPECT_GT(Clock::now() - start, 4 * (StopSource::kInterval - std::chrono::milliseconds(20)));
}

TEST(StopSource, IsStoppedByWhatTheUserThrows) {
  const StopSource stop([]() -> bool { throw std::runtime_error("enough"); });
  EXPECT_NO_THROW(stop.rethrow());
  EXPECT_TRUE(stop.ask());
  EXPECT_TRUE(stop.is_stopped());
  EXPECT_THROW(stop.rethrow(), std::runtime_error);
}

TEST(StopSource, CallsTheUserByOneThreadAtATime) {
  int num_calls = 0;  // without a lock
  std::atomic<int> num_inside = 0;
  const auto call = [&] {
    EXPECT_EQ(++num_inside, 1);
    ++num_calls;
    std::this_thread::sleep_for(std::chrono::microseconds(100));
    --num_inside;
  };
  const StopSource stop([&] {
    call();
    return false;
  });
  const auto tell = stop.in_turn(std::function<void(int)>([&](int) { call(); }));
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i)
    threads.emplace_back([&] {
      for (int n = 0; n < 200; ++n) {
        tell(n);
        stop.ask();
        stop.is_stopped();
      }
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_GE(num_calls, 4 * 2 * 200);
}

}  // namespace
}  // namespace locvol
