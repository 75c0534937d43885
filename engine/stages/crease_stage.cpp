// Each leaf that creases of the surface pass through gets its share of points on them.
#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include "engine/plan/phases.h"
#include "engine/run/leaf_distances.h"
#include "engine/stages/visiting_stage.h"
#include "refine/crease_leaf.h"

namespace locvol {
namespace {

constexpr std::uint64_t kLeastBytes = 1 << 18;
constexpr std::uint64_t kBytesPerEdge = 600, kBytesPerPoint = 400;  // with a graph and its tree

class CreaseStage : public VisitingStage<CreaseInput, CreasePoints> {
 public:
  using VisitingStage::VisitingStage;

  bool changes_others() const override { return false; }
  double conflict_distance(MortonKey leaf) const override {
    return conflict_of_creases(state_, leaf);
  }
  Phase end() override { return next_phase(state_.run(), Phase::kCrease); }

 protected:
  Loaded<CreaseInput> load_input(MortonKey leaf) override {
    const double size = state_.surface_size(leaf);
    Loaded<CreaseInput> loaded;
    loaded.bytes = kLeastBytes;
    loaded.input.size = size;
    loaded.input.box = state_.box(leaf);
    if (!state_.leaves().info(leaf).has_surface()) return loaded;
    const double distance = kDistanceSlack * kCreaseReach * size;
    loaded.input.domain = around_.creases(leaf, distance);
    const std::size_t num_edges = loaded.input.domain.surface_size();
    if (num_edges == 0 && loaded.input.domain.corners.empty()) return loaded;
    if (asks_for_surface(loaded.input)) loaded.input.domain = around_.domain(leaf, distance, {});
    for (const MeshPoint& point : around_.crease_points(leaf, distance))
      loaded.input.nearby.push_back(point.position);
    if (state_.parameters().sizes().has_shapes())
      loaded.input.sizes = around_.sizes_within(leaf, distance);
    loaded.bytes += kBytesPerEdge * num_edges + kBytesPerPoint * loaded.input.nearby.size() +
                    bytes_of(loaded.input.sizes);
    return loaded;
  }

  CreasePoints compute(CreaseInput&& input) const override {
    return crease_leaf(std::move(input), &tools_.stop);
  }

  void apply_result(MortonKey leaf, const CreasePoints& points) override {
    state_.queue().dequeue(leaf);
    for (const Point& p : points.positions) {
      if (state_.frame().key_of(p, leaf.level()) != leaf)
        throw RefineError("its creases have a point outside its box");
      state_.points().add(p, PointKind::kCrease);
    }
    state_.queue().enqueue(leaf);
  }

 private:
  static std::uint64_t bytes_of(const SizeCubes& sizes) {
    return sizes.cubes.capacity() * sizeof(SizeCube);
  }
};

}  // namespace

std::unique_ptr<LeafStage> crease_stage(const StageTools& tools) {
  return std::make_unique<CreaseStage>(tools);
}

}  // namespace locvol
