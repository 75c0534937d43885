#include "engine/run_phases.h"

#include <cstdint>
#include <utility>
#include <vector>

#include "engine/plan/phases.h"
#include "engine/ranks/rank_crew.h"
#include "engine/run/crew.h"
#include "engine/stages/stages.h"
#include "octree/stop.h"

namespace locvol {

class RunPhases::Impl {
 public:
  Impl(Store& store, const MemoryPlan& plan, int num_threads, const TellProgress& on_progress,
       const StopSource& stop, const WorkClock& clock, Exchange& exchange, bool is_behind)
      : work_(store, plan, num_threads, on_progress, stop, clock),
        crew_(work_.state().ranks().is_rank()
                  ? std::unique_ptr<Crew>(std::make_unique<RankCrew>(work_, exchange, is_behind))
                  : std::make_unique<OneProcess>(work_)),
        tools_{work_.state(), work_.model(),     work_.budget(),
               work_.stop(),  crew_->exchange(), exchange} {}

  void share_knowledge() {
    const RunRecord& run = work_.state().run();
    for (Phase phase = next_phase(run, Phase::kIngest); phase != Phase::kDone;
         phase = next_phase(run, phase)) {
      auto stage = stage_in(phase, tools_);
      if (!stage->has_shared_knowledge()) continue;
      if (smallest(tools_.outside_supersteps, standing(phase, *stage)) != kAtStage) continue;
      stage->share_knowledge();
      if (phase == run.phase) stage_ = std::move(stage);
    }
  }

  void run(Phase until, const std::function<void(const RunRecord&)>& on_sizes) try {
    const RunRecord& run = work_.state().run();
    while (comes_before(run.phase, until)) {
      const bool had_sizes = are_sizes_known(run.phase);
      run_stage();
      if (!had_sizes && are_sizes_known(run.phase)) on_sizes(run);
    }
  } catch (const Stopped&) {
    work_.commit();
    throw;
  }

  double cpu_of_visits() const { return crew_->cpu_of_visits(); }

 private:
  void run_stage() {
    if (!stage_) stage_ = stage_in(work_.state().run().phase, tools_);
    std::uint32_t step = 0;
    const auto take = [&](const std::vector<LeafStage::Step>& steps, bool is_before_visits) {
      for (const LeafStage::Step& do_round : steps)
        if (crew_->is_due(step++, is_before_visits))
          while (crew_->end_round(do_round())) continue;
    };
    take(stage_->steps_before(), true);
    const std::vector<LeafStage::Step> after = stage_->steps_after();
    if (LeafVisits* const visits = stage_->visits(); visits && crew_->is_due(step++, false)) {
      stage_->share_knowledge();
      crew_->visit(*visits);
      if (!after.empty()) crew_->end_round(false);
    }
    take(after, false);
    const Phase next = stage_->end();
    stage_.reset();
    crew_->end_phase(next);
  }

  // Of one rank against a stage's visits.
  static constexpr std::uint64_t kBeforeStage = 0, kAtStage = 1, kPastStage = 2;
  std::uint64_t standing(Phase phase, LeafStage& stage) {
    const Phase now = work_.state().run().phase;
    if (now != phase) return comes_before(now, phase) ? kBeforeStage : kPastStage;
    const auto num_before = static_cast<std::uint32_t>(stage.steps_before().size());
    return num_before > 0 && crew_->is_due(num_before - 1, true) ? kBeforeStage : kAtStage;
  }

  RunWork work_;
  std::unique_ptr<Crew> crew_;
  StageTools tools_;
  std::unique_ptr<LeafStage> stage_;  // of the phase at hand, once it has begun
};

RunPhases::RunPhases(Store& store, const MemoryPlan& plan, int num_threads,
                     const TellProgress& on_progress, const StopSource& stop,
                     const WorkClock& clock, Exchange& exchange, bool is_behind)
    : impl_(std::make_unique<Impl>(store, plan, num_threads, on_progress, stop, clock, exchange,
                                   is_behind)) {}
RunPhases::~RunPhases() = default;

void RunPhases::share_knowledge() { impl_->share_knowledge(); }

void RunPhases::run(Phase until, const std::function<void(const RunRecord&)>& on_sizes) {
  impl_->run(until, on_sizes);
}

double RunPhases::cpu_of_visits() const { return impl_->cpu_of_visits(); }

}  // namespace locvol
