#include "engine/run/visit_pipeline.h"

#include <algorithm>
#include <deque>
#include <memory>
#include <optional>
#include <stdexcept>
#include <utility>

#include "engine/run/visit_error.h"
#include "engine/shared/leaf_name.h"
#include "octree/stop.h"

namespace locvol {
namespace {

// Runs `action`; its errors get the leaf's name.
template <class Action>
auto named(MortonKey leaf, const Action& action) {
  try {
    return action();
  } catch (const RefineError& e) {
    throw RefineError(leaf_name(leaf) + ": " + e.what());
  } catch (const OverBudget& e) {
    throw OverBudget(leaf_name(leaf) + ": " + e.what(), e.bytes());
  }
}

}  // namespace

// One epoch's visits, or one color's.
class VisitPipeline::Run {
 public:
  Run(VisitPipeline& pipeline, std::vector<QueueEntry> leaves, LeafVisits& visits, const Take& take,
      const IsStopped& is_stopped)
      : state_(pipeline.state_),
        budget_(pipeline.budget_),
        visits_(visits),
        take_(take),
        is_stopped_(is_stopped),
        waiting_(std::move(leaves)) {}

  // One visit among acute folds may take as long as fifty others. They have memory reserved.
  void run(Workers& workers) {
    constexpr int kMaxVisitsPerThread = 32;
    workers.run_in_order([this] { return next(); }, kMaxVisitsPerThread);
  }

 private:
  class VisitTask : public Task {
   public:
    VisitTask(Run& run, MortonKey leaf, std::unique_ptr<Visit> visit,
              MemoryBudget::Reservation memory)
        : run_(run), leaf_(leaf), memory_(std::move(memory)), visit_(std::move(visit)) {}
    void compute() override try { visit_->compute(); } catch (const RefineError& e) {
      fail(e);
    } catch (const std::logic_error& e) {  // of CGAL, or of the standard library
      fail(e);
    }
    void apply() override {
      named(leaf_, [&] { run_.take_(leaf_, *visit_); });
      run_.under_way_.pop_front();
    }

   private:
    [[noreturn]] void fail(const std::exception& e) const {
      throw VisitError(leaf_, leaf_name(leaf_) + ": " + e.what());
    }

    Run& run_;
    MortonKey leaf_;
    MemoryBudget::Reservation memory_;
    std::unique_ptr<Visit> visit_;  // given up before the memory that is reserved for it
  };

  // Null: none is left, or the next one has to wait for others.
  std::unique_ptr<Task> next() {
    if (num_begun_ == waiting_.size() || !may_load(waiting_[num_begun_])) return nullptr;
    if (is_stopped_()) throw Stopped();
    return named(waiting_[num_begun_].leaf, [&] { return begin(waiting_[num_begun_]); });
  }

  bool may_load(const QueueEntry& next) const {
    const auto distance = [&](MortonKey leaf) { return visits_.conflict_distance(leaf); };
    return std::ranges::all_of(under_way_, [&](const QueueEntry& other) {
      return state_.queue().are_independent(next, other, distance);
    });
  }

  std::unique_ptr<Task> begin(const QueueEntry& place) {
    if (!under_way_.empty() && budget_.free_bytes() < bytes_wanted_) return nullptr;
    auto visit = visits_.load(place.leaf);
    bytes_wanted_ = 0;
    auto memory = reserve(visit->bytes());
    if (!memory) return nullptr;
    ++num_begun_;
    under_way_.push_back(place);
    return std::make_unique<VisitTask>(*this, place.leaf, std::move(visit), std::move(*memory));
  }

  // The cache of records gives way. Nothing: there is not enough until others are over.
  std::optional<MemoryBudget::Reservation> reserve(std::uint64_t bytes) {
    std::optional<MemoryBudget::Reservation> memory;
    if (under_way_.empty()) {
      memory = budget_.reserve(bytes);
    } else {
      bytes_wanted_ = bytes + kLeastCacheBytes;
      if (budget_.free_bytes() >= bytes_wanted_) memory = budget_.reserve(bytes);
    }
    state_.leaves().set_max_bytes(std::min(budget_.free_bytes(), kMostCacheBytes));
    state_.leaves().trim();
    return memory;
  }

  RunState& state_;
  MemoryBudget& budget_;
  LeafVisits& visits_;
  const Take& take_;
  const IsStopped& is_stopped_;
  const std::vector<QueueEntry> waiting_;
  std::size_t num_begun_ = 0;  // of those waiting
  std::deque<QueueEntry> under_way_;
  std::uint64_t bytes_wanted_ = 0;
};

void VisitPipeline::visit(std::vector<QueueEntry> leaves, LeafVisits& visits, const Take& take,
                          const IsStopped& is_stopped) {
  Run(*this, std::move(leaves), visits, take, is_stopped).run(workers_);
}

}  // namespace locvol
