#include "engine/ranks/rank_sizes.h"

#include <algorithm>
#include <string>
#include <tuple>
#include <utility>

#include "engine/exchange/pack.h"
#include "engine/run/apply_visit.h"

namespace locvol {

auto fields(Maybe<FarPoint> auto& point) {
  auto& [node, place] = point;
  return std::tuple(Field("node", node), Field("place", place));
}
auto fields(Maybe<SizedNode> auto& node) {
  auto& [key, size] = node;
  return std::tuple(Field("key", key), Field("size", size));
}

namespace {

// A list to each of the others; those that come are taken.
template <class T, class ListFor, class Take>
void swap_lists(Exchange& exchange, const ListFor& list_for, const Take& take) {
  std::vector<std::string> messages;
  for (int rank = 0; rank < exchange.num_ranks(); ++rank)
    messages.push_back(pack(rank == exchange.rank() ? std::vector<T>() : list_for(rank)));
  for (const std::string& message : exchange.swap(std::move(messages)))
    take(unpack<std::vector<T>>(message));
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
  std::vector<FarPoint> points;
  swap_lists<FarPoint>(
      exchange, [&](int rank) { return far.seen_from(places_of(rank)); },
      [&](const std::vector<FarPoint>& told) {
        points.insert(points.end(), told.begin(), told.end());
      });
  far.add_told(points);
  if (!state.run().parameters.has_nodes()) return;
  std::vector<SizedNode> nodes;
  swap_lists<SizedNode>(
      exchange, [&](int rank) { return loader.nodes_seen_from(places_of(rank)); },
      [&](const std::vector<SizedNode>& told) {
        nodes.insert(nodes.end(), told.begin(), told.end());
      });
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
  swap_lists<MortonKey>(exchange, of_rank, [&](const std::vector<MortonKey>& leaves) {
    for (const MortonKey leaf : leaves) {
      split_empty_leaf(state, leaf);
      state.leaves().trim();
    }
  });
}

SizeTotals total_sizes(const SizeTotals& own, Exchange& exchange) {
  SizeTotals all;
  for (const std::string& message : exchange.gather(
           pack(std::vector{own.of_volume, own.of_area, own.of_lattice, own.of_core}))) {
    const auto of_rank = unpack<std::vector<double>>(message);
    all += {of_rank.at(0), of_rank.at(1), of_rank.at(2), of_rank.at(3)};
  }
  return all;
}

}  // namespace locvol
