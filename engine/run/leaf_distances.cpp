#include "engine/run/leaf_distances.h"

#include "engine/plan/phases.h"
#include "refine/cover_leaf.h"
#include "refine/crease_leaf.h"
#include "refine/fill_leaf.h"
#include "refine/measure_leaf.h"
#include "refine/refine_leaf.h"
#include "refine/size_leaf.h"

namespace locvol {
namespace {

constexpr double kConflictSlack = 1.01;

// How far apart visits are independent for what they read and write of the core. Others are too far
// from it (kCoreMargin) to read of it, or to insert close to it.
double conflict_at_core(const RunParameters& p, const LeafInfo& info) {
  if (info.largest_size < p.max_size) return 0;  // which may be infinite
  const double read = std::max(kCoreReach, reach_factor(p.growth, kReach));
  return kConflictSlack * (kInsertion + kLatticeStar + read) * p.max_size;
}

// Where sizes vary, a visit inserts where h is at least 2 / kReach of the distance, and has those
// within the reach of that look; it reads within the reach. `reached`: LeafInfo::reached_size, or
// more
double graded_conflict(const RunParameters& p, const LeafInfo& info, double reached) {
  const double reach = reach_factor(p.growth, kReach);
  return std::max({conflict_at_core(p, info), kConflictSlack * 2 * reach * info.largest_size,
                   kConflictSlack * (0.5 * kReach + reach) * reached});
}

}  // namespace

double touch_distance(const RunRecord& run, const LeafInfo& info) {
  const RunParameters& p = run.parameters;
  if (p.growth == 0) return kTouch * p.size;
  if (!are_sizes_known(run.phase)) {
    const SizeRules rules{p.per_circle, p.deviation,     p.layers,
                          p.min_size,   p.spacing_floor, p.growth};
    return kConflictSlack * std::max(kExactDistance * p.size, measure_reach(rules, p.size));
  }
  // As long as it is not known, no more than twice as large (reached_size()).
  const double reached = info.reached_size > 0 ? info.reached_size : 2 * info.largest_size;
  const double reach = reach_factor(p.growth, kReach);
  // A visit moves the vertices of balls that are centered as far as it puts points, and deletes as
  // near to those; others look around where these were.
  const double of_moved = (0.5 * kReach + 1 + reach * (1 + p.growth)) * reached;
  return std::max({graded_conflict(p, info, reached), kConflictSlack * of_moved,
                   kConflictSlack * 2 * reach * info.largest_size + p.size,   // merge_sites()
                   kConflictSlack * 0.5 * reach * (1 + p.growth) * p.size});  // surface
}

double conflict_of_creases(const RunView& run, MortonKey leaf) {
  return kConflictSlack * kCreaseReach * run.surface_size(leaf);
}

double conflict_of_cover(const RunView& run, MortonKey leaf) {
  if (run.run().has_creases)
    return kConflictSlack * (kCreasedReach + kMirrorDistance) * run.surface_size(leaf);
  const double radius = sample_radius(run.is_uniform());
  return kConflictSlack * std::min(run.reach_of(leaf, radius),
                                   reach_factor(run.parameters().growth, radius) * run.size());
}

double conflict_of_fill(const RunView& run, MortonKey leaf) {
  if (run.is_uniform()) return kConflict * run.size();
  const RunParameters& p = run.parameters();
  const LeafInfo& info = run.leaves().info(leaf);
  return std::max(conflict_at_core(p, info),
                  kConflictSlack * reach_factor(p.growth, kFillReach) * info.largest_size);
}

double conflict_of_refinement(const RunView& run, MortonKey leaf) {
  if (run.is_uniform()) return kConflict * run.size();
  const LeafInfo& info = run.leaves().info(leaf);
  return graded_conflict(run.parameters(), info, info.reached_size);
}

}  // namespace locvol
