#include "engine/workers.h"

#include <malloc.h>
#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/info.h>
#include <oneapi/tbb/task_arena.h>
#include <oneapi/tbb/task_group.h>

#include <atomic>
#include <cassert>
#include <cstddef>
#include <deque>
#include <exception>
#include <mutex>
#include <queue>
#include <utility>

// TBB's library is built without the thread sanitizer, which so does not see that tasks go from one
// thread to another by it, unless told. The task object itself is TBB's own affair.
#ifdef __SANITIZE_THREAD__
#include <sanitizer/tsan_interface.h>
extern "C" const char* __tsan_default_suppressions() {
  return "race_top:tbb::detail::d1::function_task";
}
#define LOCVOL_HAND_OVER(object) __tsan_release(object)
#define LOCVOL_TAKE_OVER(object) __tsan_acquire(object)
#else
#define LOCVOL_HAND_OVER(object)
#define LOCVOL_TAKE_OVER(object)
#endif

namespace locvol {
namespace {

using NextTask = std::function<std::unique_ptr<Task>()>;

// One call of run_in_order. No thread waits for another: one that has computed a task applies what
// is due and begins the next, or leaves both to the thread that is at it.
class OrderedRun {
 public:
  OrderedRun(int num_threads, const NextTask& next)
      : next_(next),
        max_uncomputed_(num_threads == 1 ? 1 : num_threads + 1),
        max_under_way_(num_threads == 1 ? 1 : 4 * static_cast<std::size_t>(num_threads)) {}

  void run() {
    advance();
    group_.wait();
    LOCVOL_TAKE_OVER(&group_);
    if (error_) std::rethrow_exception(error_);
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

  void apply_computed() {
    for (; !is_failed_ && !under_way_.empty() && under_way_.front().is_computed;
         under_way_.pop_front()) {
      try {
        apply(under_way_.front());
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
    {
      const std::lock_guard lock(mutex_);
      to_compute_.push(&entry);
    }
    LOCVOL_HAND_OVER(this);
    group_.run([this] {
      LOCVOL_TAKE_OVER(this);
      compute(oldest_to_compute());
      LOCVOL_HAND_OVER(&group_);
    });
  }

  // First come, first served, where a task group would take the last first: the others wait to be
  // applied for the oldest.
  Entry& oldest_to_compute() {
    const std::lock_guard lock(mutex_);
    Entry& entry = *to_compute_.front();
    to_compute_.pop();
    return entry;
  }

  void compute(Entry& entry) {
    try {
      if (!is_failed_) entry.task->compute();
    } catch (...) {
      entry.error = std::current_exception();
    }
    entry.is_computed = true;
    --num_uncomputed_;
    advance();
  }

  const NextTask& next_;
  const int max_uncomputed_;
  const std::size_t max_under_way_;
  std::atomic<int> num_callers_ = 0;  // of advance(), now
  std::atomic<int> num_uncomputed_ = 0;
  std::atomic<bool> is_failed_ = false;
  std::mutex mutex_;
  std::queue<Entry*> to_compute_;  // under the mutex
  // All below belongs to the thread in advance().
  std::deque<Entry> under_way_;
  bool is_none_for_now_ = false;
  std::exception_ptr error_, error_of_next_;  // of a task, which comes first; of next()
  tbb::task_group group_;
};

// A heap of its own for each thread would keep what its largest visit took, whatever the others
// need by then: with eight threads twice the cap was measured. One heap costs no time that shows,
// for visits ask for few and large blocks.
void share_one_heap() { mallopt(M_ARENA_MAX, 1); }

}  // namespace

struct Workers::Impl {
  explicit Impl(int num_threads)
      : parallelism(tbb::global_control::max_allowed_parallelism,
                    static_cast<std::size_t>(num_threads)),
        stacks(tbb::global_control::thread_stack_size, kStackBytes),
        arena(num_threads) {
    if (num_threads > 1) share_one_heap();
  }

  static constexpr std::size_t kStackBytes = std::size_t{2} << 20;
  tbb::global_control parallelism, stacks;
  tbb::task_arena arena;
};

Workers::Workers(int num_threads) : impl_(std::make_unique<Impl>(num_threads)) {
  assert(num_threads >= 1);
}
Workers::~Workers() = default;

int Workers::num_threads() const { return impl_->arena.max_concurrency(); }

void Workers::run_in_order(const NextTask& next) {
  impl_->arena.execute([&] { OrderedRun(num_threads(), next).run(); });
}

int num_usable_threads() { return tbb::info::default_concurrency(); }

}  // namespace locvol
