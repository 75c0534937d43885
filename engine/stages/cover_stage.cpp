// Each leaf that the domain may meet gets its share of a point set that covers it: first what does
// not depend on its neighbors' share.
#include <algorithm>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "engine/plan/phases.h"
#include "engine/run/leaf_distances.h"
#include "engine/stages/apply_visit.h"
#include "engine/stages/visiting_stage.h"
#include "refine/cover_leaf.h"

namespace locvol {
namespace {

// In a leaf's box, and on its surface at the density of a maximal sample (at most one in each
// disk of radius r_s / 2, which is some 1.8 times what it gets to).
std::uint64_t most_lattice_points(const Box& box, double size) {
  const Point sides = (1 / (kLatticeSpacing * size)) * (box.max - box.min);
  return static_cast<std::uint64_t>(2 * (sides.x + 1) * (sides.y + 1) * (sides.z + 1));
}
std::uint64_t most_samples(double area, double size) {
  return static_cast<std::uint64_t>(2 * area / (size * size));
}

// LeafInfo::reached_size. Interpolated, h may change faster than it should, and jumps a little from
// cube to cube: so this is looked up. Even with that, it doubles nowhere within the distance that
// is looked at.
double reached_size(const RunView& run, MortonKey leaf) {
  const Box box = run.box(leaf);
  double most = run.leaves().info(leaf).largest_size;
  for (const MortonKey other :
       run.octree().leaves_within(run.frame(), box, run.reach_of(leaf, kReach))) {
    if (run.leaves().info(other).largest_size <= most) continue;
    for (const SizeCube& cube : run.leaves().sizes(other).cubes) {
      const double size = size_range(run.parameters().sizes(), run.frame(), {&cube, 1}).most;
      const double farthest = 0.5 * kReach * size;
      if (size > most && box.squared_distance(run.frame().box(cube.key)) <= farthest * farthest)
        most = size;
    }
  }
  return most;
}

class CoverStage : public VisitingStage<CoverInput, CoverPoints> {
 public:
  using VisitingStage::VisitingStage;

  // Sizes are known all around only now: so far copies reached less far.
  std::vector<Step> steps_before() override {
    if (state_.is_uniform()) return {};
    return {[this, n = std::size_t{0}]() mutable {
      const auto leaves = state_.octree().leaves();
      while (n < leaves.size()) {
        throw_if_stopped(&tools_.stop);
        const MortonKey leaf = leaves[n++];
        if (state_.is_own(leaf))
          state_.records().put_reached_size(leaf, reached_size(state_, leaf));
        state_.leaves().trim();
        if (state_.commits().is_due()) break;
      }
      return n < leaves.size();
    }};
  }
  // With mirrors.
  bool changes_others() const override { return state_.run().has_creases; }
  double conflict_distance(MortonKey leaf) const override {
    return conflict_of_cover(state_, leaf);
  }
  Phase end() override {
    const Phase next = next_phase(state_.run(), Phase::kCover);
    if (next == Phase::kRefine) begin_refinement(state_, &tools_.stop);
    return next;
  }

 protected:
  Loaded<CoverInput> load_input(MortonKey leaf) override {
    const double size = state_.surface_size(leaf);
    const Box box = state_.box(leaf);
    const bool has_surface = state_.leaves().info(leaf).has_surface();
    const double farthest = kDistanceSlack * kCreasedReach * size;
    const std::vector<MeshPoint> crease_points =
        has_surface ? around_.crease_points(leaf, farthest) : std::vector<MeshPoint>();
    const bool are_sides_apart =
        has_surface && (!crease_points.empty() || around_.are_sides_apart());
    std::vector<MeshPoint> around;
    if (are_sides_apart)
      around = around_.samples(leaf, farthest);
    else if (has_surface)
      around = samples_around(leaf);
    const bool has_volume = !state_.parameters().is_surface_only;
    const bool has_deep_points = has_volume && state_.is_uniform();
    double distance = kDistanceSlack * (has_deep_points ? kCoreDepth : 1.0) * size;
    if (are_sides_apart) distance = std::max(distance, farthest);
    const double least = state_.least_size(leaf);
    DomainPiece domain = around_.domain(leaf, distance, fineness(kFinenessOfCover, least));
    const bool has_shapes = state_.parameters().sizes().has_shapes();
    SizeCubes sizes = are_sides_apart && has_shapes
                          ? around_.sizes_within(leaf, farthest)
                          : around_.sizes(leaf, has_shapes ? sample_radius(false) : 0);
    const std::uint64_t num_lattice = !has_volume           ? 0
                                      : state_.is_uniform() ? most_lattice_points(box, size)
                                      : sizes.law.has_core()
                                          ? most_lattice_points(box, sizes.law.most)
                                          : 9 * sizes.cubes.size();
    const VisitSize visit{.volume = volume_over_size(domain.region, least),
                          .num_points = around.size() + crease_points.size() + num_lattice +
                                        most_samples(domain.area(), size),
                          .surface_size = domain.surface_size()};
    Loaded<CoverInput> loaded;
    loaded.bytes = visit.bytes_to_cover();
    loaded.input = {.size = size,
                    .seed = state_.parameters().seed,
                    .lattice = state_.lattice(),
                    .box = box,
                    .domain = std::move(domain),
                    .nearby_samples = positions_of(around),
                    .crease_points = positions_of(crease_points),
                    .are_sides_apart = are_sides_apart,
                    .is_surface_only = !has_volume,
                    .sizes = std::move(sizes)};
    return loaded;
  }

  CoverPoints compute(CoverInput&& input) const override {
    return cover_leaf(std::move(input), &tools_.stop);
  }

  void apply_result(MortonKey leaf, const CoverPoints& points) override {
    const auto require_own = [&](const Point& position) {
      if (state_.frame().key_of(position, leaf.level()) != leaf)
        throw RefineError("its cover has a point outside its box");
    };
    state_.queue().dequeue(leaf);
    for (const LatticeSite& site : points.lattice) require_own(state_.points().add(site).position);
    for (const Point& p : points.samples) {
      if (!changes_others()) require_own(p);
      state_.points().add(p, PointKind::kSurface);
      if (changes_others()) enqueue_owner(p);
    }
    if (!state_.is_beyond(leaf) && state_.leaves().info(leaf).num_points > 0)
      state_.queue().enqueue(leaf);
    if (!points.core.is_empty()) state_.points().put_core(leaf, points.core);
  }

 private:
  // Of other leaves within r_s, and the leaf's own, which are mirrors of theirs.
  std::vector<MeshPoint> samples_around(MortonKey leaf) const {
    std::vector<MeshPoint> around = around_.points(leaf, sample_radius(state_.is_uniform()));
    if (state_.run().has_creases) {
      const std::vector<MeshPoint>& own = state_.leaves().points(leaf).points;
      around.insert(around.end(), own.begin(), own.end());
      std::ranges::sort(around, {}, &MeshPoint::id);
    }
    std::erase_if(around, [](const MeshPoint& p) { return p.kind != PointKind::kSurface; });
    return around;
  }
  static std::vector<Point> positions_of(const std::vector<MeshPoint>& points) {
    std::vector<Point> positions;
    positions.reserve(points.size());
    for (const MeshPoint& point : points) positions.push_back(point.position);
    return positions;
  }

  // A mirror may be all that a leaf has which has been covered.
  void enqueue_owner(const Point& p) { state_.queue().enqueue(state_.owner_of(p)); }
};

}  // namespace

std::unique_ptr<LeafStage> cover_stage(const StageTools& tools) {
  return std::make_unique<CoverStage>(tools);
}

}  // namespace locvol
