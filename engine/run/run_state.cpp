#include "engine/run/run_state.h"

#include <cassert>
#include <optional>
#include <utility>

namespace locvol {
namespace {

RunData read(Store& store, std::size_t cache_bytes) {
  std::optional<RunRecord> run = store.snapshot().run();
  assert(run && run->phase != Phase::kIngest);
  std::optional<RankRecord> rank = store.snapshot().rank();
  Shares shares = rank ? Shares(rank->first) : Shares();
  const Lattice lattice = lattice_of(*run);
  return {store,
          std::move(rank),
          std::move(shares),
          std::move(*run),
          lattice,
          LinearOctree(store.snapshot().leaf_keys()),
          EditedLeaves(store, cache_bytes)};
}

}  // namespace

RunState::RunState(Store& store, std::size_t cache_bytes, std::size_t max_unwritten_bytes)
    : RunView(all_),
      all_(read(store, cache_bytes)),
      queue_(all_),
      points_(all_),
      records_(all_, queue_),
      ranks_(all_),
      commits_(all_, queue_, ranks_, max_unwritten_bytes) {}

void RunState::begin_phase(Phase next) {
  all_.run.phase = next;
  if (all_.rank) all_.rank->stage = 0;
}

}  // namespace locvol
