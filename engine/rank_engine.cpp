#include "engine/rank_engine.h"

#include <algorithm>
#include <cstdint>
#include <fstream>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "engine/exchange/hosted_ranks.h"
#include "engine/exchange/recorded_exchange.h"
#include "engine/ingest/cad_input.h"
#include "engine/ingest/surface_input.h"
#include "engine/plan/phases.h"
#include "engine/plan/run_setup.h"
#include "engine/plan/same_run.h"
#include "engine/ranks/counts_of_ranks.h"
#include "engine/ranks/ingest_by_ranks.h"
#include "engine/ranks/move_leaves.h"
#include "engine/ranks/rank_store.h"
#include "engine/run/run_timeline.h"
#include "engine/run_phases.h"
#include "engine/shared/input_error.h"
#include "engine/shared/memory_budget.h"
#include "engine/shared/workers.h"

namespace locvol {
namespace {

// What Open MPI takes (measured: 11 MiB), and messages, is no run's. Throws OverBudget.
RunControl for_rank(RunControl control, Exchange& exchange) {
  constexpr std::uint64_t kBytes = std::uint64_t{48} << 20;
  check_on_all(exchange, [&] { control.memory_bytes = memory_cap(control.memory_bytes, kBytes); });
  control.output_options.is_by_ranks = exchange.num_ranks() > 1 && !control.is_in_pieces;
  return control;
}

// Throws InputError, the same on all ranks.
void require_for_ranks(const MeshOptions& options) {
  if (options.init != Initialization::kCover)
    throw InputError(
        "several processes mesh in cover mode: without --init paper, or by one process "
        "(locvol mesh)");
}

// The disk that each rank's piece of the mesh will be on; empty: the mesh is one file.
std::filesystem::path pieces_of(const RunControl& control) {
  return control.is_in_pieces ? control.output : std::filesystem::path();
}

// Each rank's leaves, of a share of space; or all of them on the first one, and nothing on others.
std::optional<Store> part_taken_in(const SurfaceSource& surface, const MeshOptions& options,
                                   const PassingStore& place, const RunControl& control,
                                   Exchange& exchange, const StopSource& stop) {
  const bool is_first = exchange.rank() == 0;
  RunControl own = control;
  if (!is_first) own.on_note = nullptr, own.on_run = nullptr;
  const auto plan = [&](const std::string& digest, const Box& box) {
    return begun(options, digest, box, own, stop);
  };
  const auto open_store = [&] { return place.open(); };
  const auto sees = [](const std::filesystem::path& file) {
    return file.empty() || std::ifstream(file).is_open();
  };
  const bool sees_files = sees(options.size_image) && sees(options.sharp_polylines);
  if (exchange.num_ranks() > 1 && !any(exchange, !sees_files)) {
    const DiskOf disk = disk_of_parts(place.directory(), pieces_of(control), exchange);
    IngestWatch watch = watch_of(own, stop, exchange.num_ranks());
    Workers workers(num_streaming_threads(own.num_threads, memory_cap(own.memory_bytes)));
    auto part = ingest_by_ranks(surface.file, existing_directory(place.directory()), plan,
                                ingest_calls(place.directory(), open_store, own, disk), watch,
                                workers, exchange, disk);
    if (part) return part;
  }
  if (!is_first) return std::nullopt;
  return ingested(surface, place.directory(), plan, open_store, own, stop);
}

// All take the surface in, or the first one does, and then each gets its share.
void ingest_for_ranks(const SurfaceSource& surface, const MeshOptions& options,
                      const RunControl& control, Exchange& exchange, const StopSource& stop) {
  const std::filesystem::path own = store_of_rank(options.store, exchange.rank());
  const PassingStore place(own.string() + ".whole");
  std::vector<Store> parts;
  bool is_stopped = false;
  try {
    if (auto part = part_taken_in(surface, options, place, control, exchange, stop)) {
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

// Before which phase leaves are to move next, if at all.
Phase next_move(const Reader& reader) {
  return next_move(reader.run().value(), reader.rank().value().moved_at);
}

// With the counts of all parts, whichever ranks have them.
RunRecord run_of_all(const HeldRun& held, Exchange& exchange) {
  RunCounts own;
  for (const std::filesystem::path& part : held.parts)
    own = sum_of(own, Store::open(part, {.read_only = true}).snapshot().run()->counts);
  RunRecord run = held.run;
  run.counts = total_counts(exchange, own);
  return run;
}

// Nothing: it is to begin. Throws StoreError, the same on all ranks, or StoreMismatch.
std::optional<HeldRun> run_to_go_on_with(const SurfaceSource& surface, const MeshOptions& options,
                                         Exchange& exchange, const StopSource& stop) {
  std::optional<HeldRun> held;
  try {
    held = held_by_ranks(options.store, exchange);
  } catch (const StoreError&) {
    if (!options.is_forced) throw;
  }
  if (!held) return held;
  std::optional<RunRecord> asked;
  if (exchange.rank() == 0)
    asked = planned(options, surface.digest(&stop), held->run.surface.box, stop);
  if (!any(exchange, asked && asked->parameters != held->run.parameters)) return held;
  const RunRecord of_all = run_of_all(*held, exchange);
  if (options.is_forced || is_in_vain(of_all)) return std::nullopt;
  if (asked) require_same_run(of_all, *asked, options.store);
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

struct Sitting {
  bool is_stopped = false;
  double cpu_of_visits = 0;
};

// Takes the run on until leaves are to move, or it is done, or stopped. `held`: after a start.
Sitting sit(Store& store, const std::optional<HeldRun>& held, const RunControl& control,
            const StopSource& stop, const WorkClock& clock, Exchange& exchange) {
  const auto on_sizes = [&, disk = disk_of_parts(store.directory(), pieces_of(control), exchange)](
                            const RunRecord& known) {
    require_few_cells(known);
    check_output(known, store.directory(), control, disk);
    if (control.on_sizes) control.on_sizes(known);
  };
  const MemoryPlan plan = planned_memory(store.snapshot(), control.memory_bytes);
  // The same on all: a rank that is ahead may know already that leaves stay.
  const Phase until = phase_at(smallest(exchange, place_of(next_move(store.snapshot()))));
  RunPhases phases(store, plan, control.num_threads, control.on_progress, stop, clock, exchange,
                   held && held->is_behind);
  bool is_stopped = false;
  try {
    phases.share_knowledge();
    if (held && held->is_ahead) say_again(exchange, store.snapshot().words().said);
    phases.run(until, on_sizes);
  } catch (const Stopped&) {
    is_stopped = true;
  }
  return {is_stopped, phases.cpu_of_visits()};
}

// As many ranks as have the run end the superstep in which it ended, and stop before the next
// color: in each process those whose parts it has, with a share of its memory. Throws OverBudget.
void end_superstep(const std::filesystem::path& stores, const HeldRun& held,
                   const RunControl& control, const WorkClock& clock, Exchange& exchange) try {
  const std::size_t num_here = std::max<std::size_t>(1, held.parts.size());
  RunControl of_each = control;
  of_each.memory_bytes /= num_here;
  const int num_threads = control.num_threads > 0 ? control.num_threads : num_usable_threads();
  of_each.num_threads = std::max(1, num_threads / static_cast<int>(num_here));
  const StopSource at_once([] { return true; });
  run_hosted_ranks(held.num_ranks, exchange, [&](Exchange& hosted) {
    RunControl own = of_each;
    if (hosted.rank() != exchange.rank()) own.on_progress = nullptr, own.on_sizes = nullptr;
    const std::optional<HeldRun> held_by_one = held_by_ranks(stores, hosted);
    Store store = Store::open(store_of_rank(stores, hosted.rank()));
    sit(store, held_by_one, own, at_once, clock, hosted);
  });
} catch (const OverBudget& e) {
  const std::string num_here = std::to_string(held.parts.size());
  throw OverBudget(stores.string() + ": the run of " + std::to_string(held.num_ranks) +
                       " ranks ended within a superstep, which this process is to end for " +
                       num_here + " of them, each with as much of its memory. Of one: " + e.what() +
                       ". Start as many ranks as there were, or give " + num_here +
                       " times as much memory",
                   e.bytes());
}

void check_output_of_ranks(const std::filesystem::path& store, const RunControl& control,
                           Exchange& exchange) {
  RunRecord run = Store::open(store, {.read_only = true}).snapshot().run().value();
  run.counts = total_counts(exchange, run.counts);
  const DiskOf disk = disk_of_parts(store, pieces_of(control), exchange);
  check_on_all(exchange, [&] { check_output(run, store, control, disk); });
}

// Takes a run that the ranks' stores hold to its end.
RunSummary go_on_as_rank(const std::filesystem::path& stores, std::optional<HeldRun> held,
                         const RunControl& control, const StopSource& stop, const WorkClock& clock,
                         Exchange& exchange) {
  const std::filesystem::path own = store_of_rank(stores, exchange.rank());
  if (held && !held->is_of_these_ranks) {
    if (held->is_within_superstep) end_superstep(stores, *held, control, clock, exchange);
    move_to_equal_shares(own, held->parts, exchange);
    held.reset();
  }
  check_output_of_ranks(own, control, exchange);
  double cpu_of_visits = 0;
  bool is_to_move = false;
  for (;; held.reset()) {
    if (is_to_move) move_to_equal_shares(own, {&own, 1}, exchange);
    Store store = Store::open(own);
    const Sitting sitting = sit(store, held, control, stop, clock, exchange);
    cpu_of_visits += sitting.cpu_of_visits;
    const Phase phase = store.snapshot().run()->phase;
    if (sitting.is_stopped || phase == Phase::kDone) {
      RunSummary summary = summarize(store.snapshot(), exchange);
      summary.cpu_of_visits = cpu_of_visits;
      return summary;
    }
    is_to_move = next_move(store.snapshot()) == phase;
  }
}

}  // namespace

RunSummary mesh_as_rank(const MeshOptions& options, const RunControl& control, Exchange& exchange) {
  return mesh_as_rank(
      surface_at(options.input, options.more_inputs, store_of_rank(options.store, exchange.rank())),
      options, control, exchange);
}

RunSummary mesh_as_rank(const SurfaceSource& given, const MeshOptions& asked,
                        const RunControl& control, Exchange& exchange) {
  require_for_ranks(asked);
  const SurfaceSource surface = source_to_mesh(given, asked, control);
  return in_turns(
      for_rank(control, exchange), [&](const RunControl& in_turn, const StopSource& stop) {
        const WorkClock clock;
        MeshOptions options = asked;  // the first rank's are those of the run
        do_on_all(exchange, [&] {
          if (exchange.rank() == 0)
            settle_faces(surface, options, memory_cap(in_turn.memory_bytes), &stop);
        });
        std::optional<HeldRun> held = run_to_go_on_with(surface, options, exchange, stop);
        if (!held) ingest_for_ranks(surface, options, in_turn, exchange, stop);
        surface.release();
        return go_on_as_rank(options.store, std::move(held), in_turn, stop, clock, exchange);
      });
}

RunSummary resume_as_rank(const std::filesystem::path& stores, const RunControl& control,
                          Exchange& exchange) {
  return in_turns(for_rank(control, exchange), [&](const RunControl& in_turn,
                                                   const StopSource& stop) {
    const WorkClock clock;
    std::optional<HeldRun> held = held_by_ranks(stores, exchange);
    if (!held) throw StoreError(stores.string() + ": the stores hold no run to go on with");
    if (held->run.parameters.init != Initialization::kCover)
      throw StoreError(stores.string() + ": the run is one of paper mode, for one process alone");
    return go_on_as_rank(stores, std::move(held), in_turn, stop, clock, exchange);
  });
}

void join_ranks(const std::filesystem::path& stores, const std::filesystem::path& whole,
                const RunControl& control, Exchange& exchange) {
  const std::optional<HeldRun> held = held_by_ranks(stores, exchange);
  if (!held) throw StoreError(stores.string() + ": the stores hold no run");
  if (held->is_within_superstep)
    end_superstep(stores, *held, for_rank(control, exchange), WorkClock(), exchange);
  std::optional<Store> joined;
  if (exchange.rank() == 0) {
    if (Store::exists(whole) && Store::open(whole, {.read_only = true}).snapshot().run())
      throw StoreError(whole.string() + ": it holds a run: give another directory");
    joined = Store::open(whole, {.create = true});
  }
  const std::vector<Store> from = opened(held->parts);
  join_leaves(from, joined ? &*joined : nullptr, exchange);
}

}  // namespace locvol
