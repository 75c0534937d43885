#include "engine/ranks/rank_store.h"

#include <algorithm>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "engine/exchange/pack.h"
#include "storage/codec.h"

namespace locvol {

// Of a rank's store.
struct HeldPart {
  std::string directory;
  bool is_there = false;
  std::string run;  // what makes it this run, and no other
  std::uint64_t rank = 0, num_ranks = 0, superstep = 0;
};
auto fields(Maybe<HeldPart> auto& part) {
  auto& [directory, is_there, run, rank, num_ranks, superstep] = part;
  return std::tuple(Field("directory", directory), Field("is_there", is_there), Field("run", run),
                    Field("rank", rank), Field("num_ranks", num_ranks),
                    Field("superstep", superstep));
}

namespace {

std::string identity_of(const RunRecord& run) {
  RunRecord alone;
  alone.parameters = run.parameters;
  alone.frame = run.frame;
  return encode(alone, MortonKey());
}

// Throws StoreError, the same on all ranks.
void require_same_run(const std::vector<HeldPart>& parts) {
  const auto& newest = *std::ranges::max_element(parts, {}, &HeldPart::superstep);
  const auto& first = *std::ranges::find_if(parts, &HeldPart::is_there);
  for (std::size_t rank = 0; rank < parts.size(); ++rank) {
    const HeldPart& part = parts[rank];
    const std::string named = "rank " + std::to_string(rank) + ", store " + part.directory + ": ";
    if (!part.is_there)
      throw StoreError(named + "there is no part of the run that other ranks hold (" +
                       first.directory + "): bring it back, or force a new run on all ranks");
    if (part.num_ranks == 0)
      throw StoreError(named + "it has a run that one process makes: give another directory");
    if (part.num_ranks != parts.size())
      throw StoreError(named + "the run is one of " + std::to_string(part.num_ranks) +
                       " ranks: start as many");
    if (part.rank != rank)
      throw StoreError(named + "this is the part of rank " + std::to_string(part.rank));
    if (part.run != first.run)
      throw StoreError(named + "this is a part of another run than in " + first.directory);
    if (part.superstep + 1 < newest.superstep)
      throw StoreError(named + "this part is " + std::to_string(newest.superstep - part.superstep) +
                       " supersteps older than that in " + newest.directory +
                       ": a copy of it that is as new is needed");
  }
}

}  // namespace

std::optional<HeldRun> held_by_ranks(const std::filesystem::path& directory, Exchange& exchange) {
  HeldPart own;
  own.directory = directory.string();
  std::optional<RunRecord> run;
  std::optional<RankRecord> rank;
  if (Store::exists(directory)) {
    const Store store = Store::open(directory, {.read_only = true});
    const Snapshot snapshot = store.snapshot();
    run = snapshot.run();
    rank = snapshot.rank();
    own.is_there = run.has_value();
    if (run) own.run = identity_of(*run);
    if (rank)
      own.rank = rank->rank, own.num_ranks = rank->first.size(), own.superstep = rank->superstep;
  }
  std::vector<HeldPart> parts;
  for (const std::string& message : exchange.gather(pack(own)))
    parts.push_back(unpack<HeldPart>(message));
  // Of a run that was being dealt out, some may have their part.
  const auto is_new = [](const HeldPart& part) {
    return !part.is_there || (part.num_ranks > 0 && part.superstep == 0);
  };
  const bool are_all_there = std::ranges::all_of(parts, &HeldPart::is_there);
  if (!are_all_there && std::ranges::all_of(parts, is_new)) return std::nullopt;
  require_same_run(parts);
  const auto [oldest, newest] = std::ranges::minmax(parts, {}, &HeldPart::superstep);
  return HeldRun{.run = *run,
                 .is_behind = rank->superstep != newest.superstep,
                 .is_ahead = rank->superstep != oldest.superstep};
}

}  // namespace locvol
