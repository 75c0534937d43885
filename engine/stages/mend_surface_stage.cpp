// The surface's last repairs in a run of the surface alone, where refinement left sites unresolved.
// While it goes on, records of cells have those that have gone to the other side, each at the leaf
// of its smallest vertex. At its end these are empty again.
#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include "engine/ranks/rank_visits.h"
#include "engine/run/leaf_distances.h"
#include "engine/run/listed_cells.h"
#include "engine/stages/refine_stage.h"
#include "engine/stages/visiting_stage.h"
#include "octree/sort_and_unite.h"
#include "refine/mend_surface.h"

namespace locvol {
namespace {

class MendSurfaceStage : public VisitingStage<SurfaceMendInput, MendedSurface> {
 public:
  using VisitingStage::VisitingStage;

  bool is_once() const override { return false; }
  double conflict_distance(MortonKey leaf) const override {
    return conflict_of_refinement(state_, leaf);
  }
  Phase end() override {
    for (const MortonKey leaf : state_.octree().leaves()) {
      state_.leaves().trim();
      if (state_.leaves().info(leaf).num_left_out > 0)
        state_.records().leave_out_cells(leaf, LeafCells());
    }
    merge_sites_in_turn(state_, tools_.exchange);
    return Phase::kDone;
  }

 protected:
  Loaded<SurfaceMendInput> load_input(MortonKey leaf) override {
    Loaded<LeafInput> loaded = load_refine(state_, around_, tools_.model, leaf);
    Loaded<SurfaceMendInput> result{.bytes = loaded.bytes, .input = {std::move(loaded.input), {}}};
    result.input.leaf.last_visit.reset();
    for (const MortonKey other : leaves_around(leaf)) {
      if (state_.leaves().info(other).num_left_out == 0) continue;
      const CellList list = listed_cells(state_.leaves().cells(other));
      for (std::size_t i = 0; i < list.size(); ++i) {
        NamedCell& cell =
            result.input.gone.emplace_back(NamedCell{list.refs(i), list.cells[i].body});
        std::ranges::sort(cell.vertices);
      }
    }
    std::ranges::sort(result.input.gone);
    return result;
  }

  MendedSurface compute(SurfaceMendInput&& input) const override {
    return mend_surface(std::move(input), &tools_.stop);
  }

  void apply_result(MortonKey leaf, const MendedSurface& mended) override {
    state_.queue().dequeue(leaf);
    if (mended.gone.empty())
      return state_.records().put_facets(leaf, {mended.facets.vertices, mended.facets.facets});
    std::vector<MortonKey> leaves{leaf};  // with a vertex of what went
    for (const auto& [cell, corners] : mended.gone) {
      note_gone(cell, state_.owner_of(*std::ranges::min_element(corners)));
      for (const Point& corner : corners) leaves.push_back(state_.owner_of(corner));
    }
    sort_and_unite(leaves);
    for (const MortonKey other : leaves) state_.queue().enqueue(other);
  }

 private:
  std::vector<MortonKey> leaves_around(MortonKey leaf) const {
    return state_.octree().leaves_within(state_.frame(), state_.box(leaf),
                                         state_.reach_of(leaf, kReach));
  }

  void note_gone(const NamedCell& cell, MortonKey owner) {
    if (state_.is_beyond(owner)) return;
    CellList list = listed_cells(state_.leaves().cells(owner));
    Changes<CellList> changes;
    changes.made.push_back(cell);
    locvol::apply(changes, list);
    state_.records().leave_out_cells(owner, stored_cells(std::move(list.vertices), list));
  }
};

}  // namespace

std::unique_ptr<LeafStage> mend_surface_stage(const StageTools& tools) {
  return std::make_unique<MendSurfaceStage>(tools);
}

}  // namespace locvol
