#include "engine/shared/memory_budget.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>
#include <vector>

namespace locvol {
namespace {

constexpr std::uint64_t kMiB = std::uint64_t{1} << 20;

TEST(MemoryPlan, GivesNoMoreThanTheCap) {
  for (std::uint64_t cap = 128 * kMiB; cap <= 64 * 1024 * kMiB; cap *= 2) {
    const MemoryPlan plan(cap, 1000, 10 * kMiB);
    const MemoryRecord record = plan.record();
    EXPECT_EQ(record.cap, cap);
    EXPECT_LE(record.program + record.leaves + record.commits + plan.heap(), cap);
    EXPECT_LE(plan.max_unwritten(), record.commits / 2);
    EXPECT_GE(plan.heap(), cap / 4);
  }
}

TEST(MemoryPlan, RefusesACapThatIsTooSmallAndNamesTheLeastThatIsNot) {
  const std::uint64_t num_leaves = 10000, visit = 50 * kMiB;
  std::uint64_t least = kMiB;
  const auto is_enough = [&](std::uint64_t cap) {
    try {
      MemoryPlan(cap, num_leaves, visit);
      return true;
    } catch (const OverBudget&) {
      return false;
    }
  };
  while (!is_enough(least)) least += kMiB;
  EXPECT_GT(least, visit);
  for (const std::uint64_t cap : {kMiB, 10 * kMiB, least - 2 * kMiB}) {
    try {
      MemoryPlan(cap, num_leaves, visit);
      FAIL() << cap;
    } catch (const OverBudget& refused) {
      const std::string message = refused.what();
      const std::size_t at = message.find("give ");
      ASSERT_NE(at, std::string::npos) << message;
      const std::uint64_t named = kMiB * std::stoull(message.substr(at + 5));
      EXPECT_TRUE(is_enough(named)) << message;
      EXPECT_LE(named, least + 2 * kMiB) << message;
    }
  }
}

TEST(MemoryPlan, LetsNoMoreThreadsWorkThanFindMemory) {
  const MemoryPlan small(96 * kMiB, 100, kMiB), large(64 * 1024 * kMiB, 100, kMiB);
  EXPECT_EQ(small.num_threads(1), 1);
  EXPECT_GE(small.num_threads(1000), 2);
  EXPECT_LT(small.num_threads(1000), 8);
  EXPECT_EQ(large.num_threads(1000), 1000);
  EXPECT_EQ(num_streaming_threads(8, 96 * kMiB), 1);
  EXPECT_EQ(num_streaming_threads(2, 1024 * kMiB), 2);
  EXPECT_GE(num_streaming_threads(0, 1024 * kMiB), 1);
}

TEST(MemoryPlan, NamesACapForALargerHeap) {
  const MemoryPlan plan(128 * kMiB, 100, kMiB);
  for (const std::uint64_t heap : {kMiB, 100 * kMiB, 5000 * kMiB}) {
    const MemoryPlan larger(std::max(plan.cap_with_heap(heap), 128 * kMiB), 100, kMiB);
    EXPECT_GE(larger.heap() + 1, heap);
  }
}

TEST(MemoryBudget, GivesBackWhatIsReserved) {
  MemoryBudget budget(100);
  {
    const auto first = budget.reserve(60);
    EXPECT_EQ(budget.free_bytes(), 40u);
    auto second = budget.reserve(40);
    EXPECT_EQ(budget.free_bytes(), 0u);
    second = {};
    EXPECT_EQ(budget.free_bytes(), 40u);
  }
  EXPECT_EQ(budget.free_bytes(), 100u);
  EXPECT_EQ(budget.largest_reservation(), 60u);
  EXPECT_THROW(budget.reserve(101), OverBudget);
}

// Who holds some for good and waits for more than the rest would wait for ever.
TEST(MemoryBudget, RefusesMoreThanIsLeftOfWhatIsKept) {
  MemoryBudget budget(100);
  budget.keep(60);
  EXPECT_EQ(budget.total(), 40u);
  EXPECT_THROW(budget.reserve(41), OverBudget);
  EXPECT_THROW(budget.keep(41), OverBudget);
  EXPECT_EQ(budget.free_bytes(), 40u);
  { const auto rest = budget.reserve(40); }
  EXPECT_EQ(budget.free_bytes(), 40u);
}

TEST(MemoryBudget, IsNeverOverrunByWorkers) {
  MemoryBudget budget(100);
  std::atomic<std::int64_t> in_use{0}, most{0};
  std::vector<std::thread> workers;
  for (std::uint64_t w = 0; w < 4; ++w)
    workers.emplace_back([&, w] {
      for (std::uint64_t i = 0; i < 500; ++i) {
        const std::uint64_t bytes = 1 + (7 * i + 31 * w) % 90;
        const auto reservation = budget.reserve(bytes);
        const std::int64_t now = in_use += static_cast<std::int64_t>(bytes);
        std::int64_t before = most;
        while (before < now && !most.compare_exchange_weak(before, now)) {
        }
        in_use -= static_cast<std::int64_t>(bytes);
      }
    });
  for (std::thread& worker : workers) worker.join();
  EXPECT_LE(most, 100);
  EXPECT_EQ(budget.free_bytes(), 100u);
}

TEST(Memory, OfTheSystemIsPlausible) {
  EXPECT_GT(free_memory(), 10 * kMiB);
  const std::uint64_t before = peak_resident_memory();
  EXPECT_GT(before, kMiB);
  const std::vector<char> block(before + 50 * kMiB, 1);
  EXPECT_GE(peak_resident_memory(), before + 40 * kMiB);
  EXPECT_EQ(block.back(), 1);
}

}  // namespace
}  // namespace locvol
