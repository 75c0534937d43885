// What is counted of a run by ranks, each of its own leaves.
#pragma once

#include <cstdint>
#include <vector>

#include "engine/exchange/exchange.h"
#include "storage/records.h"

namespace locvol {

std::vector<std::uint64_t> numbers_of(const RunCounts& counts);
RunCounts counts_of(const std::vector<std::uint64_t>& numbers);
RunCounts sum_of(const RunCounts& a, const RunCounts& b);
RunCounts difference(const RunCounts& a, const RunCounts& b);
// Of all ranks, each of which calls it.
RunCounts total_counts(Exchange& exchange, const RunCounts& own);

}  // namespace locvol
