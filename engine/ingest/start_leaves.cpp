#include "engine/ingest/start_leaves.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <span>
#include <utility>

#include "engine/ingest/surface_check.h"
#include "engine/plan/octree_plan.h"
#include "octree/sort_and_unite.h"
#include "refine/domain/triangle_box.h"

namespace locvol {
namespace {

// Cells, each once. Memory: 16 bytes for each.
class CellSet {
 public:
  explicit CellSet(std::size_t max_size) : max_size_(max_size) {}

  // False: there are more than wanted.
  bool add(MortonKey cell) {
    if (!cells_.empty() && cells_.back() == cell) return true;
    cells_.push_back(cell);
    if (cells_.size() > kMinWaiting + 2 * num_united_) unite();
    return num_united_ <= max_size_;
  }
  std::vector<MortonKey> take() {
    unite();
    return std::move(cells_);
  }

 private:
  void unite() {
    sort_and_unite(cells_);
    num_united_ = cells_.size();
  }

  static constexpr std::size_t kMinWaiting = std::size_t{1} << 16;

  std::size_t max_size_, num_united_ = 0;
  std::vector<MortonKey> cells_;
};

// Finds the leaves within a distance of triangles, and perhaps some close beyond. `distance`: of
// those of the plan's level; of smaller ones, as much less.
class NearCells {
 public:
  NearCells(const OctreePlan& plan, StartSides& sides, double distance)
      : frame_(plan.frame),
        root_(plan.frame.root_box()),
        level_(plan.level),
        distance_(distance),
        sides_(sides) {}

  // False: there are more than a run may start with.
  bool add(const Triangle& triangle) {
    const Box reach = triangle.box().expanded(distance_);
    if (has_last_ && contains(last_box_, reach)) return true;
    const MortonKey low = frame_.key_of(in_root(reach.min), level_);
    const MortonKey high = frame_.key_of(in_root(reach.max), level_);
    MortonKey node = low;
    while (!node.is_ancestor_or_self_of(high)) node = node.parent();
    if (!sides_.is_narrow(node)) return descend(node, triangle, reach);
    has_last_ = true;
    last_box_ = frame_.box(node);
    return cells_.add(node);
  }

  std::optional<std::vector<MortonKey>> take() {
    std::vector<MortonKey> cells = cells_.take();
    if (cells.size() > kMaxStartLeaves) return std::nullopt;
    return cells;
  }

 private:
  static bool contains(const Box& outer, const Box& inner) {
    return outer.contains(inner.min) && outer.contains(inner.max);
  }

  bool descend(MortonKey node, const Triangle& triangle, const Box& reach) {
    const Box box = frame_.box(node);
    const double distance = std::ldexp(distance_, std::min(0, level_ - node.level()));
    if (!reach.overlaps(box) || !meets(triangle, box.expanded(distance))) return true;
    if (sides_.is_narrow(node)) return cells_.add(node);
    for (int octant = 0; octant < 8; ++octant)
      if (!descend(node.child(octant), triangle, reach)) return false;
    return true;
  }

  Point in_root(Point p) const {
    for (int axis = 0; axis < 3; ++axis)
      p[axis] = std::clamp(p[axis], root_.min[axis], std::nextafter(root_.max[axis], -HUGE_VAL));
    return p;
  }

  const Frame& frame_;
  Box root_;
  int level_;
  double distance_;
  StartSides& sides_;
  CellSet cells_{kMaxStartLeaves};
  bool has_last_ = false;
  Box last_box_;
};

// Of the cells near the share's triangles; nothing, if there will be too many leaves.
std::optional<std::vector<MortonKey>> own_near_cells(const CheckedSurface& surface, NearCells near,
                                                     IngestWatch& watch) {
  for (const TriangleBucket& bucket : surface.buckets.all()) {
    const Box cell = surface.buckets.frame().box(bucket.cell);
    bool are_few = true;
    surface.spill.for_each(bucket.triangles, [&](const Triangle& t) {
      if (are_few && owns_triangle(cell, t)) are_few = near.add(t);
    });
    if (!are_few) return std::nullopt;
    watch.advance(bucket.triangles.count);
  }
  return near.take();
}

// Nothing, if there will be too many leaves.
std::optional<std::vector<MortonKey>> near_cells_if_few(const CheckedSurface& surface,
                                                        const RunParameters& parameters,
                                                        IngestWatch& watch,
                                                        const IngestShare& share) {
  const OctreePlan plan = plan_octree(parameters, surface.facts.box);
  StartSides sides(parameters, plan);
  if (sides.is_narrow(MortonKey::root())) return std::vector{MortonKey::root()};
  const double num_inside = surface.facts.volume / std::pow(plan.frame.side(plan.level), 3);
  if (!(num_inside <= kMaxStartLeaves)) return std::nullopt;
  auto cells = own_near_cells(surface, {plan, sides, parameters.size}, watch);
  share.join_cells(cells);
  if (!cells || static_cast<double>(LinearOctree::coarsest_with(*cells).size()) + num_inside >
                    kMaxStartLeaves)
    return std::nullopt;
  return cells;
}

}  // namespace

std::vector<MortonKey> cells_near_surface(const CheckedSurface& surface,
                                          const RunParameters& parameters, IngestWatch& watch,
                                          const IngestShare& share) {
  if (auto cells = near_cells_if_few(surface, parameters, watch, share)) return std::move(*cells);
  RunParameters larger = parameters;
  do {
    larger.size *= 1.5;
    for (SizeShape& shape : larger.shapes) shape.size *= 1.5;
  } while (!near_cells_if_few(surface, larger, watch, share));
  if (!parameters.shapes.empty())
    share.refuse(
        fmt::format("the sizes, from {} on, with {} points to a leaf need more than {} leaves: "
                    "choose sizes {:.3g} "
                    "times as large, or a larger leaf capacity",
                    parameters.sizes().least, parameters.leaf_capacity, kMaxStartLeaves,
                    1.01 * larger.size / parameters.size));
  share.refuse(fmt::format(
      "size {} with {} points to a leaf needs more than {} leaves: choose a size of at least "
      "{:.3g}, or a larger leaf capacity",
      parameters.size, parameters.leaf_capacity, kMaxStartLeaves, 1.01 * larger.size));
}

}  // namespace locvol
