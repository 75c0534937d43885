// What ranks that audit a mesh together, each its own leaves, tell each other.
#pragma once

#include <cstdint>
#include <vector>

#include "engine/audit/audit_leaf.h"
#include "engine/exchange/exchange.h"

namespace locvol {

// All ranks call each of these functions.
// The unresolved sites of others' leaves within the distance of own ones.
std::vector<SitesOfLeaf> sites_beside(const Reader& own, const RunRecord& run, double distance,
                                      Exchange& exchange);
// How many components of the boundary, over all ranks, go on one that another rank has counted.
std::uint64_t num_joined_components(BoundaryComponents& own, const AuditLeaves& leaves,
                                    const AuditRecords& records, Exchange& exchange);
// What all ranks have found.
AuditReport together(const AuditReport& own, Exchange& exchange);

}  // namespace locvol
