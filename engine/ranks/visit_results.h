// What visits find, as bytes that another rank can apply: of the same program, on a machine of the
// same kind.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "engine/run/apply_visit.h"
#include "engine/run/mend_leaf.h"
#include "octree/size_field.h"
#include "octree/size_nodes.h"
#include "refine/cover_leaf.h"
#include "refine/fill_leaf.h"
#include "refine/leaf.h"

namespace locvol {

// Of a LeafDelta, MendedCells, FillPoints, CoverPoints, and vectors of SizedNode and SizeCube.
template <class Result>
std::string encode_result(const Result& result);
// Without what only the visited leaf's own rank keeps, the list of its cells; with the sizes that
// only it may know.
template <class Result>
std::string encode_for_others(RunState&, const Result& result) {
  return encode_result(result);
}
inline std::string encode_for_others(RunState& state, const LeafDelta& delta) {
  LeafDelta others = with_sizes(state, delta);
  others.cells = {};
  return encode_result(others);
}
// Throws ExchangeError: the bytes are none of a result.
template <class Result>
Result decode_result(std::string_view bytes);

}  // namespace locvol
