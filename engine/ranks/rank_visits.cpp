#include "engine/ranks/rank_visits.h"

#include <algorithm>
#include <limits>
#include <string>
#include <tuple>
#include <utility>

#include "engine/exchange/pack.h"
#include "engine/ranks/counts_of_ranks.h"
#include "engine/run/coloring.h"
#include "engine/run/mend_leaf.h"
#include "storage/codec.h"

namespace locvol {

auto fields(Maybe<LeafToColor> auto& waiting) {
  auto& [leaf, distance, weight] = waiting;
  return std::tuple(Field("leaf", leaf), Field("distance", distance), Field("weight", weight));
}

// Where a rank stands between two supersteps.
struct StandingOfRank {
  std::uint64_t front = 0;         // of its queue: epoch, color
  std::uint64_t num_at_front = 0;  // own leaves
  bool is_sending = false;         // results of a color
  std::uint64_t num_leaves = 0, num_queued = 0, num_in_epoch = 0;
  std::vector<std::uint64_t> counts;
};
auto fields(Maybe<StandingOfRank> auto& standing) {
  auto& [front, num_at_front, is_sending, num_leaves, num_queued, num_in_epoch, counts] = standing;
  return std::tuple(Field("front", front), Field("num_at_front", num_at_front),
                    Field("is_sending", is_sending), Field("num_leaves", num_leaves),
                    Field("num_queued", num_queued), Field("num_in_epoch", num_in_epoch),
                    Field("counts", counts));
}

// A record of a leaf, as the store's codec writes it.
struct SharedRecord {
  MortonKey leaf;
  std::string record;
};
auto fields(Maybe<SharedRecord> auto& shared) {
  auto& [leaf, record] = shared;
  return std::tuple(Field("leaf", leaf), Field("record", record));
}

RankVisits::Next RankVisits::next() {
  constexpr std::uint64_t kNothing = std::numeric_limits<std::uint64_t>::max();
  StandingOfRank own{.counts = numbers_of(state_.run().counts)};
  const LeafQueue& queue = state_.queue().entries();
  own.front =
      queue.is_empty() ? kNothing : std::uint64_t{queue.front().epoch} << 32 | queue.front().color;
  if (!queue.is_empty())
    for (const MortonKey leaf : queue.front_leaves())
      own.num_at_front += state_.is_own(leaf) ? 1 : 0;
  own.is_sending = state_.ranks().record().applied.has_value();
  own.num_leaves = state_.records().num_own_leaves();
  own.num_queued = state_.queue().num_own();
  if (!queue.is_empty() && queue.front().epoch == state_.run().epoch)
    for (const QueueEntry& entry : queue.front_epoch())
      own.num_in_epoch += state_.is_own(entry.leaf) ? 1 : 0;
  totals_ = {};
  std::uint64_t first = kNothing;
  bool is_sending = false;
  std::vector<std::uint64_t> counts(own.counts.size());
  const std::vector<StandingOfRank> ranks = gather_values(exchange_, own);
  for (const StandingOfRank& of_rank : ranks) {
    first = std::min(first, of_rank.front);
    is_sending = is_sending || of_rank.is_sending;
    totals_.num_leaves += of_rank.num_leaves;
    totals_.num_queued += of_rank.num_queued;
    totals_.num_in_epoch += of_rank.num_in_epoch;
    for (std::size_t i = 0; i < counts.size(); ++i) counts[i] += of_rank.counts.at(i);
  }
  totals_.counts = counts_of(counts);
  if (is_sending) return {Step::kSend, state_.ranks().record().applied.value()};
  if (first == kNothing) return {};
  const QueuePosition position{static_cast<std::uint32_t>(first >> 32),
                               static_cast<std::uint32_t>(first)};
  if (position.color == kNoColor) return {Step::kOpen, position};
  Next next{Step::kVisit, position, state_.run().next_point_id, state_.run().next_point_id};
  for (std::size_t rank = 0; rank < ranks.size(); ++rank) {
    if (ranks[rank].front != first) continue;
    const std::uint64_t num_ids = ranks[rank].num_at_front * kIdsOfVisit;
    if (rank < static_cast<std::size_t>(exchange_.rank())) next.first_own_id += num_ids;
    next.end_id += num_ids;
  }
  return next;
}

void RankVisits::open_epoch(std::uint32_t epoch, const LeafVisits& visits) {
  std::vector<LeafToColor> own;
  for (const MortonKey leaf : state_.queue().own_waiting(epoch))
    own.push_back({leaf, visits.conflict_distance(leaf),
                   state_.is_uniform() ? 0 : weight_of_visit(state_.leaves().info(leaf))});
  const std::vector<LeafToColor> all = gather_all(exchange_, own);  // in Morton order
  std::vector<MortonKey> leaves;
  for (const LeafToColor& of_rank : all) leaves.push_back(of_rank.leaf);
  const LinearOctree octree = LinearOctree::coarsest_with(leaves);
  state_.queue().open_epoch(epoch, leaves, color_leaves(octree, state_.frame(), all));
}

void share_cells(RunState& state, Exchange& exchange) {
  std::vector<std::vector<SharedRecord>> shared(static_cast<std::size_t>(exchange.num_ranks()));
  for (const MortonKey leaf : state.octree().leaves()) {
    state.leaves().trim();
    if (!state.is_own(leaf) || state.leaves().info(leaf).num_cells == 0) continue;
    const std::vector<int> ranks = state.others_holding(leaf);
    if (ranks.empty()) continue;
    const std::string cells = encode(state.leaves().cells(leaf), leaf);
    for (const int rank : ranks) shared[static_cast<std::size_t>(rank)].push_back({leaf, cells});
  }
  for (const auto& of_rank : swap_lists(exchange, std::move(shared)))
    for (const auto& [leaf, cells] : of_rank)
      state.records().put_shared_cells(leaf, decode<LeafCells>(cells, leaf));
}

void merge_sites_in_turn(RunState& state, Exchange& exchange) {
  for (int rank = 0; rank < exchange.num_ranks(); ++rank) {
    std::vector<SharedRecord> merged;
    if (rank == exchange.rank())
      for (const MortonKey leaf : merge_sites(state))
        merged.push_back({leaf, encode(state.leaves().unresolved(leaf), leaf)});
    const std::string message = exchange.gather(pack(merged))[static_cast<std::size_t>(rank)];
    if (rank == exchange.rank()) continue;
    for (const auto& [leaf, sites] : unpack<std::vector<SharedRecord>>(message))
      if (state.octree().is_leaf(leaf))
        state.records().put_unresolved(leaf, decode<LeafUnresolved>(sites, leaf));
  }
}

}  // namespace locvol
