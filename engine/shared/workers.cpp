#include "engine/shared/workers.h"

#include <pthread.h>
#include <sched.h>

#include <algorithm>
#include <atomic>
#include <cassert>
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <exception>
#include <mutex>
#include <utility>
#include <vector>

#include "octree/stop.h"

namespace locvol {
namespace {

using NextTask = std::function<std::unique_ptr<Task>()>;

// Does what is posted, first come, first served.
class ThreadPool {
 public:
  // As many as the system gives: fewer threads are slower, and no error.
  explicit ThreadPool(int num_threads) {
    pthread_attr_t attributes;
    pthread_attr_init(&attributes);
    pthread_attr_setstacksize(&attributes, kStackBytes);
    threads_.reserve(static_cast<std::size_t>(num_threads));
    for (pthread_t thread{}; num_threads > 0; --num_threads) {
      if (pthread_create(&thread, &attributes, &ThreadPool::run_thread, this) != 0) break;
      threads_.push_back(thread);
    }
    pthread_attr_destroy(&attributes);
  }
  ~ThreadPool() {
    {
      const std::lock_guard lock(mutex_);
      is_ending_ = true;
    }
    changed_.notify_all();
    for (const pthread_t thread : threads_) pthread_join(thread, nullptr);
  }
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  // A job throws nothing.
  void post(std::function<void()> job) {
    {
      const std::lock_guard lock(mutex_);
      jobs_.push_back(std::move(job));
      ++num_unfinished_;
    }
    changed_.notify_one();
  }
  // Does its share, and returns when all that was posted is done.
  void help() {
    work([this] { return num_unfinished_ == 0; });
  }

 private:
  static constexpr std::size_t kStackBytes = std::size_t{2} << 20;

  static void* run_thread(void* pool) {
    auto* const self = static_cast<ThreadPool*>(pool);
    self->work([self] { return self->is_ending_; });
    return nullptr;
  }

  void work(const auto& is_over) {
    std::unique_lock lock(mutex_);
    while (true) {
      changed_.wait(lock, [&] { return is_over() || !jobs_.empty(); });
      if (is_over()) return;
      const auto job = std::move(jobs_.front());
      jobs_.pop_front();
      lock.unlock();
      job();
      lock.lock();
      if (--num_unfinished_ == 0) changed_.notify_all();
    }
  }

  std::vector<pthread_t> threads_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<std::function<void()>> jobs_;
  std::size_t num_unfinished_ = 0;  // waiting or being done
  bool is_ending_ = false;
};

// One call of run_in_order. No thread waits for another: one that has computed a task applies what
// is due and begins the next, or leaves both to the thread that is at it.
class OrderedRun {
 public:
  OrderedRun(ThreadPool& pool, int num_threads, const NextTask& next, int max_tasks_per_thread)
      : pool_(pool),
        next_(next),
        max_uncomputed_(num_threads == 1 ? 1 : num_threads + 1),
        max_under_way_(num_threads == 1 ? 1
                                        : static_cast<std::size_t>(max_tasks_per_thread) *
                                              static_cast<std::size_t>(num_threads)) {}

  void run() {
    advance();
    pool_.help();
    if (error_) std::rethrow_exception(error_);
    if (is_stopped_) throw Stopped();
    if (error_of_next_) std::rethrow_exception(error_of_next_);
  }

 private:
  struct Entry {
    explicit Entry(std::unique_ptr<Task> the_task) : task(std::move(the_task)) {}
    std::unique_ptr<Task> task;
    std::exception_ptr error;  // of its computation
    std::atomic<bool> is_computed = false;
  };

  // By one thread at a time: whoever comes meanwhile has it go round once more.
  void advance() {
    int num_callers = ++num_callers_;
    if (num_callers > 1) return;
    do {
      num_callers = num_callers_;
      apply_computed();
      begin_tasks();
    } while ((num_callers_ -= num_callers) > 0);
  }

  // What is not computed for a failure counts as computed after that, so is to be asked before it.
  void apply_computed() {
    for (; !under_way_.empty() && under_way_.front().is_computed && !is_failed_;
         under_way_.pop_front()) {
      try {
        apply(under_way_.front());
      } catch (const Stopped&) {
        stop();
      } catch (...) {
        error_ = std::current_exception();
        is_failed_ = true;
      }
    }
  }

  void apply(Entry& entry) {
    if (entry.error) std::rethrow_exception(entry.error);
    entry.task->apply();
    is_none_for_now_ = false;
  }

  void begin_tasks() {
    while (!is_failed_ && !error_of_next_ && !is_none_for_now_ &&
           num_uncomputed_ < max_uncomputed_ && under_way_.size() < max_under_way_) {
      try {
        begin(next_());
      } catch (const Stopped&) {
        stop();
      } catch (...) {
        error_of_next_ = std::current_exception();
      }
    }
  }

  void begin(std::unique_ptr<Task> task) {
    is_none_for_now_ = task == nullptr;
    if (is_none_for_now_) return;
    Entry& entry = under_way_.emplace_back(std::move(task));
    ++num_uncomputed_;
    pool_.post([this, &entry] { compute(entry); });
  }

  void compute(Entry& entry) {
    try {
      if (!is_failed_) entry.task->compute();
    } catch (const Stopped&) {
      stop();
    } catch (...) {
      entry.error = std::current_exception();
    }
    entry.is_computed = true;
    --num_uncomputed_;
    advance();
  }

  // By any thread.
  void stop() {
    is_stopped_ = true;
    is_failed_ = true;
  }

  ThreadPool& pool_;
  const NextTask& next_;
  const int max_uncomputed_;
  const std::size_t max_under_way_;
  std::atomic<int> num_callers_ = 0;  // of advance(), now
  std::atomic<int> num_uncomputed_ = 0;
  std::atomic<bool> is_failed_ = false;  // nothing more is applied
  std::atomic<bool> is_stopped_ = false;
  // All below belongs to the thread in advance().
  std::deque<Entry> under_way_;
  bool is_none_for_now_ = false;
  std::exception_ptr error_, error_of_next_;  // of a task, which comes first; of next()
};

}  // namespace

struct Workers::Impl {
  explicit Impl(int the_num_threads) : num_threads(the_num_threads), pool(the_num_threads - 1) {}

  int num_threads;
  ThreadPool pool;
};

Workers::Workers(int num_threads) {
  assert(num_threads >= 1);
  impl_ = std::make_unique<Impl>(num_threads);
}
Workers::~Workers() = default;

int Workers::num_threads() const { return impl_->num_threads; }

void Workers::run_in_order(const NextTask& next, int max_tasks_per_thread) {
  OrderedRun(impl_->pool, num_threads(), next, max_tasks_per_thread).run();
}

int num_usable_threads() {
  cpu_set_t usable;
  if (sched_getaffinity(0, sizeof(usable), &usable) != 0) return 1;
  return std::max(CPU_COUNT(&usable), 1);
}

}  // namespace locvol
