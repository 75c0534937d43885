#include "engine/ranks/counts_of_ranks.h"

#include <algorithm>
#include <functional>

namespace locvol {

std::vector<std::uint64_t> numbers_of(const RunCounts& counts) {
  std::vector<std::uint64_t> numbers = {counts.num_visits,    counts.num_points,
                                        counts.num_cells,     counts.num_unresolved,
                                        counts.num_deletions, counts.num_moves};
  numbers.insert(numbers.end(), counts.num_insertions.begin(), counts.num_insertions.end());
  return numbers;
}

RunCounts counts_of(const std::vector<std::uint64_t>& numbers) {
  RunCounts counts{numbers[0], numbers[1], numbers[2], numbers[3], {}, numbers[4], numbers[5]};
  std::copy(numbers.begin() + 6, numbers.end(), counts.num_insertions.begin());
  return counts;
}

namespace {

template <class Operation>
RunCounts combined(const RunCounts& a, const RunCounts& b, Operation operation) {
  std::vector<std::uint64_t> numbers = numbers_of(a);
  std::ranges::transform(numbers, numbers_of(b), numbers.begin(), operation);
  return counts_of(numbers);
}

}  // namespace

RunCounts sum_of(const RunCounts& a, const RunCounts& b) { return combined(a, b, std::plus()); }

RunCounts difference(const RunCounts& a, const RunCounts& b) {
  return combined(a, b, std::minus());
}

RunCounts total_counts(Exchange& exchange, const RunCounts& own) {
  return counts_of(sums(exchange, numbers_of(own)));
}

}  // namespace locvol
