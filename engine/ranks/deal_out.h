// A run that one rank has taken in becomes one of all ranks: each gets its share of the leaves, and
// copies of those near them.
#pragma once

#include "engine/exchange/exchange.h"
#include "engine/run/run_state.h"
#include "storage/store.h"

namespace locvol {

// Called by all ranks; `whole` is the first rank's, and null on others; `own` is empty, and has the
// rank's part of the run, and a RankRecord, when all is there: until then it holds no run. Memory:
// a message for each rank, and 8 bytes for each of the rank's leaves; 16 bytes for each leaf on the
// first.
void deal_out(const Store* whole, Store& own, Exchange& exchange);

// The reverse: the first rank's `whole`, which is empty, gets all that is any rank's own. Memory: a
// message of each rank.
void join(const Store& own, Store* whole, Exchange& exchange);

}  // namespace locvol
