#include "engine/ranks/rank_crew.h"

#include <algorithm>
#include <ctime>
#include <memory>
#include <utility>
#include <vector>

#include "engine/plan/phases.h"
#include "engine/ranks/color_results.h"
#include "engine/ranks/move_leaves.h"
#include "octree/stop.h"

namespace locvol {
namespace {

// Adds what the process works in its life to a number of seconds.
class CpuClock {
 public:
  explicit CpuClock(double& seconds) : seconds_(seconds) {}
  ~CpuClock() { seconds_ += static_cast<double>(std::clock() - start_) / CLOCKS_PER_SEC; }

 private:
  double& seconds_;
  const std::clock_t start_ = std::clock();
};

}  // namespace

// The visits of one phase. Those that matter to no other rank, and read what none changes, are made
// while ranks wait for each other: of the color at hand the last few, and of the next one.
class RankCrew::Colors {
 public:
  Colors(RankCrew& crew, LeafVisits& visits)
      : crew_(crew),
        work_(crew.work_),
        state_(crew.work_.state()),
        visits_(visits),
        num_threads_(static_cast<std::size_t>(crew.work_.num_threads())),
        while_waiting_(crew.exchange_, [this] { return find_some(); }) {}

  void visit() {
    using enum RankVisits::Step;
    const RunRecord& run = state_.run();
    for (;;) {
      apply_all();
      const auto next = crew_.turns_.next();
      if (next.step == kNone) return;
      const QueuePosition& color = next.position;
      const auto& all = crew_.turns_.totals();
      work_.tell(all.counts, all.num_leaves, all.num_queued, all.num_in_epoch);
      if (visits_.is_once() && next.step <= kVisit && color.epoch > first_epoch(run, run.phase))
        return;
      if (next.step == kOpen) {
        crew_.turns_.open_epoch(color.epoch, visits_);
      } else if (next.step == kVisit) {
        take_up(color);
        const bool is_stopped = find_most();
        // All ranks stop here, or none.
        if (!at_hand_->begin(next.first_own_id, next.end_id, is_stopped)) throw Stopped();
      } else {
        take_up(color);
        find(*at_hand_, at_hand_->near_others());
        at_hand_->send_more();
      }
      crew_.end_superstep();
    }
  }

 private:
  void take_up(const QueuePosition& color) {
    if (at_hand_) return;
    if (ahead_ && ahead_->color() == color)
      at_hand_ = std::move(ahead_);
    else
      at_hand_ = results_of(color);
  }

  std::unique_ptr<ColorResults> results_of(const QueuePosition& color) {
    return std::make_unique<ColorResults>(state_, crew_.exchange_, color, visits_.changes_others());
  }

  void find(ColorResults& results, std::vector<QueueEntry> leaves) {
    const CpuClock cpu(crew_.cpu_of_visits_);
    work_.visit(std::move(leaves), visits_, [&](MortonKey leaf, const Visit& visit) {
      results.add(leaf, visit.result(), [&] { return visit.result_for_others(); });
    });
  }

  // False: there is nothing to be found meanwhile.
  bool find_some() {
    const bool is_ahead = !at_hand_ || !at_hand_->has_own();
    if (is_ahead && !ahead_ && state_.queue().is_epoch_open())
      ahead_ = results_of(state_.queue().entries().front());
    ColorResults* const results = (is_ahead ? ahead_ : at_hand_).get();
    if (results == nullptr) return false;
    std::vector<QueueEntry> leaves = results->far_from_others(num_threads_);
    if (leaves.empty()) return false;
    find(*results, std::move(leaves));
    return true;
  }

  // All that others wait for, and of the rest what is too much to be found meanwhile. True: the run
  // is to stop.
  bool find_most() {
    constexpr std::size_t kMeanwhile = 32;  // visits of a thread: some seconds at most
    work_.stop().allow(!crew_.is_behind_);
    bool is_stopped = work_.stop().ask();
    try {
      if (!is_stopped) {
        find(*at_hand_, at_hand_->near_others());
        std::vector<QueueEntry> far = at_hand_->far_from_others();
        far.resize(far.size() - std::min(far.size(), kMeanwhile * num_threads_));
        find(*at_hand_, std::move(far));
      }
    } catch (const Stopped&) {
      is_stopped = true;
    }
    work_.stop().allow(false);
    return is_stopped;
  }

  // Of these words are none: when they are all there, a rank does it whether others have or not.
  // After an end, what was found is found again; all go on with that.
  void apply_all() {
    RunRanks& ranks = state_.ranks();
    if (!ranks.record().applied || !ranks.record().is_all_sent) return;
    take_up(*ranks.record().applied);
    find(*at_hand_, at_hand_->near_others());
    find(*at_hand_, at_hand_->far_from_others());
    at_hand_->apply_all([&](MortonKey leaf, std::string_view result) {
      visits_.apply(leaf, result);
      work_.note_visit();
    });
    at_hand_.reset();
    state_.points().end_ids();
    ranks.end_applying();
    work_.commit_if_due();
  }

  RankCrew& crew_;
  RunWork& work_;
  RunState& state_;
  LeafVisits& visits_;
  std::size_t num_threads_;
  std::unique_ptr<ColorResults> at_hand_, ahead_;  // of the color at hand, and of the next own one
  WorkWhileWaiting while_waiting_;
};

bool RankCrew::is_due(std::uint32_t step, bool) {
  return work_.state().ranks().record().stage <= step;
}

void RankCrew::visit(LeafVisits& visits) { Colors(*this, visits).visit(); }

bool RankCrew::end_round(bool has_more) {
  const bool goes_on = any(exchange_, has_more);
  if (!goes_on) work_.state().ranks().end_step();
  end_superstep();
  return goes_on;
}

void RankCrew::end_phase(Phase next) {
  if (facts_of(next).leaves_move == LeavesMove::kUnlessBalanced && is_balanced())
    work_.state().ranks().note_stay(next);
  work_.begin_phase(next);
  end_superstep();
}

// Would it hardly pay to move leaves?
bool RankCrew::is_balanced() {
  constexpr double kBalanced = 1.05;
  const RunState& state = work_.state();
  double cost = 0;
  for (const MortonKey leaf : state.octree().leaves())
    if (state.is_own(leaf)) cost += predicted_cost(state.leaves().info(leaf));
  return imbalance(cost, exchange_) <= kBalanced;
}

// With what was said during it.
void RankCrew::end_superstep() {
  work_.state().ranks().end_superstep(exchange_.take());
  work_.commit();
  is_behind_ = false;
}

}  // namespace locvol
