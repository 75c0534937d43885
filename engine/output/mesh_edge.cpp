#include "engine/output/mesh_edge.h"

#include <numeric>

namespace locvol {

// Sorted by the smaller vertex first, in linear time: then only a few dozen at a time are left to
// sort.
CellEdges::CellEdges(std::span<const std::array<std::uint32_t, 4>> cells,
                     std::span<const std::int64_t> numbers)
    : numbers_(numbers), rank_(numbers.size()), first_(numbers.size() + 1) {
  std::vector<std::uint32_t> by_rank(numbers.size());
  std::iota(by_rank.begin(), by_rank.end(), 0U);
  std::ranges::sort(by_rank, {}, [&](std::uint32_t v) { return numbers[v]; });
  for (std::uint32_t rank = 0; rank < by_rank.size(); ++rank) rank_[by_rank[rank]] = rank;

  const auto for_each_pair = [&](const auto& visit) {
    for (const auto& cell : cells)
      for (const auto& [i, j] : kCellEdges) {
        const auto [low, high] = std::minmax(rank_[cell[i]], rank_[cell[j]]);
        visit(low, high);
      }
  };
  std::vector<std::uint32_t> ends(numbers.size() + 1);
  for_each_pair([&](std::uint32_t low, std::uint32_t) { ++ends[low + 1]; });
  std::partial_sum(ends.begin(), ends.end(), ends.begin());
  const std::vector<std::uint32_t> starts = ends;
  std::vector<std::uint32_t> repeated(ends.back());
  for_each_pair([&](std::uint32_t low, std::uint32_t high) { repeated[ends[low]++] = high; });
  for (std::uint32_t low = 0; low < numbers.size(); ++low) {
    first_[low] = static_cast<std::uint32_t>(others_.size());
    const auto of_vertex = std::span(repeated).subspan(starts[low], starts[low + 1] - starts[low]);
    std::ranges::sort(of_vertex);
    for (auto other = of_vertex.begin(); other != of_vertex.end(); ++other)
      if (other == of_vertex.begin() || *other != other[-1]) {
        others_.push_back(*other);
        ends_.push_back({by_rank[low], by_rank[*other]});
      }
  }
  first_.back() = static_cast<std::uint32_t>(others_.size());
}

std::size_t CellEdges::place_of(std::uint32_t v, std::uint32_t w) const {
  const auto [low, high] = std::minmax(rank_[v], rank_[w]);
  const auto begin = others_.begin() + first_[low], end = others_.begin() + first_[low + 1];
  return static_cast<std::size_t>(std::lower_bound(begin, end, high) - others_.begin());
}

}  // namespace locvol
