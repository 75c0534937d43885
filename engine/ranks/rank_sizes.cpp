#include "engine/ranks/rank_sizes.h"

#include <algorithm>
#include <string>
#include <tuple>
#include <type_traits>
#include <utility>

#include "engine/exchange/pack.h"
#include "engine/run/apply_visit.h"

namespace locvol {

auto fields(Maybe<FarPoint> auto& point) {
  auto& [node, place] = point;
  return std::tuple(Field("node", node), Field("place", place));
}
namespace {

// A list for each of the others; all that come, one after another.
template <class ListFor>
auto swap_with_others(Exchange& exchange, const ListFor& list_for) {
  std::vector<std::invoke_result_t<ListFor, int>> lists;
  for (int rank = 0; rank < exchange.num_ranks(); ++rank) {
    lists.emplace_back();
    if (rank != exchange.rank()) lists.back() = list_for(rank);
  }
  std::invoke_result_t<ListFor, int> all;
  for (const auto& of_rank : swap_lists(exchange, std::move(lists)))
    all.insert(all.end(), of_rank.begin(), of_rank.end());
  return all;
}

}  // namespace

void share_far_surface(RunState& state, LeafLoader& loader, FarSurface& far, Exchange& exchange) {
  std::vector<std::vector<Box>> places;
  for (int rank = 0; rank < exchange.num_ranks(); ++rank) {
    auto& boxes = places.emplace_back();
    for (const MortonKey node : state.shares().nodes_of(rank))
      boxes.push_back(state.run().frame.box(node));
  }
  const auto places_of = [&](int rank) -> const std::vector<Box>& {
    return places[static_cast<std::size_t>(rank)];
  };
  far.add_told(
      swap_with_others(exchange, [&](int rank) { return far.seen_from(places_of(rank)); }));
  if (!state.run().parameters.has_nodes()) return;
  std::vector<SizedNode> nodes =
      swap_with_others(exchange, [&](int rank) { return loader.nodes_seen_from(places_of(rank)); });
  unite(nodes);
  loader.take_nodes(std::move(nodes));
}

void share_splits(RunState& state, const std::vector<SplitLeaf>& split, Exchange& exchange) {
  const auto of_rank = [&](int rank) {
    std::vector<MortonKey> leaves;
    for (const auto& [leaf, ranks] : split)
      if (std::ranges::find(ranks, rank) != ranks.end()) leaves.push_back(leaf);
    return leaves;
  };
  for (const MortonKey leaf : swap_with_others(exchange, of_rank)) {
    split_empty_leaf(state, leaf);
    state.leaves().trim();
  }
}

SizeTotals total_sizes(const SizeTotals& own, Exchange& exchange) {
  SizeTotals all;
  for (const auto& of_rank : gather_values(
           exchange, std::vector{own.of_volume, own.of_area, own.of_lattice, own.of_core}))
    all += {of_rank.at(0), of_rank.at(1), of_rank.at(2), of_rank.at(3)};
  return all;
}

}  // namespace locvol
