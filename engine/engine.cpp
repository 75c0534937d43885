#include "engine/engine.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <ctime>
#include <fstream>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "engine/exchange/exchange.h"
#include "engine/exchange/recorded_exchange.h"
#include "engine/ingest/image_sizes.h"
#include "engine/ingest/ingest.h"
#include "engine/plan/disk_room.h"
#include "engine/plan/octree_plan.h"
#include "engine/plan/run_setup.h"
#include "engine/ranks/color_results.h"
#include "engine/ranks/counts_of_ranks.h"
#include "engine/ranks/ingest_by_ranks.h"
#include "engine/ranks/move_leaves.h"
#include "engine/ranks/rank_sizes.h"
#include "engine/ranks/rank_store.h"
#include "engine/ranks/rank_visits.h"
#include "engine/ranks/visit_results.h"
#include "engine/run/apply_visit.h"
#include "engine/run/first_points.h"
#include "engine/run/leaf_loader.h"
#include "engine/run/mend_leaf.h"
#include "engine/run/run_state.h"
#include "engine/run/run_timeline.h"
#include "engine/run/visit_error.h"
#include "engine/run/visit_pipeline.h"
#include "engine/shared/input_error.h"
#include "engine/shared/memory_budget.h"
#include "engine/shared/stop_source.h"
#include "octree/stop.h"
#include "refine/cover_leaf.h"
#include "refine/refine_leaf.h"
#include "refine/size_leaf.h"

namespace locvol {
namespace {

using TellProgress = std::function<void(const Progress&)>;

// Of Phase::kSize, once leaves are split that an image asks too many sizes of.
std::uint32_t first_stage_with_surface(const RunRecord& run) {
  return run.parameters.has_image() ? 1 : 0;
}

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

// Takes a run that has been ingested to its end: the whole program, once its input is in the store.
class Engine {
 public:
  // Throws Stopped.
  Engine(Store& store, const MemoryPlan& plan, int num_threads, const TellProgress& on_progress,
         const StopSource& stop, const WorkClock& clock, Exchange* exchange = nullptr,
         bool is_behind = false)
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

  // What stands for the surface while sizes are found. Of several ranks each is told what it may
  // ask of others' surface: by all at once, when all are at that stage, or past it. It is not in
  // the store: so it is said again after each start, and nobody waits for it in a superstep.
  void find_far_surface() {
    far_.emplace(loader_.far_surface(&stop_));
    if (ranks_) share_far_surface(state_, loader_, *far_, *whole_exchange_);
    budget_.keep(far_->bytes());
  }

  // Until all is done, or the phase `until` begins, or the user stops it: then all visits that were
  // applied are committed, and Stopped is thrown.
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

  // In seconds of all threads, of several ranks: of this one's visits, without applying them.
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
      std::vector<QueueEntry> leaves = found->far_from_others();
      leaves.resize(std::min(leaves.size(), threads));
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
        bool is_stopped = false;
        stop_.allow(!is_behind_);
        try {
          find_results();
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
  // Absent: one process has all of the run.
  double cpu_of_visits_ = 0;
  Exchange* whole_exchange_ = nullptr;
  std::optional<RecordedExchange> exchange_;  // of what is said in supersteps
  std::optional<RankVisits> ranks_;
  // Until the first commit: others say what they said before, and cannot hear of a stop.
  bool is_behind_;
  std::optional<FarSurface> far_;  // while sizes are found
};

std::optional<RunRecord> held_run(const std::filesystem::path& store) {
  if (!Store::exists(store)) return std::nullopt;
  const Store held = Store::open(store, {.read_only = true});
  require_whole_run(held);
  return held.snapshot().run();
}

// Before the work, rather than after it.
void check_output(const RunRecord& run, const std::filesystem::path& store,
                  const RunControl& control, const DiskOf& disk = disk_of) {
  if (!control.output.empty()) require_format(run, control.output, control.output_options);
  require_room(run, store, control.output, control.output_options, disk);
}

// Of `num_ranks` which each have about as many triangles, one tells what all have done.
IngestWatch watch_of(const RunControl& control, const StopSource& stop, int num_ranks = 1) {
  std::function<void(std::uint64_t)> tell;
  if (control.on_progress)
    tell = [&control, num = static_cast<std::uint64_t>(num_ranks)](std::uint64_t num_triangles) {
      control.on_progress({.phase = Phase::kIngest, .num_triangles = num * num_triangles});
    };
  return IngestWatch(&stop, tell);
}

IngestCalls ingest_calls(const std::filesystem::path& directory, std::function<Store()> open_store,
                         const RunControl& control, const DiskOf& disk) {
  const auto check = [directory, &control, disk](const RunRecord& run, std::uint64_t spilled) {
    if (control.on_note) std::ranges::for_each(run.surface.notes, control.on_note);
    // Temporary files, which will be gone.
    const std::uint64_t own = disk(directory).id;
    check_output(run, directory, control, [&](const std::filesystem::path& place) {
      Disk found = disk(place);
      if (found.id == own) found.free_bytes += static_cast<double>(spilled);
      return found;
    });
  };
  const auto begin = [&control](const RunRecord& run) {
    planned_memory(run, memory_cap(control.memory_bytes));
    if (control.on_run) control.on_run(run);
  };
  return {check, begin, std::move(open_store)};
}

// Takes in the surface for a run that `planned` makes of its digest and bounding box. Throws
// Stopped before that is known, with nothing changed.
Store ingested(const SurfaceSource& surface, const std::filesystem::path& directory,
               const std::function<RunRecord(const std::string& digest, const Box& box)>& planned,
               const std::function<Store()>& open_store, const RunControl& control,
               const StopSource& stop) {
  IngestWatch watch = watch_of(control, stop);
  RawSurface raw = read_surface(surface, existing_directory(directory), watch);
  const RunRecord run = planned(raw.digest, raw.box);
  Workers workers(num_streaming_threads(control.num_threads, memory_cap(control.memory_bytes)));
  return ingest(std::move(raw), run, ingest_calls(directory, open_store, control, disk_of), watch,
                workers);
}

RunSummary interrupted(const Store& store) {
  RunSummary summary = summarize(store.snapshot());
  summary.outcome = RunOutcome::kInterrupted;
  return summary;
}

void require_cells(const RunRecord& run) {
  if (run.counts.num_cells == 0)
    throw InputError(run.surface.file +
                     ": no cell fits the surface at this size; choose a smaller one");
}

RunSummary finish(Store& store, const RunControl& control, const StopSource& stop,
                  const WorkClock& clock, Phase until = Phase::kDone) {
  const RunRecord run = store.snapshot().run().value();
  if (run.phase == Phase::kIngest) return interrupted(store);
  check_output(run, store.directory(), control);
  const MemoryPlan plan = planned_memory(store.snapshot(), memory_cap(control.memory_bytes));
  try {
    const auto on_sizes = [&](const RunRecord& known) {
      require_few_cells(known);
      check_output(known, store.directory(), control);
      if (control.on_sizes) control.on_sizes(known);
    };
    Engine(store, plan, control.num_threads, control.on_progress, stop, clock).run(until, on_sizes);
  } catch (const Stopped&) {
    return interrupted(store);
  }
  if (until < Phase::kDone) return interrupted(store);
  RunSummary summary = summarize(store.snapshot());
  require_cells(summary.run);
  return summary;
}

// The result of run(control, stop), in which the user's functions take turns.
template <class Run>
RunSummary in_turns(const RunControl& control, const Run& run) {
  const StopSource stop(control.is_stopped);
  RunControl in_turn = control;
  in_turn.on_progress = stop.in_turn(control.on_progress);
  in_turn.on_note = stop.in_turn(control.on_note);
  in_turn.on_run = stop.in_turn(control.on_run);
  in_turn.on_sizes = stop.in_turn(control.on_sizes);
  try {
    RunSummary summary = run(in_turn, stop);
    stop.rethrow();
    return summary;
  } catch (const Stopped&) {
    stop.rethrow();
    throw;
  }
}

RunSummary mesh(const SurfaceSource& surface, const MeshOptions& options, const RunControl& control,
                const StopSource& stop, Phase until = Phase::kDone) {
  const WorkClock clock;
  const auto held = held_run(options.store);
  if (held && held->phase != Phase::kIngest) {
    const RunParameters asked =
        planned_run(options, surface.digest(&stop), held->surface.box,
                    survey_size_image(options.size_image, held->surface.box, &stop))
            .parameters;
    if (held->parameters == asked || !options.is_forced) {
      require_same_run(held->parameters, asked, options.store);
      Store store = Store::open(options.store);
      if (control.on_run) control.on_run(*held);
      return finish(store, control, stop, clock, until);
    }
  }
  Store store = ingested(
      surface, options.store,
      [&](const std::string& digest, const Box& box) {
        return planned_run(options, digest, box, survey_size_image(options.size_image, box, &stop));
      },
      [&] { return Store::open(options.store, {.create = true}); }, control, stop);
  return finish(store, control, stop, clock, until);
}

void require_same_image(const RunRecord& run, const std::filesystem::path& store,
                        const StopSource& stop) {
  const ImageFacts image = survey_size_image(run.image_file, run.surface.box, &stop);
  if (image.digest != run.parameters.size_image)
    throw StoreMismatch("the store " + store.string() + " was to take in sizes from " +
                        run.image_file +
                        ", which is another file by now: restore it, or force a new run");
}

// What messages take, and Open MPI (measured: 11 MiB), is no run's. Throws OverBudget.
RunControl for_rank(RunControl control) {
  constexpr std::uint64_t kBytes = std::uint64_t{24} << 20;
  const std::uint64_t cap = memory_cap(control.memory_bytes);
  control.memory_bytes = memory_cap(cap > kBytes ? cap - kBytes : 1);
  return control;
}

// Throws InputError, the same on all ranks.
void require_for_ranks(const MeshOptions& options) {
  if (options.init != Initialization::kCover)
    throw InputError(
        "several processes mesh in cover mode: without --init paper, or by one process "
        "(locvol mesh)");
}

RunRecord planned_by_rank(const MeshOptions& options, const std::string& digest, const Box& box,
                          const StopSource& stop) {
  return planned_run(options, digest, box, survey_size_image(options.size_image, box, &stop));
}

// Each rank's leaves, of a share of space; or all of them on the first one, and nothing on others.
std::optional<Store> part_taken_in(const MeshOptions& options, const PassingStore& place,
                                   const RunControl& control, Exchange& exchange,
                                   const StopSource& stop) {
  const bool is_first = exchange.rank() == 0;
  const auto planned = [&](const std::string& digest, const Box& box) {
    return planned_by_rank(options, digest, box, stop);
  };
  const auto open_store = [&] { return place.open(); };
  const bool sees_image = options.size_image.empty() || std::ifstream(options.size_image).is_open();
  if (exchange.num_ranks() > 1 && !any(exchange, !sees_image)) {
    RunControl own = control;
    if (!is_first) own.on_note = nullptr, own.on_run = nullptr;
    const DiskOf disk = disk_of_parts(place.directory(), exchange);
    IngestWatch watch = watch_of(own, stop, exchange.num_ranks());
    Workers workers(num_streaming_threads(own.num_threads, memory_cap(own.memory_bytes)));
    auto part = ingest_by_ranks(options.input, existing_directory(place.directory()), planned,
                                ingest_calls(place.directory(), open_store, own, disk), watch,
                                workers, exchange, disk);
    if (part) return part;
  }
  if (!is_first) return std::nullopt;
  return ingested(surface_in_file(options.input), place.directory(), planned, open_store, control,
                  stop);
}

// All take the surface in, or the first one does, and then each gets its share.
void ingest_for_ranks(const MeshOptions& options, const RunControl& control, Exchange& exchange,
                      const StopSource& stop) {
  const std::filesystem::path own = store_of_rank(options.store, exchange.rank());
  const PassingStore place(own.string() + ".whole");
  std::vector<Store> parts;
  bool is_stopped = false;
  try {
    if (auto part = part_taken_in(options, place, control, exchange, stop)) {
      is_stopped = part->snapshot().run()->phase == Phase::kIngest;
      parts.push_back(std::move(*part));
    }
  } catch (const Stopped&) {
    is_stopped = true;
  }
  if (any(exchange, is_stopped)) throw Stopped();
  NextStore next(own);
  move_leaves(parts, equal_shares(parts, exchange), next.store(), exchange);
  next.take_place({}, exchange);
}

std::vector<Store> opened(std::span<const std::filesystem::path> stores) {
  std::vector<Store> open;
  for (const std::filesystem::path& store : stores)
    open.push_back(Store::open(store, {.read_only = true}));
  return open;
}

// Cuts shares anew, by what is known by now.
void move_to_equal_shares(const std::filesystem::path& own,
                          std::span<const std::filesystem::path> parts, Exchange& exchange) {
  std::vector<Store> from = opened(parts);
  NextStore next(own);
  move_leaves(from, equal_shares(from, exchange), next.store(), exchange);
  from.clear();
  next.take_place(parts, exchange);
}

// Before which phase leaves are to move next, if at all: to have copies as far as sizes ask for;
// and where most of the work begins, if shares are not equal.
Phase next_move(const Reader& reader) {
  const RunRecord run = reader.run().value();
  const Phase moved_at = reader.rank().value().moved_at;
  const bool has_sizes = !run.parameters.sizes().is_uniform();
  if (has_sizes && moved_at < Phase::kCover && run.phase <= Phase::kCover) return Phase::kCover;
  if (moved_at < Phase::kRefine && run.phase <= Phase::kRefine) return Phase::kRefine;
  return Phase::kDone;
}

// Nothing: it is to begin. Throws StoreError, the same on all ranks, or StoreMismatch.
std::optional<HeldRun> run_to_go_on_with(const MeshOptions& options, Exchange& exchange,
                                         const StopSource& stop) {
  std::optional<HeldRun> held;
  try {
    held = held_by_ranks(options.store, exchange);
  } catch (const StoreError&) {
    if (!options.is_forced) throw;
  }
  if (!held) return held;
  std::optional<RunParameters> asked;
  if (exchange.rank() == 0)
    asked = planned_by_rank(options, surface_in_file(options.input).digest(&stop),
                            held->run.surface.box, stop)
                .parameters;
  if (!any(exchange, asked && *asked != held->run.parameters)) return held;
  if (options.is_forced) return std::nullopt;
  if (asked) require_same_run(held->run.parameters, *asked, options.store);
  throw StoreMismatch("the store " + options.store.string() +
                      " has a part of another run than is asked for");
}

// What all ranks have.
RunSummary summarize(const Reader& own, Exchange& exchange) {
  RunSummary summary = summarize(own);
  std::uint64_t num_own = 0;
  own.for_each_leaf([&](MortonKey, const LeafInfo& info) {
    num_own += info.holding == Holding::kOwn ? 1 : 0;
    return true;
  });
  summary.run.counts = total_counts(exchange, summary.run.counts);
  summary.num_leaves = sum(exchange, num_own).all;
  summary.max_visits_of_a_leaf =
      std::ranges::max(gather_numbers(exchange, summary.max_visits_of_a_leaf));
  if (summary.outcome == RunOutcome::kInterrupted) return summary;
  require_cells(summary.run);
  if (summary.run.counts.num_unresolved > 0) summary.outcome = RunOutcome::kUnresolved;
  return summary;
}

// After a start: are some ranks finding sizes, and all so far that they may tell of their surface?
bool is_surface_shared(const Reader& own, Exchange& exchange) {
  const RunRecord run = own.run().value();
  if (run.parameters.sizes().is_uniform()) return false;  // the same on all
  const bool is_before =
      run.phase < Phase::kSize ||
      (run.phase == Phase::kSize && own.rank()->stage < first_stage_with_surface(run));
  const std::uint64_t standing = is_before ? 0 : run.phase == Phase::kSize ? 1 : 2;
  return smallest(exchange, standing) == 1;
}

// Takes a run that the ranks' stores hold to its end.
RunSummary go_on_as_rank(const std::filesystem::path& stores, std::optional<HeldRun> held,
                         const RunControl& control, const StopSource& stop, const WorkClock& clock,
                         Exchange& exchange) {
  const std::filesystem::path own = store_of_rank(stores, exchange.rank());
  if (held && !held->is_of_these_ranks) {
    move_to_equal_shares(own, held->parts, exchange);
    held.reset();
  }
  const auto on_sizes = [&](const RunRecord& known) {
    require_few_cells(known);
    if (control.on_sizes) control.on_sizes(known);
  };
  double cpu_of_visits = 0;
  bool is_to_move = false;
  for (;; held.reset()) {
    if (is_to_move) move_to_equal_shares(own, {&own, 1}, exchange);
    Store store = Store::open(own);
    const MemoryPlan plan = planned_memory(store.snapshot(), memory_cap(control.memory_bytes));
    const Phase until = next_move(store.snapshot());
    Engine engine(store, plan, control.num_threads, control.on_progress, stop, clock, &exchange,
                  held && held->is_behind);
    bool is_stopped = false;
    try {
      if (is_surface_shared(store.snapshot(), exchange)) engine.find_far_surface();
      if (held && held->is_ahead) say_again(exchange, store.snapshot().words().said);
      engine.run(until, on_sizes);
    } catch (const Stopped&) {
      is_stopped = true;
    }
    cpu_of_visits += engine.cpu_of_visits();
    const Phase phase = store.snapshot().run()->phase;
    if (is_stopped || phase == Phase::kDone) {
      RunSummary summary = summarize(store.snapshot(), exchange);
      summary.cpu_of_visits = cpu_of_visits;
      return summary;
    }
    is_to_move = next_move(store.snapshot()) == phase;
  }
}

RunSummary resume(const std::filesystem::path& directory, const RunControl& control,
                  const StopSource& stop) {
  const WorkClock clock;
  Store store = Store::open(directory);
  require_whole_run(store);
  const auto held = store.snapshot().run();
  if (!held) throw StoreError(directory.string() + ": the store holds no run to go on with");
  if (held->phase == Phase::kIngest) {
    if (held->surface.file == kInMemory)
      throw StoreError("the store " + directory.string() +
                       " was to take in a surface that is in no file: give it again to the program "
                       "that began the run");
    try {
      store = ingested(
          surface_in_file(held->surface.file), directory,
          [&](const std::string& digest, const Box&) {
            if (digest != held->parameters.input_digest)
              throw StoreMismatch("the store " + directory.string() + " was to take in " +
                                  held->surface.file +
                                  ", which is another file by now: restore it, or force a new run");
            require_same_image(*held, directory, stop);
            return *held;
          },
          [&] { return std::move(store); }, control, stop);
    } catch (const Stopped&) {
      return interrupted(store);
    }
  } else if (control.on_run) {
    control.on_run(*held);
  }
  return finish(store, control, stop, clock);
}

}  // namespace

RunSummary mesh(const MeshOptions& options, const RunControl& control) {
  return mesh(surface_in_file(options.input), options, control);
}

RunSummary mesh(const SurfaceSource& surface, const MeshOptions& options,
                const RunControl& control) {
  return in_turns(control, [&](const RunControl& in_turn, const StopSource& stop) {
    return mesh(surface, options, in_turn, stop);
  });
}

RunSummary find_sizes(const MeshOptions& options, const RunControl& control) {
  return in_turns(control, [&](const RunControl& in_turn, const StopSource& stop) {
    return mesh(surface_in_file(options.input), options, in_turn, stop, Phase::kCover);
  });
}

RunSummary resume(const std::filesystem::path& directory, const RunControl& control) {
  return in_turns(control, [&](const RunControl& in_turn, const StopSource& stop) {
    return resume(directory, in_turn, stop);
  });
}

RunSummary mesh_as_rank(const MeshOptions& options, const RunControl& control, Exchange& exchange) {
  require_for_ranks(options);
  return in_turns(for_rank(control), [&](const RunControl& in_turn, const StopSource& stop) {
    const WorkClock clock;
    std::optional<HeldRun> held = run_to_go_on_with(options, exchange, stop);
    if (!held) ingest_for_ranks(options, in_turn, exchange, stop);
    return go_on_as_rank(options.store, std::move(held), in_turn, stop, clock, exchange);
  });
}

RunSummary resume_as_rank(const std::filesystem::path& stores, const RunControl& control,
                          Exchange& exchange) {
  return in_turns(for_rank(control), [&](const RunControl& in_turn, const StopSource& stop) {
    const WorkClock clock;
    std::optional<HeldRun> held = held_by_ranks(stores, exchange);
    if (!held) throw StoreError(stores.string() + ": the stores hold no run to go on with");
    if (held->run.parameters.init != Initialization::kCover)
      throw StoreError(stores.string() + ": the run is one of paper mode, for one process alone");
    return go_on_as_rank(stores, std::move(held), in_turn, stop, clock, exchange);
  });
}

RunRecord join_ranks(const std::filesystem::path& stores, const std::filesystem::path& whole,
                     Exchange& exchange) {
  const std::optional<HeldRun> held = held_by_ranks(stores, exchange);
  if (!held) throw StoreError(stores.string() + ": the stores hold no run");
  if (held->is_within_superstep)
    throw StoreError(
        stores.string() +
        ": the run ended within a superstep: go on with it first, and stop it (SIGINT)");
  std::optional<Store> joined;
  if (exchange.rank() == 0) {
    if (Store::exists(whole) && Store::open(whole, {.read_only = true}).snapshot().run())
      throw StoreError(whole.string() + ": it holds a run: give another directory");
    joined = Store::open(whole, {.create = true});
  }
  const std::vector<Store> from = opened(held->parts);
  join_leaves(from, joined ? &*joined : nullptr, exchange);
  return held->run;
}

RunSummary summarize(const Reader& reader) {
  const auto run = reader.run();
  if (!run) throw StoreError("the store holds no run");
  RunSummary summary{
      .outcome = run->counts.num_unresolved > 0 ? RunOutcome::kUnresolved : RunOutcome::kDone,
      .run = *run};
  if (run->phase != Phase::kDone) summary.outcome = RunOutcome::kInterrupted;
  reader.for_each_leaf([&](MortonKey, const LeafInfo& info) {
    ++summary.num_leaves;
    summary.max_visits_of_a_leaf =
        std::max<std::uint64_t>(summary.max_visits_of_a_leaf, info.num_visits);
    return true;
  });
  return summary;
}

}  // namespace locvol
