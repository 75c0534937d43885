// Leaves move between the stores of a run: from the one that a single process has taken it into, or
// from those of any number of ranks, to those of other ranks, or to one.
#pragma once

#include <span>

#include "engine/exchange/exchange.h"
#include "octree/shares.h"
#include "storage/store.h"

namespace locvol {

// Called by all ranks. `from`: stores that this rank has at hand, of no other rank; together they
// are all of the run, and as old as each other. `own` is empty, and gets the rank's share and
// copies of leaves near it; until all is there, and durable, it holds no run. REQUIRES: no result
// of a visit waits to be applied; the first rank has a store to give from
// Memory: a few messages for each rank, and 16 bytes for each leaf near another rank's.
void move_leaves(std::span<const Store> from, const Shares& shares, Store& own, Exchange& exchange);

// The same to one store, as a single process has it: the first rank's; null on others.
void join_leaves(std::span<const Store> from, Store* whole, Exchange& exchange);

// Of leaves near each other's ranks, all records go to those that have copies of them, as their own
// ranks have them: into `beside`, which is empty.
void tell_leaves_beside(const Store& own, Store& beside, Exchange& exchange);

// Of what is to be done in a leaf, once first points are known: it goes with them, for those of the
// core are not listed.
double predicted_cost(const LeafInfo& info);
// Shares of about equal cost, of what the ranks' stores hold. Memory: a few bytes a rank, and 16
// for each leaf of the rank's stores.
Shares equal_shares(std::span<const Store> from, Exchange& exchange);
// The largest share of a cost over the mean.
double imbalance(double own_cost, Exchange& exchange);

}  // namespace locvol
