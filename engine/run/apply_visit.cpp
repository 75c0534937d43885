#include "engine/run/apply_visit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "engine/plan/octree_plan.h"
#include "engine/run/core_around.h"
#include "engine/run/leaf_sides.h"
#include "engine/run/unresolved_sites.h"
#include "refine/surface_patch.h"

namespace locvol {
namespace {

void count_core_cells(RunState& state, MortonKey leaf) {
  if (state.is_own(leaf)) state.put_num_core_cells(leaf, num_core_cells(state, leaf));
}

// The leaf's points, triangles and known side go to its children.
void split_leaf(RunState& state, MortonKey leaf) {
  if (state.holding(leaf) == Holding::kBeyond) return;
  std::array<RunState::Child, 8> children;
  const LeafPoints& own = state.leaves().points(leaf);
  for (const MeshPoint& point : own.points) {
    const MortonKey owner = state.run().frame.key_of(point.position, leaf.level() + 1);
    children[static_cast<std::size_t>(owner.octant())].points.points.push_back(point);
  }
  std::array<std::uint8_t, 8> parities{};
  const std::vector<Triangle>& triangles = state.leaves().surface(leaf).triangles;
  LeafSizes sizes;
  if (!state.is_uniform()) sizes = state.leaves().sizes(leaf);
  for (int octant = 0; octant < 8; ++octant) {
    const auto i = static_cast<std::size_t>(octant);
    const Box box = state.box(leaf.child(octant));
    const MortonKey child = leaf.child(octant);
    const auto is_in_child = [&](MortonKey key) {
      return child.is_ancestor_or_self_of(key) || key.is_ancestor_or_self_of(child);
    };
    std::ranges::copy_if(sizes.cubes, std::back_inserter(children[i].sizes.cubes), is_in_child,
                         &SizeCube::key);
    std::ranges::copy_if(sizes.nodes, std::back_inserter(children[i].sizes.nodes), is_in_child,
                         &SizedNode::key);
    auto& met = children[i].surface.triangles;
    std::ranges::copy_if(triangles, std::back_inserter(met),
                         [&](const Triangle& t) { return meets(t, box); });
    parities[i] = center_to_corner_parities(met, box);
    children[i].points.core = clipped(own.core, state.sites(leaf.child(octant)));
  }
  const std::vector<bool> sides =
      center_sides_of_children(state.leaves().info(leaf).is_center_inside, parities);
  for (std::size_t i = 0; i < children.size(); ++i) children[i].is_center_inside = sides[i];
  state.split(leaf, std::move(children));
  for (int octant = 0; octant < 8; ++octant) count_core_cells(state, leaf.child(octant));
}

class VisitChanges {
 public:
  VisitChanges(RunState& state, LeafLoader& loader, MortonKey leaf)
      : state_(state), loader_(loader), leaf_(leaf), box_(state.box(leaf)) {}

  void apply(const LeafDelta& delta) {
    state_.dequeue(leaf_);
    std::size_t n = 0;
    const auto size_at = [&](const Point& p, bool is_asked = true) {
      if (!delta.sizes.empty()) return delta.sizes.at(n++);
      return is_asked ? state_.size_at(p) : 0;
    };
    for (const InsertedPoint& point : delta.inserted)
      insert(point, size_at(point.position, !point.is_deleted && !point.changed));
    for (const MeshPoint& point : delta.deleted) erase(point, size_at(point.position));
    for (const MeshPoint& point : delta.moved) take_away(point);
    for (const Point& place : delta.left) have_others_look(place, size_at(place));
    state_.add_visit(leaf_, delta.stats);
    if (!delta.is_overfull) {
      state_.put_cells(leaf_, {ids_of(delta.cells.vertices), delta.cells.cells});
      state_.put_facets(leaf_, {ids_of(delta.facets.vertices), delta.facets.facets});
      change_others(delta.others_gone, delta.others_made);
      change_others(delta.others_facets_gone, delta.others_facets_made);
      for (const PoorCell& cell : delta.poor) have_others_try(cell);
      store_unresolved(delta.unresolved);
      if (delta.unresolved.empty())
        state_.allow_short_visit(leaf_);
      else
        state_.require_whole_visit(leaf_);
    }
    for (const std::uint64_t id : delta.met_core) make_explicit(state_, site_of(id));
    if (delta.is_overfull) split_leaf(state_, leaf_);
  }

 private:
  // `size`: h there
  void insert(const InsertedPoint& point, double size) {
    if (point.is_deleted) return ids_.push_back(std::nullopt);
    const MeshPoint added = state_.add_point(point.position, point.kind);
    ids_.push_back(added.id);
    loader_.note_inserted(added);
    if (point.changed)
      enqueue_owners(*point.changed);
    else
      enqueue_around(point.position, reach_of_size(size, kNeighborhood));
  }

  void erase(const MeshPoint& point, double size) {
    take_away(point);
    const double reach = reach_of_size(size, kReach);
    enqueue_around(point.position, reach);
    // A later visit knows the points that came by their ids; of those that went it would know
    // nothing.
    for (const MortonKey other : leaves_within(point.position, reach))
      if (other != leaf_) state_.require_whole_visit(other);
  }

  // They would look for what the point changed where it is now.
  void have_others_look(const Point& place, double size) {
    for (const MortonKey other : leaves_within(place, reach_of_size(size, kNeighborhood)))
      if (other != leaf_ && state_.leaves().info(other).queued) state_.ask_for_visit(other, place);
  }

  double reach_of_size(double size, double k) const {
    return reach_factor(state_.run().parameters.growth, k) * size;
  }

  // What a move changes of other leaves, the delta tells.
  void take_away(const MeshPoint& point) {
    state_.remove_point(point);
    loader_.note_deleted(point);
  }

  void have_others_try(const PoorCell& cell) {
    for (const Point& p : cell.others)
      state_.ask_for_visit(state_.octree().leaf_owning(state_.run().frame, p), p);
  }

  // A leaf that waits for a whole visit will list all anew. Of what one lists that waits for a
  // short one some may be gone, which that visit finds.
  template <class List>
  void change_others(const std::vector<OfOther<List>>& gone,
                     const std::vector<OfOther<List>>& made) {
    std::map<MortonKey, Changes<List>> changes;
    const auto add = [&](const std::vector<OfOther<List>>& items, auto list) {
      for (OfOther<List> item : items) {
        for (VertexRef& v : vertices_in(item.name)) v = id_of(v);
        const MortonKey owner = state_.octree().leaf_owning(state_.run().frame, item.smallest);
        (changes[owner].*list).push_back(item.name);
      }
    };
    add(gone, &Changes<List>::gone);
    add(made, &Changes<List>::made);
    for (auto& [owner, change] : changes) {
      const LeafInfo& info = state_.leaves().info(owner);
      if (info.queued && info.first_new_id == 0) continue;
      change.is_strict = !info.queued;
      state_.change(owner, change);
    }
  }

  std::vector<MortonKey> leaves_within(const Point& p, double distance) const {
    return state_.octree().leaves_within(state_.run().frame, Box::around(p), distance);
  }

  // The other leaves within the distance. Leaves without points have nothing to restore: they are
  // enqueued with the point that gives them one.
  void enqueue_around(const Point& changed, double distance) {
    if (is_deeper(changed, distance)) return;
    for (const MortonKey other : leaves_within(changed, distance))
      if (other != leaf_ && state_.leaves().info(other).num_points > 0) state_.enqueue(other);
  }

  // Of other leaves' points.
  void enqueue_owners(const std::vector<Point>& points) {
    for (const Point& p : points)
      if (const MortonKey owner = state_.octree().leaf_owning(state_.run().frame, p);
          owner != leaf_)
        state_.enqueue(owner);
  }

  // Spares most points the search.
  bool is_deeper(const Point& p, double distance) const {
    return box_.expanded(-distance).contains(p);
  }

  // The ids of new points ascend in order of insertion, and are larger than all others: the list of
  // vertices stays in order.
  std::vector<std::uint64_t> ids_of(const std::vector<VertexRef>& vertices) const {
    std::vector<std::uint64_t> ids;
    ids.reserve(vertices.size());
    for (const VertexRef ref : vertices) ids.push_back(id_of(ref));
    return ids;
  }

  std::uint64_t id_of(VertexRef ref) const {
    if ((ref & kNewPoint) == 0) return ref;
    const auto id = ids_.at(ref & ~kNewPoint);
    if (!id) throw RefineError("a cell or facet has a vertex that was deleted");
    return *id;
  }

  void store_unresolved(const std::vector<Violation>& violations) {
    if (state_.holding(leaf_) == Holding::kBeyond) return;
    if (violations.empty() && state_.leaves().info(leaf_).num_unresolved == 0) return;
    std::vector<UnresolvedSite> sites;
    for (const Violation& v : violations)
      sites.push_back({static_cast<std::uint8_t>(v.condition), v.position, v.radius});
    state_.put_unresolved(leaf_, {thinned(sites, {}, state_.size())});
  }

  RunState& state_;
  LeafLoader& loader_;
  MortonKey leaf_;
  Box box_;
  std::vector<std::optional<std::uint64_t>> ids_;  // of the inserted points, unless deleted again
};

}  // namespace

LeafDelta with_sizes(RunState& state, LeafDelta delta) {
  if (state.is_uniform()) return delta;
  for (const InsertedPoint& point : delta.inserted)
    delta.sizes.push_back(state.size_at(point.position));
  for (const MeshPoint& point : delta.deleted) delta.sizes.push_back(state.size_at(point.position));
  for (const Point& place : delta.left) delta.sizes.push_back(state.size_at(place));
  return delta;
}

void apply_visit(RunState& state, LeafLoader& loader, MortonKey leaf, const LeafDelta& delta) {
  VisitChanges(state, loader, leaf).apply(delta);
}

void apply_measure(RunState& state, MortonKey leaf, std::vector<SizedNode> nodes) {
  state.dequeue(leaf);
  const std::vector<SizedNode>& of_image = state.leaves().sizes(leaf).nodes;
  nodes.insert(nodes.end(), of_image.begin(), of_image.end());
  unite(nodes);
  state.put_sizes(leaf, {.cubes = {}, .nodes = std::move(nodes)});
  state.enqueue(leaf);
}

void apply_sizes(RunState& state, MortonKey leaf, std::vector<SizeCube> cubes) {
  state.dequeue(leaf);
  state.put_sizes(leaf, {.cubes = std::move(cubes), .nodes = state.leaves().sizes(leaf).nodes});
  state.enqueue(leaf);
}

// Or has it much smaller cells somewhere than leaves so wide are made for? Measured: 0.75 to h³
// inside, and as many to h² of a cube's side where the surface passes through.
bool is_to_be_full(RunState& state, MortonKey leaf) {
  const RunParameters& parameters = state.run().parameters;
  const SizeLaw law = parameters.sizes();
  const std::vector<SizeCube>& cubes = state.leaves().sizes(leaf).cubes;
  if (!law.has_shapes() || cubes.empty() || leaf.level() == MortonKey::kMaxLevel) return false;
  constexpr double kPoints = 0.75;
  const Frame& frame = state.run().frame;
  // Grids are as fine in all of it as it takes somewhere.
  const double widest = 1.001 * start_leaf_side(parameters) / parameters.size;
  if (frame.side(leaf.level()) > widest * state.least_size(leaf)) return true;
  double num_points = 0;
  for (const SizeCube& cube : cubes) {
    const auto [nearest, farthest] = std::ranges::minmax(cube.distance);
    if (farthest < 0 || is_of_core(law, cube)) continue;
    const Box box = frame.box(cube.key);
    const double side =
        std::min(frame.side(cube.key.level()), frame.side(leaf.level()));  // may be split below it
    const double over_size = side / size_in(law, cube, box, box.center());
    num_points += kPoints * (nearest > 0 ? over_size : 1) * over_size * over_size;
  }
  return num_points > static_cast<double>(parameters.leaf_capacity);
}

void split_empty_leaf(RunState& state, MortonKey leaf) {
  const auto queued = state.leaves().info(leaf).queued;
  split_leaf(state, leaf);
  if (!queued) return;
  for (int octant = 0; octant < 8; ++octant) {
    const LeafInfo& info = state.leaves().info(leaf.child(octant));
    if (info.num_triangles > 0 || info.is_center_inside)
      state.enqueue(leaf.child(octant), queued->epoch);
  }
}

SizeTotals size_totals(RunState& state, MortonKey leaf) {
  SizeTotals totals;
  for (const SizeCube& cube : state.leaves().sizes(leaf).cubes)
    totals += size_totals(state.run().parameters.sizes(), cube, state.box(cube.key));
  // In whole steps, sums of leaves do not depend on their order: below 2^43 cells.
  constexpr double kSteps = 1 << 10;
  const auto in_steps = [](double v) { return std::round(kSteps * v) / kSteps; };
  return {in_steps(totals.of_volume), in_steps(totals.of_area), in_steps(totals.of_lattice),
          in_steps(totals.of_core)};
}

void apply_cover(RunState& state, MortonKey leaf, const CoverPoints& points) {
  const auto require_own = [&](const Point& position) {
    if (state.run().frame.key_of(position, leaf.level()) != leaf)
      throw RefineError("its cover has a point outside its box");
  };
  state.dequeue(leaf);
  for (const LatticeSite& site : points.lattice)
    require_own(state.add_lattice_point(site).position);
  for (const Point& p : points.samples) {
    require_own(p);
    state.add_point(p, PointKind::kSurface);
  }
  if (!points.samples.empty() || !points.lattice.empty()) state.enqueue(leaf);
  if (!points.core.is_empty()) state.put_core(leaf, points.core);
}

void apply_fill(RunState& state, MortonKey leaf, const FillPoints& points) {
  state.dequeue(leaf);
  for (const Point& center : points.centers) state.add_point(center, PointKind::kVolume);
  for (const std::uint64_t id : points.met_core) list_core_point(state, site_of(id));
}

void enqueue_for_refinement(RunState& state, const StopToken* stop) {
  const auto leaves = state.octree().leaves();
  std::vector<std::uint64_t> num_cells;  // of the core: to count them takes most of the time
  num_cells.reserve(leaves.size());
  for (const MortonKey leaf : leaves) {
    throw_if_stopped(stop);
    num_cells.push_back(state.is_own(leaf) ? num_core_cells(state, leaf) : 0);
    state.leaves().trim();
  }
  for (std::size_t i = 0; i < leaves.size(); ++i) {
    const MortonKey leaf = leaves[i];
    if (state.leaves().info(leaf).num_points > 0) state.enqueue(leaf);
    state.put_num_core_cells(leaf, num_cells[i]);
    state.leaves().trim();
  }
}

}  // namespace locvol
