// Paper mode's first points, all or nothing: a second time, the same ones would come again.
#include "engine/plan/phases.h"
#include "engine/stages/apply_visit.h"
#include "engine/stages/stages.h"
#include "refine/scatter_surface.h"

namespace locvol {
namespace {

class ScatterStage : public LeafStage {
 public:
  explicit ScatterStage(const StageTools& tools) : tools_(tools) {}

  Phase end() override {
    RunState& state = tools_.state;
    for (const Point& point :
         scatter_on_surface(*tools_.model.whole().domain, state.parameters().seed))
      tools_.model.note_inserted(state.points().add(point, PointKind::kSurface));
    begin_refinement(state, nullptr);
    return next_phase(state.run(), Phase::kScatter);
  }

 private:
  StageTools tools_;
};

}  // namespace

std::unique_ptr<LeafStage> scatter_stage(const StageTools& tools) {
  return std::make_unique<ScatterStage>(tools);
}

}  // namespace locvol
