#include "engine/run_phases.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <ctime>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "engine/exchange/recorded_exchange.h"
#include "engine/plan/octree_plan.h"
#include "engine/ranks/color_results.h"
#include "engine/ranks/move_leaves.h"
#include "engine/ranks/rank_sizes.h"
#include "engine/ranks/rank_visits.h"
#include "engine/ranks/visit_results.h"
#include "engine/run/apply_visit.h"
#include "engine/run/first_points.h"
#include "engine/run/leaf_loader.h"
#include "engine/run/mend_leaf.h"
#include "engine/run/run_state.h"
#include "engine/run/visit_error.h"
#include "engine/run/visit_pipeline.h"
#include "engine/shared/input_error.h"
#include "octree/stop.h"
#include "refine/cover_leaf.h"
#include "refine/refine_leaf.h"
#include "refine/size_leaf.h"

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

// The user's wish to stop, where the run may.
class AllowedStop : public StopToken {
 public:
  AllowedStop(const StopSource& wish, bool is_allowed) : wish_(wish), is_allowed_(is_allowed) {}
  bool is_stopped() const override { return is_allowed_ && wish_.is_stopped(); }
  bool ask() const { return is_allowed_ && wish_.ask(); }
  void allow(bool is_allowed) { is_allowed_ = is_allowed; }

 private:
  const StopSource& wish_;
  std::atomic<bool> is_allowed_;
};

}  // namespace

std::uint32_t first_stage_with_surface(const RunRecord& run) {
  return run.parameters.has_image() ? 1 : 0;
}

class RunPhases::Impl {
 public:
  Impl(Store& store, const MemoryPlan& plan, int num_threads, const TellProgress& on_progress,
       const StopSource& stop, const WorkClock& clock, Exchange* exchange, bool is_behind)
      : on_progress_(on_progress),
        stop_(stop, exchange == nullptr),
        plan_(plan),
        budget_(plan.heap()),
        state_(store, budget_.free_bytes(), plan.max_unwritten()),
        loader_(state_, budget_, &stop_),
        num_threads_(plan.num_threads(num_threads > 0 ? num_threads : num_usable_threads())),
        visits_(state_, budget_, num_threads_),
        clock_(clock),
        timeline_(store.snapshot().timeline(), clock.started()),
        is_behind_(is_behind) {
    if (exchange != nullptr) ranks_.emplace(state_, exchange_.emplace(*exchange));
    whole_exchange_ = exchange;
    note_sample(timeline_.is_empty() ? Phase::kIngest : state_.run().phase);
  }

  void find_far_surface() {
    far_.emplace(loader_.far_surface(&stop_));
    if (ranks_) share_far_surface(state_, loader_, *far_, *whole_exchange_);
    budget_.keep(far_->bytes());
  }

  void run(Phase until, const std::function<void(const RunRecord&)>& on_sizes) try {
    if (state_.run().phase == Phase::kMeasure) measure_surface();
    if (state_.run().phase == Phase::kSize) {
      measure_sizes();
      on_sizes(state_.run());
    }
    const auto is_next = [&](Phase phase) { return state_.run().phase == phase && phase < until; };
    if (is_next(Phase::kScatter)) scatter();
    if (is_next(Phase::kCover)) cover();
    if (is_next(Phase::kFill)) fill();
    if (is_next(Phase::kRefine)) refine();
    if (is_next(Phase::kMend)) mend();
  } catch (const Stopped&) {
    commit();
    throw;
  }

  double cpu_of_visits() const { return cpu_of_visits_; }

 private:
  // Load, compute, commit.
  void refine() {
    visit_all([this](MortonKey leaf) { return loader_.load(leaf); },
              [this](LoadedLeaf& loaded) {
                return refine_leaf(std::move(loaded.input), {.stop = &stop_}, loader_.whole());
              },
              [this](MortonKey leaf, const LeafDelta& delta) {
                apply_visit(state_, loader_, leaf, delta);
              });
    const std::uint64_t num_unresolved = state_.run().counts.num_unresolved;
    const bool is_whole = exchange_ ? !any(*exchange_, num_unresolved > 0) : num_unresolved == 0;
    if (!is_whole) enqueue_for_mending(state_);
    if (!is_whole && exchange_) share_cells(state_, *exchange_);
    end_phase(is_whole ? Phase::kDone : Phase::kMend);
  }

  void mend() {
    visit_all(
        [this](MortonKey leaf) { return load_mend(state_, leaf); },
        [](LoadedMend& loaded) { return mended_cells(loaded); },
        [this](MortonKey leaf, const MendedCells& cells) { apply_mend(state_, leaf, cells); });
    if (exchange_)
      merge_sites_in_turn(state_, *exchange_);
    else
      merge_sites(state_);
    end_phase(Phase::kDone);
  }

  // What sizes the surface asks for, in each leaf.
  void measure_surface() {
    split_rich_leaves();
    visit_first_leaves(
        first_epoch() - 4, [this](MortonKey leaf) { return loader_.load_measure(leaf); },
        [this](LoadedMeasure& loaded) { return measure_leaf(std::move(loaded.input), &stop_); },
        [this](MortonKey leaf, const std::vector<SizedNode>& nodes) {
          apply_measure(state_, leaf, nodes);
        });
    end_phase(Phase::kSize);
  }

  // What the size is in each leaf that the domain may meet, where it is not the same everywhere.
  void measure_sizes() {
    const std::uint32_t first = first_stage_with_surface(state_.run());
    if (state_.run().parameters.has_image()) split_rich_leaves();
    if (!far_) find_far_surface();
    if (!ranks_ || state_.rank().stage == first) {
      visit_first_leaves(
          first_epoch() - 3, [&](MortonKey leaf) { return loader_.load_size(leaf, *far_); },
          [&](LoadedSize& loaded) { return size_leaf(std::move(loaded.input), *far_, &stop_); },
          [this](MortonKey leaf, const std::vector<SizeCube>& cubes) {
            apply_sizes(state_, leaf, cubes);
          });
      if (ranks_) {
        state_.end_stage();
        end_superstep();
      }
    }
    far_.reset();
    split_leaves(state_.octree().leaves(), first + 1,
                 [this](MortonKey leaf) { return is_to_be_full(state_, leaf); });
    SizeTotals totals;
    for (const MortonKey leaf : state_.octree().leaves()) {
      throw_if_stopped(&stop_);
      if (!state_.is_own(leaf)) continue;
      totals += size_totals(state_, leaf);
      if (!ranks_) find_reached_size(leaf);
    }
    state_.note_sizes(exchange_ ? total_sizes(totals, *exchange_) : totals);
    end_phase(Phase::kCover);
  }

  void find_reached_size(MortonKey leaf) {
    state_.find_reached_size(leaf);
    if (state_.is_commit_due()) commit();
  }

  // Of several ranks, once sizes are known all around: so far copies reached less far.
  void find_reached_sizes() {
    if (!ranks_ || state_.is_uniform() || state_.rank().stage > 0) return;
    for (const MortonKey leaf : state_.octree().leaves())
      if (state_.is_own(leaf)) find_reached_size(leaf);
    state_.end_stage();
    end_superstep();
  }

  // Each leaf that the domain may meet gets its share of a point set that covers it: first what
  // does not depend on its neighbors' share. Covered leaves wait for the next epoch.
  void cover() {
    find_reached_sizes();
    visit_first_leaves(
        first_epoch() - 2, [this](MortonKey leaf) { return loader_.load_cover(leaf); },
        [this](LoadedCover& loaded) { return cover_leaf(std::move(loaded.input), &stop_); },
        [this](MortonKey leaf, const CoverPoints& points) { apply_cover(state_, leaf, points); });
    end_phase(Phase::kFill);
  }

  // The first that refines: after measuring, sizes, covering, filling.
  std::uint32_t first_epoch() const {
    if (!state_.is_cover()) return 1;
    return state_.is_uniform() ? 2 : state_.run().parameters.is_measured() ? 4 : 3;
  }

  // That ask for so many sizes that a visit would be too large.
  void split_rich_leaves() {
    if (ranks_ ? state_.rank().stage > 0 : state_.is_epoch_open()) return;
    double num_leaves = 0;
    std::vector<MortonKey> rich;
    for (const MortonKey leaf : state_.octree().leaves()) {
      throw_if_stopped(&stop_);
      if (!state_.is_own(leaf)) continue;
      const double share = loader_.share_of_pieces(leaf);
      if (share > 1) rich.push_back(leaf);
      num_leaves += share;
      state_.leaves().trim();
    }
    require_few_leaves(num_leaves);
    split_leaves(rich, 0, [this](MortonKey leaf) {
      return leaf.level() < kMaxCubeLevel && loader_.share_of_pieces(leaf) > 1;
    });
  }

  // Those of the leaves that are the rank's own, and their parts, that are too much, before they
  // have points. Of several ranks, all split what one does, as the phase's stage `stage`.
  template <class IsTooMuch>
  void split_leaves(std::span<const MortonKey> leaves, std::uint32_t stage,
                    const IsTooMuch& is_too_much) {
    if (ranks_ && state_.rank().stage > stage) return;
    std::vector<MortonKey> waiting(leaves.rbegin(), leaves.rend());
    do {
      std::vector<SplitLeaf> split;
      while (!waiting.empty()) {
        throw_if_stopped(&stop_);
        const MortonKey leaf = waiting.back();
        waiting.pop_back();
        if (state_.is_own(leaf) && is_too_much(leaf)) {
          require_few_leaves(static_cast<double>(state_.octree().size()));
          if (ranks_) split.push_back({leaf, state_.others_holding(leaf)});
          split_empty_leaf(state_, leaf);
          for (int octant = 7; octant >= 0; --octant) waiting.push_back(leaf.child(octant));
        }
        state_.leaves().trim();
        if (!state_.is_commit_due()) continue;
        if (ranks_) break;
        commit();
      }
      if (ranks_) share_splits(state_, split, *exchange_);
    } while (ranks_ && end_round_of_splits(!waiting.empty()));
  }

  // Goes on if any rank has more to split.
  bool end_round_of_splits(bool has_more) {
    const bool goes_on = any(*exchange_, has_more);
    if (!goes_on) state_.end_stage();
    end_superstep();
    return goes_on;
  }

  void require_few_leaves(double num_leaves) const {
    if (num_leaves < kMaxStartLeaves) return;
    const RunParameters& p = state_.run().parameters;
    throw InputError(fmt::format(
        "{}: the sizes that the surface asks for, from {} on, with {} points to a leaf need more "
        "than {} leaves: ask for less, give a larger --min-size, or a larger leaf capacity",
        state_.run().surface.file, p.sizes().least, p.leaf_capacity, kMaxStartLeaves));
  }

  template <class Load, class Compute, class Apply>
  void visit_first_leaves(std::uint32_t epoch, const Load& load, const Compute& compute,
                          const Apply& apply) {
    if (ranks_) return visit_as_rank(epoch, load, compute, apply);
    if (state_.queue().num_in_epoch(epoch) > 0 && open_epoch()) visit_epoch(load, compute, apply);
  }

  // Then what does.
  void fill() {
    visit_all(
        [this](MortonKey leaf) { return loader_.load_fill(leaf); },
        [this](LoadedFill& loaded) { return fill_leaf(std::move(loaded.input), &stop_); },
        [this](MortonKey leaf, const FillPoints& points) { apply_fill(state_, leaf, points); });
    begin_refinement(&stop_);
  }

  // All or nothing: a second time, the same points would come again.
  void scatter() {
    const auto triangles = loader_.whole().surface->triangles();
    for (const Point& point : scatter_on_surface(triangles, state_.run().parameters.seed))
      loader_.note_inserted(state_.add_point(point, PointKind::kSurface));
    begin_refinement(nullptr);
  }

  // Epoch after epoch, until the queue is empty.
  template <class Load, class Compute, class Apply>
  void visit_all(const Load& load, const Compute& compute, const Apply& apply) {
    if (ranks_) return visit_as_rank(std::nullopt, load, compute, apply);
    while (open_epoch()) visit_epoch(load, compute, apply);
  }

  // False: no leaves wait.
  bool open_epoch() {
    if (state_.open_epoch(&stop_)) commit();
    return !state_.queue().is_empty();
  }

  // All leaves of the open epoch: apply(leaf, compute(load(leaf))).
  template <class Load, class Compute, class Apply>
  void visit_epoch(const Load& load, const Compute& compute, const Apply& apply) {
    visit(state_.queue().front_epoch(), load, compute, [&](MortonKey leaf, const auto& result) {
      state_.begin_ids(state_.run().next_point_id);
      apply(leaf, result);
      state_.end_ids();
      note_visit();
    });
  }

  // The rank's leaves, color after color, of one epoch or of all: what a color's visits find is
  // sent to whom it matters to, and then applied. Visits that matter to no other rank, and read
  // what none changes, are made while ranks wait for each other: of the color at hand the last few,
  // and of the next one.
  template <class Load, class Compute, class Apply>
  void visit_as_rank(std::optional<std::uint32_t> epoch, const Load& load, const Compute& compute,
                     const Apply& apply) {
    using Loaded = std::invoke_result_t<Load, MortonKey>;
    using Result = std::invoke_result_t<Compute, Loaded&>;
    std::unique_ptr<ColorResults> results, ahead;  // of the color at hand, and of the next own one
    const auto take_up = [&](const QueuePosition& color) {
      if (results) return;
      if (ahead && ahead->color() == color)
        results = std::move(ahead);
      else
        results = std::make_unique<ColorResults>(state_, *exchange_, color);
    };
    const auto find = [&](ColorResults& found, std::vector<QueueEntry> leaves) {
      const CpuClock cpu(cpu_of_visits_);
      visit(std::move(leaves), load, compute, [&](MortonKey leaf, const Result& result) {
        found.add(leaf, encode_result(result), [&] { return encode_for_others(state_, result); });
      });
    };
    const auto threads = static_cast<std::size_t>(num_threads_);
    const WorkWhileWaiting work(*exchange_, [&] {
      const bool is_ahead = !results || !results->has_own();
      if (is_ahead && !ahead && state_.is_epoch_open())
        ahead = std::make_unique<ColorResults>(state_, *exchange_, state_.queue().front());
      ColorResults* const found = (is_ahead ? ahead : results).get();
      if (found == nullptr) return false;
      std::vector<QueueEntry> leaves = found->far_from_others(threads);
      if (leaves.empty()) return false;
      find(*found, std::move(leaves));
      return true;
    });
    const auto find_results = [&] {
      find(*results, results->near_others());
      constexpr std::size_t kMeanwhile = 32;  // visits of a thread: some seconds at most
      std::vector<QueueEntry> far = results->far_from_others();
      far.resize(far.size() - std::min(far.size(), kMeanwhile * threads));
      find(*results, std::move(far));
    };
    // Of these words are none: when they are all there, a rank does it whether others have or not.
    // After an end, what was found is found again; all go on with that.
    const auto apply_all = [&] {
      if (!state_.rank().applied || !state_.rank().is_all_sent) return;
      take_up(*state_.rank().applied);
      find(*results, results->near_others());
      find(*results, results->far_from_others());
      results->apply_all([&](MortonKey leaf, std::string_view result) {
        apply(leaf, decode_result<Result>(result));
        note_visit();
      });
      results.reset();
      state_.end_applying();
      if (state_.is_commit_due()) commit();
    };
    using enum RankVisits::Step;
    for (;;) {
      apply_all();
      const auto next = ranks_->next();
      if (next.step == kNone) return;
      const QueuePosition& color = next.position;
      tell(ranks_->totals());
      if (epoch && next.step <= kVisit && color.epoch > *epoch) return;
      if (next.step == kOpen) {
        ranks_->open_epoch(color.epoch);
      } else if (next.step == kVisit) {
        take_up(color);
        stop_.allow(!is_behind_);
        bool is_stopped = stop_.ask();
        try {
          if (!is_stopped) find_results();
        } catch (const Stopped&) {
          is_stopped = true;
        }
        stop_.allow(false);  // all ranks stop here, or none
        if (!results->begin(next.first_own_id, next.end_id, is_stopped)) throw Stopped();
      } else {
        take_up(color);
        find(*results, results->near_others());
        results->send_more();
      }
      end_superstep();
    }
  }

  template <class Load, class Compute, class Take>
  void visit(std::vector<QueueEntry> leaves, const Load& load, const Compute& compute,
             const Take& take) try {
    const auto begin = [&](MortonKey leaf) {
      return make_visit(load(leaf), compute,
                        [&take, leaf](const auto& result) { take(leaf, result); });
    };
    visits_.visit(std::move(leaves), begin, [this] { return stop_.ask(); });
  } catch (const VisitError& e) {
    commit();  // so that the visit can be made again, as it was
    throw VisitError(e.leaf(), std::string(e.what()) + "; this is a bug of locvol. The store " +
                                   state_.store().directory().string() +
                                   " holds all that was done before");
  } catch (const OverBudget& e) {
    commit();
    throw OverBudget(std::string(e.what()) + "; go on with a larger one, at least " +
                         memory_text(plan_.cap_with_heap(e.bytes())) +
                         ": nothing that was done is lost",
                     e.bytes());
  }

  void note_visit() {
    state_.note_visit();
    if (state_.is_commit_due())
      commit();
    else
      tell_progress();
  }

  void begin_refinement(const StopToken* stop) {
    enqueue_for_refinement(state_, stop);
    if (ranks_ && is_balanced()) state_.note_stay(Phase::kRefine);
    end_phase(Phase::kRefine);
  }

  // Or does it pay to move leaves?
  bool is_balanced() {
    constexpr double kBalanced = 1.05;
    double cost = 0;
    for (const MortonKey leaf : state_.octree().leaves())
      if (state_.is_own(leaf)) cost += predicted_cost(state_.leaves().info(leaf));
    return imbalance(cost, *exchange_) <= kBalanced;
  }

  void end_phase(Phase next) {
    note_sample(state_.run().phase);
    state_.begin_phase(next);
    if (ranks_)
      end_superstep();
    else
      commit();
  }

  // With what was said during it.
  void end_superstep() {
    state_.end_superstep(exchange_->take());
    commit();
    is_behind_ = false;
  }

  void commit() {
    note_sample(state_.run().phase);
    state_.commit(memory_use(), &timeline_.record());
    tell_progress();
  }

  // Of several ranks, all tell what all have, between two supersteps.
  void tell_progress() const {
    if (!ranks_)
      tell({.counts = state_.run().counts,
            .num_leaves = state_.octree().size(),
            .num_queued = state_.queue().size(),
            .num_in_epoch = state_.queue().num_in_epoch(state_.run().epoch)});
  }

  void tell(const RankVisits::Totals& all) const {
    if (on_progress_)
      on_progress_({.phase = state_.run().phase,
                    .counts = all.counts,
                    .num_leaves = all.num_leaves,
                    .num_queued = all.num_queued,
                    .num_in_epoch = all.num_in_epoch,
                    .epoch = state_.run().epoch,
                    .first_epoch = first_epoch()});
  }

  // `phase`: what took the time since the last sample.
  void note_sample(Phase phase) {
    const RunRecord& run = state_.run();
    timeline_.add({.num_threads = static_cast<std::uint64_t>(num_threads_),
                   .memory_cap = plan_.cap(),
                   .resident = resident_memory(),
                   .phase = phase,
                   .epoch = run.epoch,
                   .num_leaves = state_.octree().size(),
                   .num_queued = state_.queue().size(),
                   .counts = run.counts},
                  clock_.milliseconds());
  }

  MemoryRecord memory_use() const {
    MemoryRecord memory = plan_.record();
    memory.visits = budget_.largest_reservation();
    memory.cache = plan_.heap() - memory.visits;
    memory.peak_resident = peak_resident_memory();
    return memory;
  }

  const TellProgress& on_progress_;
  AllowedStop stop_;
  const MemoryPlan& plan_;
  MemoryBudget budget_;
  RunState state_;
  LeafLoader loader_;
  int num_threads_;
  VisitPipeline visits_;
  WorkClock clock_;
  RunTimeline timeline_;
  double cpu_of_visits_ = 0;
  // Absent: one process has all of the run.
  Exchange* whole_exchange_ = nullptr;
  std::optional<RecordedExchange> exchange_;  // of what is said in supersteps
  std::optional<RankVisits> ranks_;
  // Until the first commit: others say what they said before, and cannot hear of a stop.
  bool is_behind_;
  std::optional<FarSurface> far_;  // while sizes are found
};

RunPhases::RunPhases(Store& store, const MemoryPlan& plan, int num_threads,
                     const TellProgress& on_progress, const StopSource& stop,
                     const WorkClock& clock, Exchange* exchange, bool is_behind)
    : impl_(std::make_unique<Impl>(store, plan, num_threads, on_progress, stop, clock, exchange,
                                   is_behind)) {}
RunPhases::~RunPhases() = default;

void RunPhases::find_far_surface() { impl_->find_far_surface(); }

void RunPhases::run(Phase until, const std::function<void(const RunRecord&)>& on_sizes) {
  impl_->run(until, on_sizes);
}

double RunPhases::cpu_of_visits() const { return impl_->cpu_of_visits(); }

}  // namespace locvol
