// The boundary's last repairs, leaf by leaf, where refinement left sites unresolved: what
// mend_boundary needs to know of a leaf, and what it does to the run.
#pragma once

#include <cstdint>
#include <tuple>
#include <vector>

#include "engine/run/hanging_cells.h"
#include "engine/run/leaf_stage.h"
#include "engine/run/run_state.h"
#include "refine/domain/leaf_domain.h"
#include "refine/leaf_fields.h"
#include "refine/mend_boundary.h"

namespace locvol {

// All cells at a leaf's own points, copied from the run.
struct LoadedMend {
  double reach = 0;  // how far from the leaf such cells may have vertices
  MendInput input;
  std::vector<std::uint64_t> ids;  // of the vertices
  // The cells from `first` on are of that leaf's record, at these places.
  struct Origin {
    MortonKey leaf;
    std::uint32_t first = 0;
    std::vector<std::uint32_t> places;
  };
  std::vector<Origin> origins;
  std::vector<CellPlaces> hanging;
  std::vector<std::uint64_t> hanging_ids;  // of their vertices, ascending
  std::vector<Point> positions;            // of the vertices in `ids`; of core points, infinite
  DomainPiece domain = {};                 // tells the sheets of facets; of one sheet, one triangle
};

// What a visit leaves out of the mesh.
struct MendedCells {
  std::vector<CellPlaces> left_out;         // in Morton order
  std::vector<std::uint64_t> others;        // ids of their vertices in other leaves, ascending
  std::vector<std::uint64_t> hanging = {};  // ids of vertices without cells from now on, ascending
  // Of the leaf, if nothing is left out: the cells at its points will be those that were loaded.
  LeafFacets facets = {};
  double reach = 0;  // as far from the leaf as these may be
};

auto fields(Maybe<CellPlaces> auto& cells) {
  auto& [leaf, places] = cells;
  return std::tuple(Field("leaf", leaf), Field("places", places));
}
auto fields(Maybe<LeafFacets> auto& list) {
  auto& [vertices, facets] = list;
  return std::tuple(Field("vertices", vertices), Field("facets", facets));
}
auto fields(Maybe<MendedCells> auto& cells) {
  auto& [left_out, others, hanging, facets, reach] = cells;
  return std::tuple(Field("left_out", left_out), Field("others", others), Field("hanging", hanging),
                    Field("facets", facets), Field("reach", reach));
}

Loaded<LoadedMend> load_mend(const RunView& state, MortonKey leaf);
MendedCells mended_cells(const LoadedMend& loaded);
// Takes cells out of the records; leaves with a vertex of theirs, and this one, wait for the next
// epoch.
void apply_mend(RunState& state, MortonKey leaf, const MendedCells& cells);

// Leaves with unresolved sites wait: only there may the boundary be torn.
void enqueue_for_mending(RunState& state);
// Sites within λ of each other become one, the first in Morton order. Of a run whose leaves have
// been thinned already, changes nothing. Of the rank's own leaves; gives those that it changed.
std::vector<MortonKey> merge_sites(RunState& state);

}  // namespace locvol
