#include "octree/shares.h"

#include <algorithm>
#include <cassert>
#include <numeric>
#include <utility>

namespace locvol {

Shares::Shares(std::vector<MortonKey> first) : first_(std::move(first)) {
  for (MortonKey& key : first_) key = key.range_min();
  assert(!first_.empty() && first_.front() == MortonKey::root().range_min());
  assert(std::ranges::is_sorted(first_));
}

Shares Shares::of_equal_cost(std::span<const MortonKey> leaves, std::span<const double> costs,
                             int num_ranks) {
  assert(leaves.size() == costs.size() && num_ranks > 0);
  const double total = std::accumulate(costs.begin(), costs.end(), 0.0);
  std::vector<MortonKey> first;
  double before = 0;
  for (std::size_t i = 0; i < leaves.size(); ++i) {
    // The leaf's middle decides.
    const double middle = before + 0.5 * costs[i];
    while (first.size() < static_cast<std::size_t>(num_ranks) &&
           middle * num_ranks >= total * static_cast<double>(first.size()))
      first.push_back(leaves[i]);
    before += costs[i];
  }
  first.resize(static_cast<std::size_t>(num_ranks), MortonKey::root().range_max());
  first.front() = MortonKey::root();
  return Shares(std::move(first));
}

int Shares::owner_of(MortonKey leaf) const {
  const auto after = std::ranges::upper_bound(first_, leaf.range_min());
  return static_cast<int>(after - first_.begin()) - 1;
}

KeyRange Shares::range_of(int rank) const {
  const auto own = first_.begin() + rank;
  return own + 1 == first_.end() ? KeyRange{*own} : KeyRange{*own, own[1]};
}

std::vector<MortonKey> Shares::nodes_of(int rank) const {
  std::vector<MortonKey> nodes, waiting = {MortonKey::root()};
  while (!waiting.empty()) {
    const MortonKey node = waiting.back();
    waiting.pop_back();
    const int first = owner_of(node.range_min()), last = owner_of(node.range_max());
    if (rank < first || last < rank) continue;
    if (first == last)
      nodes.push_back(node);
    else
      for (int octant = 7; octant >= 0; --octant) waiting.push_back(node.child(octant));
  }
  return nodes;
}

std::vector<int> Shares::ranks_within(const Frame& frame, const Box& box, double distance) const {
  std::vector<int> ranks;
  if (distance < 0) return ranks;
  std::vector<MortonKey> waiting = {MortonKey::root()};
  while (!waiting.empty()) {
    const MortonKey node = waiting.back();
    waiting.pop_back();
    const int first = owner_of(node.range_min()), last = owner_of(node.range_max());
    if (first == last && !ranks.empty() && ranks.back() == first) continue;
    if (frame.box(node).squared_distance(box) > distance * distance) continue;
    if (first == last)
      ranks.push_back(first);
    else
      for (int octant = 7; octant >= 0; --octant) waiting.push_back(node.child(octant));
  }
  return ranks;  // in Morton order, as the nodes came
}

}  // namespace locvol
