// Cells that hang on nothing: where sheets of the surface are closer than the spacing floor, a few
// cells may lie there by themselves, each of their vertices in a perfect disk of boundary facets,
// beside a mesh that ends before them.
#pragma once

#include <cstdint>
#include <vector>

#include "engine/run/run_view.h"

namespace locvol {

struct CellPlaces {
  MortonKey leaf;
  std::vector<std::uint32_t> places;  // in its record, ascending
};

// Of parts of the mesh, cells that share facets, at the leaf's own points: those that are smaller
// than λ / 4, have vertices on the surface alone and none with other cells in common, and lie
// within λ of other parts, unless they are all there is of a component of the surface. In Morton
// order. A function of what lies within the reach of the leaf.
std::vector<CellPlaces> hanging_cells(const RunView& state, MortonKey leaf);

}  // namespace locvol
