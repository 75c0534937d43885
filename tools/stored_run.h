// What several subcommands read from a store.
#pragma once

#include <filesystem>
#include <vector>

#include "engine/exchange/exchange.h"
#include "engine/inspect/run_part.h"
#include "engine/ranks/rank_store.h"
#include "storage/store.h"
#include "tools/arguments.h"
#include "tools/results.h"

namespace locvol {

Store open_to_read(const std::filesystem::path& directory);
// Opens the store of a run that one process makes; throws StoreMismatch otherwise.
Store open_whole(const std::filesystem::path& directory);
// Called by all ranks. Throw StoreError, the same on all: the stores hold no finished run. The
// first one settles what a move of leaves left behind, as held_by_ranks() does.
HeldRun finished_by_ranks(const std::filesystem::path& stores, Exchange& exchange);
// This rank's store, read only. Throws StoreError, too, as part_to_look_into() does, and if the
// store is damaged.
Store open_part(const std::filesystem::path& stores, Exchange& exchange);
// Throws std::runtime_error if no run has begun in this store.
RunRecord run_of(const Store& store);
RunRecord run_of(const Reader& reader, const std::filesystem::path& directory);
// The run's record, as the first rank has it that can read its own. Called by all ranks. Throws
// what the store does.
RunRecord run_of(const RunPart& part);
// Throws std::runtime_error if the run in this store is not done.
void require_done(const Store& store);
// The leaf that is meant. Throws std::runtime_error if there is none; the message says which
// leaves are there instead.
MortonKey find_leaf(const Reader& reader, const RunRecord& run, const LeafSpec& spec,
                    const std::filesystem::path& directory);
// The unresolved sites of the store's own leaves, in Morton order.
std::vector<LeafSite> unresolved_sites(const Reader& reader);

}  // namespace locvol
