// Workers: threads that share out work whose result must not depend on them.
//
// They are plain threads, not oneTBB's: that ends the process when the system refuses a thread, and
// takes a mebibyte and more before any work is done.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <type_traits>
#include <utility>

namespace locvol {

// One step of a job that Workers::run_in_order does.
class Task {
 public:
  virtual ~Task() = default;
  virtual void compute() = 0;  // by any thread, beside other tasks
  virtual void apply() = 0;    // alone, and in the order of the tasks
};

// Threads: used by one at a time, and not from within a task; what it is given is called from any.
class Workers {
 public:
  // `num_threads` counts the caller's, so that 1 starts none. It works with fewer if the system
  // refuses some.
  explicit Workers(int num_threads);
  ~Workers();
  Workers(const Workers&) = delete;
  Workers& operator=(const Workers&) = delete;

  int num_threads() const;
  // Does all tasks that `next` gives. It is never called while a task is being applied, so what
  // they share needs no lock. Null: there is none for now, and `next` is asked again when another
  // task has been applied; with none under way, that was all.
  // With one thread, each task is computed and applied before `next` is asked again; with n, up to
  // n + 1 wait to be computed and max_tasks_per_thread n are under way, most of them computed and
  // behind one that takes long.
  // Throws what the first of the tasks, or `next` after them, throws; those before it have been
  // applied, those after it are dropped. Stopped knows no order: once any throws it, no task is
  // applied or begun any more, and those under way are waited for, which are to notice as well.
  void run_in_order(const std::function<std::unique_ptr<Task>()>& next,
                    int max_tasks_per_thread = 4);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Hardware threads that this process may use.
int num_usable_threads();

// Does apply(item, compute(item, load(item))) for each item. Loading and applying are done by one
// thread at a time, and in order.
template <class Item, class Load, class Compute, class Apply>
void for_each_in_order(Workers& workers, std::span<const Item> items, const Load& load,
                       const Compute& compute, const Apply& apply) {
  using Loaded = std::invoke_result_t<Load, const Item&>;
  using Result = std::invoke_result_t<Compute, const Item&, Loaded>;
  struct ItemTask : Task {
    ItemTask(const Item& the_item, const Load& load, const Compute& compute, const Apply& apply)
        : item(the_item), compute_(compute), apply_(apply), loaded(load(item)) {}
    void compute() override { result = compute_(item, *std::exchange(loaded, std::nullopt)); }
    void apply() override { apply_(item, *result); }

    const Item& item;
    const Compute& compute_;
    const Apply& apply_;
    std::optional<Loaded> loaded;
    std::optional<Result> result;
  };
  auto item = items.begin();
  workers.run_in_order([&]() -> std::unique_ptr<Task> {
    if (item == items.end()) return nullptr;
    return std::make_unique<ItemTask>(*item++, load, compute, apply);
  });
}

}  // namespace locvol
