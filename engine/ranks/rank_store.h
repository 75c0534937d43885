// The stores of the ranks of a run: together they hold the run, or none of it.
#pragma once

#include <filesystem>
#include <optional>

#include "engine/exchange/exchange.h"
#include "storage/store.h"

namespace locvol {

struct HeldRun {
  RunRecord run;
  // Others have committed a superstep that this rank has not; the reverse: then this rank has to
  // say_again() what it said in it (RankRecord::said).
  bool is_behind = false, is_ahead = false;
};
// The run that all ranks' stores hold a part of; nothing, if it has yet to be dealt out. Called by
// all ranks. Throws StoreError, the same on all, with rank and directory: a rank has no part of the
// run that others have, is of another run, of a run of another number of ranks, or older by more
// than a superstep.
std::optional<HeldRun> held_by_ranks(const std::filesystem::path& directory, Exchange& exchange);

}  // namespace locvol
