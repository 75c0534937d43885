// The holes between the first points are filled, once all of these are known.
#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "engine/plan/phases.h"
#include "engine/run/core_around.h"
#include "engine/run/leaf_distances.h"
#include "engine/stages/apply_visit.h"
#include "engine/stages/visiting_stage.h"
#include "refine/fill_leaf.h"

namespace locvol {
namespace {

class FillStage : public VisitingStage<FillInput, FillPoints> {
 public:
  using VisitingStage::VisitingStage;

  double conflict_distance(MortonKey leaf) const override { return conflict_of_fill(state_, leaf); }
  Phase end() override {
    begin_refinement(state_, &tools_.stop);
    return next_phase(state_.run(), Phase::kFill);
  }

 protected:
  Loaded<FillInput> load_input(MortonKey leaf) override {
    constexpr GridFineness kFineness{3, 48};
    const double size = state_.surface_size(leaf);
    const double distance =
        state_.is_uniform() ? kDistanceSlack * size : around_.surface_reach(leaf);
    std::vector<MeshPoint> points = around_.points(leaf, kFillReach);
    const std::vector<MeshPoint>& own = state_.leaves().points(leaf).points;
    points.insert(points.end(), own.begin(), own.end());
    std::ranges::sort(points, {}, &MeshPoint::id);
    CoreRows core = core_around(state_, leaf, kCoreReach * core_size(state_.parameters()));
    const double least = state_.least_size(leaf);
    DomainPiece domain = around_.domain(leaf, distance, fineness(kFineness, least));
    const VisitSize visit{.volume = volume_over_size(domain.region, least),
                          .num_points = points.size(),
                          .surface_size = domain.surface_size()};
    return {.bytes = visit.bytes_to_cover(),
            .input = {.size = size,
                      .box = state_.box(leaf),
                      .points = std::move(points),
                      .core = std::move(core),
                      .domain = std::move(domain),
                      .sizes = around_.sizes(leaf, kFillReach)}};
  }

  FillPoints compute(FillInput&& input) const override {
    return fill_leaf(std::move(input), &tools_.stop);
  }

  void apply_result(MortonKey leaf, const FillPoints& points) override {
    state_.queue().dequeue(leaf);
    for (const Point& center : points.centers) state_.points().add(center, PointKind::kVolume);
    for (const std::uint64_t id : points.met_core) list_core_point(state_, site_of(id));
  }
};

}  // namespace

std::unique_ptr<LeafStage> fill_stage(const StageTools& tools) {
  return std::make_unique<FillStage>(tools);
}

}  // namespace locvol
