// What sizes the surface asks for, where they depend on it: in each leaf, by itself.
#include <algorithm>
#include <utility>
#include <vector>

#include "engine/plan/part_sizes.h"
#include "engine/plan/phases.h"
#include "engine/run/leaf_distances.h"
#include "engine/stages/split_leaves.h"
#include "engine/stages/visiting_stage.h"
#include "octree/size_nodes.h"
#include "refine/measure_leaf.h"

namespace locvol {
namespace {

constexpr std::uint64_t kBytesPerPiece = 350;  // of a surface that is measured

class MeasureStage : public VisitingStage<MeasureInput, std::vector<SizedNode>> {
 public:
  explicit MeasureStage(const StageTools& tools)
      : VisitingStage(tools),
        sheet_sizes_(sizes_by_sheet(state_.parameters(), state_.store().snapshot().sheets())) {}

  std::vector<Step> steps_before() override {
    return {splitting_rich(tools_, [this](MortonKey leaf) { return share_of_pieces(leaf); })};
  }
  bool changes_others() const override { return false; }
  double conflict_distance(MortonKey) const override { return kNoConflict; }
  Phase end() override { return next_phase(state_.run(), Phase::kMeasure); }

 protected:
  Loaded<MeasureInput> load_input(MortonKey leaf) override {
    const RunParameters& p = state_.parameters();
    Loaded<MeasureInput> loaded;
    loaded.input = {.rules = {p.per_circle, p.deviation, p.layers, p.min_size, p.spacing_floor,
                              p.growth, sheet_sizes_},
                    .size = p.size,
                    .frame = state_.frame(),
                    .leaf = leaf,
                    .domain = {}};
    if (!state_.leaves().info(leaf).has_surface()) return loaded;
    const double distance = measure_reach(loaded.input.rules, p.size);
    DomainPiece& domain = loaded.input.domain;
    domain = around_.domain(leaf, distance, fineness(kFinenessOfCover, p.size));
    const VisitSize visit{.volume = volume_over_size(domain.region, p.size),
                          .num_points = domain.surface_size(),  // what is measured
                          .surface_size = domain.surface_size()};
    loaded.bytes = visit.bytes_to_cover() + kBytesPerPiece * most_pieces(p);
    return loaded;
  }

  std::vector<SizedNode> compute(MeasureInput&& input) const override {
    return measure_leaf(std::move(input), &tools_.stop);
  }

  void apply_result(MortonKey leaf, const std::vector<SizedNode>& measured) override {
    state_.queue().dequeue(leaf);
    std::vector<SizedNode> nodes = measured;
    const std::vector<SizedNode>& of_image = state_.leaves().sizes(leaf).nodes;
    nodes.insert(nodes.end(), of_image.begin(), of_image.end());
    unite(nodes);
    state_.records().put_sizes(leaf, {.cubes = {}, .nodes = std::move(nodes)});
    state_.queue().enqueue(leaf);
  }

 private:
  const std::vector<double> sheet_sizes_;

  // What measuring the leaf takes, and what its nodes do, over what a visit should.
  double share_of_pieces(MortonKey leaf) {
    const double of_nodes = share_of_nodes(state_, leaf);
    if (!state_.leaves().info(leaf).has_surface()) return of_nodes;
    const Loaded<MeasureInput> loaded = load_input(leaf);
    const auto memory = tools_.budget.reserve(loaded.bytes);
    return std::max(of_nodes, num_pieces_to_measure(loaded.input, &tools_.stop) /
                                  static_cast<double>(most_pieces(state_.parameters())));
  }
};

}  // namespace

std::unique_ptr<LeafStage> measure_stage(const StageTools& tools) {
  return std::make_unique<MeasureStage>(tools);
}

}  // namespace locvol
