// VisitPipeline makes the visits of an epoch on several threads, with the result of making them one
// after another, in queue order.
//
// A visit is loaded from the run, computed from that alone, and applied to the run. The first and
// the last are done by one thread at a time and in queue order, so that new points get the same
// ids; meanwhile other threads compute. A leaf is loaded once all visits are applied that may have
// written what it reads: leaves of one color never wait for each other, and of the next color's
// leaves most need not wait either.
//
// Memory: a visit reserves what it takes before it is computed. Beside others, it leaves the cache
// of records its least; the first in the order may take all that there is.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <type_traits>
#include <utility>
#include <vector>

#include "engine/run/run_state.h"
#include "engine/shared/memory_budget.h"
#include "engine/shared/workers.h"

namespace locvol {

// A visit that has been loaded.
class Visit {
 public:
  virtual ~Visit() = default;
  virtual std::uint64_t bytes() const = 0;  // that it takes at its peak
  virtual void compute() = 0;               // once
  virtual void apply() = 0;                 // after compute()
};

// The visit made of `apply(compute(loaded))`.
template <class Loaded, class Compute, class Apply>
std::unique_ptr<Visit> make_visit(Loaded loaded, const Compute& compute, const Apply& apply) {
  using Result = std::invoke_result_t<Compute, Loaded&>;
  struct Made : Visit {
    Made(Loaded the_loaded, const Compute& the_compute, const Apply& the_apply)
        : loaded(std::move(the_loaded)), compute_(the_compute), apply_(the_apply) {}
    std::uint64_t bytes() const override { return loaded->bytes; }
    void compute() override {
      result = compute_(*loaded);
      loaded.reset();
    }
    void apply() override { apply_(*result); }

    std::optional<Loaded> loaded;
    Compute compute_;
    std::optional<Result> result;
    Apply apply_;
  };
  return std::make_unique<Made>(std::move(loaded), compute, apply);
}

class VisitPipeline {
 public:
  using Load = std::function<std::unique_ptr<Visit>(MortonKey leaf)>;
  using IsStopped = std::function<bool()>;

  VisitPipeline(RunState& state, MemoryBudget& budget, int num_threads)
      : state_(state), budget_(budget), workers_(num_threads) {}

  // Visits these leaves, which wait in the open epoch, in queue order. Throws Stopped before the
  // last of them if that is asked for: before a visit begins, or in its middle by what was loaded
  // for it. What was not applied by then is dropped. Throws the first error in queue order, with
  // all visits before it applied: VisitError, OverBudget with the leaf's name, and what applying a
  // visit throws.
  void visit(std::vector<QueueEntry> leaves, const Load& load, const IsStopped& is_stopped);

 private:
  class Run;

  RunState& state_;
  MemoryBudget& budget_;
  Workers workers_;
};

}  // namespace locvol
