// Of places where a condition could not be met, one stands for all around it.
#pragma once

#include <vector>

#include "storage/records.h"

namespace locvol {

// Those farther than `distance` from all of `kept` and from each other: the first of each crowd, in
// the order given.
std::vector<UnresolvedSite> thinned(const std::vector<UnresolvedSite>& sites,
                                    const std::vector<UnresolvedSite>& kept, double distance);

}  // namespace locvol
