// LeafRecords are what visits leave in leaves besides points: cells, unresolved sites, sizes, and
// what is known of the visits themselves. A leaf's counts (LeafInfo) are those of its records, the
// run's (RunCounts) the sums over its leaves.
#pragma once

#include <array>
#include <cstdint>

#include "engine/run/run_queue.h"
#include "engine/run/run_view.h"

namespace locvol {

class LeafRecords : RunView {
 public:
  LeafRecords(RunData& data, RunQueue& queue);

  std::uint64_t num_own_leaves() const { return num_own_leaves_; }

  void add_visit(MortonKey leaf, const VisitStats& stats);
  // Of what a visit may build on: a later one may look at what is new since now; or it may not, for
  // of points that go nothing is known.
  void allow_short_visit(MortonKey leaf);
  void require_whole_visit(MortonKey leaf);
  // The leaf is visited once more, and looks around the place if not at all of it; without points
  // it has nothing to restore.
  void ask_for_visit(MortonKey leaf, const Point& place);

  // Each in place of what the leaf had. Of copies cells are dropped, unless they are shared for
  // mending; facets always.
  void put_cells(MortonKey leaf, LeafCells cells);
  void put_shared_cells(MortonKey leaf, LeafCells cells);
  void put_facets(MortonKey leaf, LeafFacets facets);
  // Of what an own leaf lists.
  void change(MortonKey leaf, const Changes<CellList>& changes);
  void change(MortonKey leaf, const Changes<FacetList>& changes);
  // As put_cells(); what is missing is left out of the mesh.
  void leave_out_cells(MortonKey leaf, LeafCells left);
  void put_num_core_cells(MortonKey leaf, std::uint64_t num_cells);
  void put_unresolved(MortonKey leaf, LeafUnresolved unresolved);
  void put_sizes(MortonKey leaf, LeafSizes sizes);
  void put_reached_size(MortonKey leaf, double size);

  // What the children of a leaf have of it.
  struct Child {
    DomainState center;
    LeafPoints points;
    LeafSurface surface;
    LeafSizes sizes;
  };
  // Its cells and unresolved sites are gone, children with points wait.
  void split(MortonKey leaf, std::array<Child, 8> children);

 private:
  RunQueue& queue_;
  std::uint64_t num_own_leaves_;
};

}  // namespace locvol
