#include "engine/stages/refine_stage.h"

#include <algorithm>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "engine/plan/octree_plan.h"
#include "engine/ranks/rank_visits.h"
#include "engine/run/core_around.h"
#include "engine/run/leaf_distances.h"
#include "engine/run/listed_cells.h"
#include "engine/run/mend_leaf.h"
#include "engine/stages/apply_visit.h"
#include "engine/stages/stages.h"
#include "engine/stages/visiting_stage.h"
#include "refine/crease_leaf.h"
#include "refine/refine_leaf.h"

namespace locvol {
namespace {

constexpr GridFineness kFine{3.2, 48}, kCoarse{6, 128};

// A visit that inserts more than any mesh needs is a bug.
std::uint64_t max_insertions(std::uint64_t leaf_capacity) { return 50 * leaf_capacity + 100000; }

std::optional<LastVisit> last_visit(const RunView& run, MortonKey leaf) {
  const LeafInfo& info = run.leaves().info(leaf);
  if (info.first_new_id == 0) return std::nullopt;
  LeafCells held = run.leaves().cells(leaf);
  LeafFacets facets = run.leaves().facets(leaf);
  std::vector<Point> asked = std::move(held.asked);
  return LastVisit{info.first_new_id,
                   listed_cells(std::move(held)),
                   {std::move(facets.vertices), std::move(facets.facets)},
                   std::move(asked)};
}

// In cover mode few points are added to those that cover the domain; in paper mode a leaf fills up
// until it is split.
std::uint64_t most_points_of_visit(const RunView& run, std::uint64_t num_own,
                                   std::uint64_t num_ghosts) {
  const std::uint64_t num_local = num_own + num_ghosts;
  if (run.is_cover()) return num_local + num_local / 5 + 100;
  const std::uint64_t capacity = run.parameters().leaf_capacity;
  return 2 * std::max(num_own, capacity) + num_ghosts;
}

Criteria criteria(const RunView& run, MortonKey leaf) {
  const RunParameters& p = run.parameters();
  if (!run.is_cover())
    return Criteria::of_paper(p.size, p.radius_edge_bound, p.spacing_floor, p.min_dihedral);
  Criteria criteria = Criteria::of_cover(run.surface_size(leaf), p.radius_edge_bound,
                                         p.spacing_floor, p.min_dihedral, p.growth);
  criteria.is_surface_only = p.is_surface_only;
  return criteria;
}

// κ, or no bound where the children would be too small: below some λ, or a tenth of what leaves are
// at the start, they load so many ghosts that a dense sheet takes twice as long, to save a third of
// the memory.
std::uint64_t max_own_points(const RunView& run, MortonKey leaf) {
  if (leaf.level() == MortonKey::kMaxLevel) return 0;
  const RunParameters& parameters = run.parameters();
  const double start = run.is_cover() ? start_leaf_side(parameters) : 0;
  const double size = std::min(run.size(), run.least_size(leaf));
  const double least = std::max(kMinChildSide * size, 0.1 * start * (size / run.size()));
  return run.frame().side(leaf.level() + 1) >= least ? parameters.leaf_capacity : 0;
}

// As far as circumcenters of cells at own points lie.
std::vector<Box> waiting_around(const RunView& run, MortonKey leaf) {
  std::vector<Box> waiting;
  if (run.parameters().min_dihedral == 0) return waiting;
  // One that has come into the queue since for want of a listed point, all of the core before,
  // waits for a later epoch: a visit far away may have made it do so, or be about to.
  const auto& own = run.leaves().info(leaf).queued;
  const auto is_of_epoch = [epoch = own ? own->epoch : run.run().epoch](const LeafInfo& info) {
    return info.queued && info.queued->epoch <= epoch;
  };
  for (const MortonKey other : run.octree().leaves_within(run.frame(), run.box(leaf),
                                                          0.5 * run.reach_of(leaf, kNeighborhood)))
    if (const LeafInfo& info = run.leaves().info(other);
        other != leaf && is_of_epoch(info) && info.num_visits == 0)
      waiting.push_back(run.box(other));
  return waiting;
}

class RefineStage : public VisitingStage<LeafInput, LeafDelta> {
 public:
  using VisitingStage::VisitingStage;

  bool is_once() const override { return false; }
  double conflict_distance(MortonKey leaf) const override {
    return conflict_of_refinement(state_, leaf);
  }

  Phase end() override {
    if (!any(tools_.exchange, state_.run().counts.num_unresolved > 0)) return Phase::kDone;
    enqueue_for_mending(state_);
    if (!state_.parameters().is_surface_only) share_cells(state_, tools_.exchange);
    return Phase::kMend;
  }

 protected:
  Loaded<LeafInput> load_input(MortonKey leaf) override {
    return load_refine(state_, around_, tools_.model, leaf);
  }

  LeafDelta compute(LeafInput&& input) const override {
    return refine_leaf(std::move(input), {.stop = &tools_.stop}, tools_.model.whole());
  }

  void apply_result(MortonKey leaf, const LeafDelta& delta) override {
    apply_visit(state_, tools_.model, leaf, delta);
  }

  // Without the lists of cells and facets; with the sizes that another rank may have to know to
  // apply it.
  std::string for_others(const LeafDelta& delta) const override {
    LeafDelta others = with_sizes(state_, delta);
    others.cells = {};
    others.facets = {};
    return pack(others);
  }
};

}  // namespace

Loaded<LeafInput> load_refine(const RunView& run, const Surroundings& around, HeldModel& model,
                              MortonKey leaf) {
  const double size = run.surface_size(leaf);
  double distance =
      run.is_uniform() ? kDistanceSlack * kReach / 2 * size : around.surface_reach(leaf);
  // Where creases are, the sheets of all vertices are asked for, and those that they have mirrors
  // on.
  std::vector<MeshPoint> crease_points =
      around.crease_points(leaf, 2 * distance + kCreaseStep * size);
  const bool are_sides_apart = !crease_points.empty() || around.are_sides_apart();
  if (are_sides_apart) distance *= 2;
  model.keep_memory_of_points();
  std::vector<MeshPoint> own = run.leaves().points(leaf).points;
  std::vector<MeshPoint> ghosts = around.points(leaf, run.is_cover() ? kReach : kNeighborhood);
  std::optional<LastVisit> last = last_visit(run, leaf);
  const double least = run.least_size(leaf);
  DomainPiece domain;  // in paper mode the model has it
  if (run.is_cover())
    domain = around.domain(leaf, distance, fineness(last ? kCoarse : kFine, least));
  const VisitSize visit{.volume = run.is_cover() ? volume_over_size(domain.region, least) : 0,
                        .num_points = most_points_of_visit(run, own.size(), ghosts.size()),
                        .surface_size = domain.surface_size()};
  Loaded<LeafInput> loaded;
  loaded.bytes = visit.bytes_to_refine();
  loaded.input = {.criteria = criteria(run, leaf),
                  .box = run.box(leaf),
                  .own = std::move(own),
                  .ghosts = std::move(ghosts),
                  .domain = std::move(domain),
                  .core = {},
                  .max_own_points = max_own_points(run, leaf),
                  .last_visit = std::move(last),
                  .max_insertions = max_insertions(run.parameters().leaf_capacity)};
  if (!run.is_cover()) return loaded;
  loaded.input.crease_points = std::move(crease_points);
  loaded.input.are_sides_apart = are_sides_apart;
  loaded.input.waiting = waiting_around(run, leaf);
  loaded.input.core = core_around(run, leaf, kCoreReach * core_size(run.parameters()));
  loaded.input.sizes = around.sizes(leaf, kReach);
  return loaded;
}

std::unique_ptr<LeafStage> refine_stage(const StageTools& tools) {
  return std::make_unique<RefineStage>(tools);
}

}  // namespace locvol
