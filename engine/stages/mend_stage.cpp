// The boundary's last repairs, where refinement left sites unresolved.
#include <tuple>
#include <utility>

#include "engine/ranks/rank_visits.h"
#include "engine/run/leaf_distances.h"
#include "engine/run/mend_leaf.h"
#include "engine/stages/visiting_stage.h"

namespace locvol {
namespace {

class MendStage : public VisitingStage<LoadedMend, MendedCells> {
 public:
  using VisitingStage::VisitingStage;

  bool is_once() const override { return false; }
  double conflict_distance(MortonKey leaf) const override {
    return conflict_of_refinement(state_, leaf);
  }
  Phase end() override {
    merge_sites_in_turn(state_, tools_.exchange);
    return Phase::kDone;
  }

 protected:
  Loaded<LoadedMend> load_input(MortonKey leaf) override { return load_mend(state_, leaf); }
  MendedCells compute(LoadedMend&& loaded) const override { return mended_cells(loaded); }
  void apply_result(MortonKey leaf, const MendedCells& cells) override {
    apply_mend(state_, leaf, cells);
  }
};

}  // namespace

std::unique_ptr<LeafStage> mend_stage(const StageTools& tools) {
  if (tools.state.parameters().is_surface_only) return mend_surface_stage(tools);
  return std::make_unique<MendStage>(tools);
}

}  // namespace locvol
