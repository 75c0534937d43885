#include "engine/stages/stages.h"

#include <algorithm>
#include <cassert>

namespace locvol {
namespace {

constexpr struct {
  Phase phase;
  std::unique_ptr<LeafStage> (*make)(const StageTools& tools);
} kStages[] = {
    {Phase::kMeasure, measure_stage}, {Phase::kSize, size_stage},
    {Phase::kScatter, scatter_stage}, {Phase::kCrease, crease_stage},
    {Phase::kCover, cover_stage},     {Phase::kFill, fill_stage},
    {Phase::kRefine, refine_stage},   {Phase::kMend, mend_stage},
};

}  // namespace

std::unique_ptr<LeafStage> stage_in(Phase phase, const StageTools& tools) {
  const auto row = std::ranges::find_if(kStages, [&](const auto& r) { return r.phase == phase; });
  assert(row != std::end(kStages));
  return row->make(tools);
}

}  // namespace locvol
