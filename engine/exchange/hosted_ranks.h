// Ranks that are threads of other processes than their own: of processes that are fewer than the
// ranks, or more, and stand in for them.
#pragma once

#include <functional>
#include <vector>

#include "engine/exchange/exchange.h"

namespace locvol {

// Which of `num_ranks` ranks fall to this one of m processes: p, p + m, p + 2m, ...
std::vector<int> ranks_hosted(int num_ranks, const Exchange& processes);

// Has each of the ranks do `work`, at once, in a thread of the process that it falls to. Called by
// all processes, also by those that no rank falls to; `processes` is used by the calling thread
// alone. Of ranks that wait no work is done (Exchange::set_work). Memory: what ranks say at once, a
// few times. Errors: those of run_as_ranks(); other processes end as those of `processes` do.
void run_hosted_ranks(int num_ranks, Exchange& processes,
                      const std::function<void(Exchange&)>& work);

}  // namespace locvol
