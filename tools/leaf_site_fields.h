// Sites, as exchange/pack.h asks for it.
#pragma once

#include <tuple>

#include "engine/inspect/leaf_row_fields.h"
#include "tools/results.h"

namespace locvol {

auto fields(Maybe<LeafSite> auto& of_leaf) {
  auto& [leaf, site] = of_leaf;
  return std::tuple(Field("leaf", leaf), Field("site", site));
}

}  // namespace locvol
