// Order, concurrency and errors of Workers, with tasks of random length.
#include "engine/shared/workers.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <atomic>
#include <chrono>
#include <optional>
#include <random>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "octree/stop.h"
#include "tests/directories.h"
#include "tests/skip_reasons.h"

namespace locvol {
namespace {

constexpr int kNumTasks = 300;

// What a run of tasks 0, 1, 2 … has done, and the laws that hold at every step.
struct Journal {
  std::vector<int> begun, applied;  // without a lock: by one thread at a time
  std::atomic<int> num_touching{0}, num_computing{0}, most_computing{0};
  std::atomic<bool> has_overlapped{false};
  std::optional<int> fails_to_compute, fails_to_apply;
  std::optional<int> waits_for_company;  // until another task is computed beside it, if ever
  std::vector<int> lengths;              // of the computations, in microseconds

  template <class Action>
  void touch(const Action& action) {
    if (++num_touching > 1) has_overlapped = true;
    action();
    --num_touching;
  }
};

class TestTask : public Task {
 public:
  TestTask(Journal& journal, int number) : journal_(journal), number_(number) {}
  void compute() override {
    const int now = ++journal_.num_computing;
    int most = journal_.most_computing;
    while (most < now && !journal_.most_computing.compare_exchange_weak(most, now)) {
    }
    if (journal_.waits_for_company == number_) wait_for_company();
    std::this_thread::sleep_for(
        std::chrono::microseconds(journal_.lengths[static_cast<std::size_t>(number_)]));
    result_ = 3 * number_;
    --journal_.num_computing;
    if (journal_.fails_to_compute == number_) throw std::runtime_error("compute");
  }
  void apply() override {
    journal_.touch([&] {
      if (journal_.fails_to_apply == number_) throw std::runtime_error("apply");
      journal_.applied.push_back(result_ / 3);
    });
  }

 private:
  void wait_for_company() const {
    const auto given_up = std::chrono::steady_clock::now() + std::chrono::minutes(2);
    while (journal_.most_computing < 2 && std::chrono::steady_clock::now() < given_up)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }

  Journal& journal_;
  int number_, result_ = -1;
};

class WorkersOf : public testing::TestWithParam<int> {
 protected:
  WorkersOf() {
    const unsigned seed = std::random_device()();
    RecordProperty("seed", std::to_string(seed));
    std::mt19937 random(seed);
    for (int i = 0; i < kNumTasks; ++i)
      journal_.lengths.push_back(static_cast<int>(random() % 8 == 0 ? random() % 2000 : 0));
  }
  std::unique_ptr<Task> next() {
    std::unique_ptr<Task> task;
    journal_.touch([&] {
      const int number = static_cast<int>(journal_.begun.size());
      if (number == kNumTasks) return;
      journal_.begun.push_back(number);
      task = std::make_unique<TestTask>(journal_, number);
    });
    return task;
  }
  void expect_applied(int num) const {
    ASSERT_EQ(journal_.applied.size(), static_cast<std::size_t>(num));
    for (int i = 0; i < num; ++i) EXPECT_EQ(journal_.applied[static_cast<std::size_t>(i)], i);
    EXPECT_FALSE(journal_.has_overlapped);
  }

  Journal journal_;
  bool is_endless_begun_ = false;
  Workers workers_{GetParam()};
};

TEST_P(WorkersOf, ApplyInOrderAndComputeAtOnce) {
  EXPECT_EQ(workers_.num_threads(), GetParam());
  if (GetParam() > 1) journal_.waits_for_company = 0;
  workers_.run_in_order([&] { return next(); });
  expect_applied(kNumTasks);
  EXPECT_LE(journal_.most_computing, GetParam());
  EXPECT_GT(journal_.most_computing, GetParam() > 1 ? 1 : 0);
  workers_.run_in_order([] { return nullptr; });
}

TEST_P(WorkersOf, AskAgainAfterEachTaskWhenThereIsNoneForNow) {
  int num_asked = 0;
  workers_.run_in_order([&]() -> std::unique_ptr<Task> {
    ++num_asked;
    const std::size_t under_way = journal_.begun.size() - journal_.applied.size();
    return under_way >= 2 ? nullptr : next();
  });
  expect_applied(kNumTasks);
  EXPECT_LE(journal_.most_computing, 2);
  EXPECT_LE(num_asked, 3 * kNumTasks);  // and not over and over
}

TEST_P(WorkersOf, BeginNoMoreThanTheyNeed) {
  std::size_t most = 0;
  workers_.run_in_order([&] {
    most = std::max(most, journal_.begun.size() - journal_.applied.size());
    return next();
  });
  EXPECT_LT(most, GetParam() == 1 ? 1U : 4U * static_cast<unsigned>(GetParam()));
}

// The error of a later task, though it may come first, is none: the task has not been reached.
TEST_P(WorkersOf, ThrowTheFirstErrorInOrderWithAllBeforeItApplied) {
  journal_.lengths[50] = 5000;
  journal_.fails_to_compute = 50;
  journal_.fails_to_apply = 52;
  try {
    workers_.run_in_order([&] { return next(); });
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_STREQ(error.what(), "compute");
  }
  expect_applied(50);
  EXPECT_EQ(journal_.num_computing, 0);
}

TEST_P(WorkersOf, ThrowWhatApplyingThrows) {
  journal_.fails_to_compute = 52;
  journal_.fails_to_apply = 50;
  try {
    workers_.run_in_order([&] { return next(); });
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_STREQ(error.what(), "apply");
  }
  EXPECT_EQ(journal_.applied.size(), 50U);
  journal_.num_touching = 0;
  workers_.run_in_order([] { return nullptr; });  // and can go on
}

TEST_P(WorkersOf, ThrowTheErrorOfNextAfterAllBeforeItAreApplied) {
  const auto run = [&] {
    workers_.run_in_order([&] {
      if (journal_.begun.size() == 50) throw std::runtime_error("next");
      return next();
    });
  };
  EXPECT_THROW(run(), std::runtime_error);
  expect_applied(50);
}

// Unlike an error, it comes out at once: what comes before it in the order may take long.
TEST_P(WorkersOf, DropAllThatIsNotAppliedOnceTheyAreStopped) {
  std::atomic<bool> is_stopped = false;
  struct Endless : Task {
    explicit Endless(std::atomic<bool>& stop) : is_stopped(stop) {}
    void compute() override {
      while (!is_stopped) std::this_thread::sleep_for(std::chrono::milliseconds(1));
      throw Stopped();
    }
    void apply() override { FAIL(); }
    std::atomic<bool>& is_stopped;
  };
  const bool has_company = GetParam() > 1;
  EXPECT_THROW(workers_.run_in_order([&]() -> std::unique_ptr<Task> {
    const std::size_t num_begun = journal_.begun.size();
    if (num_begun == 44) is_stopped = true;
    if (num_begun == 44 && !has_company) throw Stopped();
    if (num_begun == 40 && has_company && !std::exchange(is_endless_begun_, true))
      return std::make_unique<Endless>(is_stopped);
    return next();
  }),
               Stopped);
  EXPECT_EQ(journal_.num_computing, 0);
  EXPECT_LE(journal_.applied.size(), has_company ? 40U : 44U);
  expect_applied(static_cast<int>(journal_.applied.size()));
  EXPECT_LT(journal_.begun.size(), std::size_t{kNumTasks});
}

TEST_P(WorkersOf, AreStoppedByWhatIsAppliedOrBegun) {
  for (const bool by_next : {true, false}) {
    journal_.begun.clear();
    journal_.applied.clear();
    EXPECT_THROW(workers_.run_in_order([&]() -> std::unique_ptr<Task> {
      if (by_next && journal_.begun.size() == 20) throw Stopped();
      if (!by_next && journal_.applied.size() >= 20) throw Stopped();
      return next();
    }),
                 Stopped);
    expect_applied(static_cast<int>(journal_.applied.size()));
  }
  workers_.run_in_order([] { return nullptr; });  // and can go on
}

INSTANTIATE_TEST_SUITE_P(Threads, WorkersOf, testing::Values(1, 2, 3, 8));

// A limit on the memory of the process, or on its threads, may leave none for others.
TEST(Workers, DoWithoutThreadsThatTheSystemRefuses) {
  if (is_sanitized()) GTEST_SKIP() << kSanitized;
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_DATA, &before), 0);
  { const std::vector<char> freed(1 << 16); }  // some heap to make them in
  const rlimit none{1 << 20, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_DATA, &none), 0);
  auto workers = std::make_unique<Workers>(50);
  ASSERT_EQ(setrlimit(RLIMIT_DATA, &before), 0);
  Journal journal;
  journal.lengths.assign(kNumTasks, 0);
  workers->run_in_order([&]() -> std::unique_ptr<Task> {
    const int number = static_cast<int>(journal.begun.size());
    if (number == kNumTasks) return nullptr;
    journal.begun.push_back(number);
    return std::make_unique<TestTask>(journal, number);
  });
  EXPECT_EQ(journal.applied, journal.begun);
  EXPECT_EQ(journal.most_computing, 1) << "threads were made after all";
}

TEST(Workers, OfOneThreadAreTheCaller) {
  const auto caller = std::this_thread::get_id();
  struct ByCaller : Task {
    explicit ByCaller(std::thread::id id) : caller(id) {}
    void compute() override { EXPECT_EQ(std::this_thread::get_id(), caller); }
    void apply() override { EXPECT_EQ(std::this_thread::get_id(), caller); }
    std::thread::id caller;
  };
  int num_left = 20;
  Workers(1).run_in_order([&]() -> std::unique_ptr<Task> {
    EXPECT_EQ(std::this_thread::get_id(), caller);
    return num_left-- > 0 ? std::make_unique<ByCaller>(caller) : nullptr;
  });
  EXPECT_GE(num_usable_threads(), 1);
}

}  // namespace
}  // namespace locvol
