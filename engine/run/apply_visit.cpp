#include "engine/run/apply_visit.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "engine/run/core_around.h"
#include "engine/run/leaf_sides.h"
#include "engine/run/unresolved_sites.h"
#include "refine/surface_patch.h"

namespace locvol {
namespace {

class Visit {
 public:
  Visit(RunState& state, LeafLoader& loader, MortonKey leaf)
      : state_(state), loader_(loader), leaf_(leaf), box_(state.box(leaf)) {}

  void apply(const LeafDelta& delta) {
    state_.dequeue(leaf_);
    for (const InsertedPoint& point : delta.inserted) insert(point);
    for (const MeshPoint& point : delta.deleted) erase(point);
    count(delta);
    if (!delta.is_overfull) {
      store_cells(delta.cells);
      store_unresolved(delta.unresolved);
      state_.leaves.edit_info(leaf_).first_new_id =
          delta.unresolved.empty() ? state_.run.next_point_id : 0;
    }
    for (const std::uint64_t id : delta.met_core) make_explicit(state_, site_of(id));
    if (delta.is_overfull) split();
  }

 private:
  void insert(const InsertedPoint& point) {
    if (point.is_deleted) return ids_.push_back(std::nullopt);
    const MeshPoint added = state_.add_point(point.position, point.kind);
    ids_.push_back(added.id);
    loader_.note_inserted(added);
    if (point.changed)
      enqueue_owners(*point.changed, point.position);
    else
      enqueue_around(point.position, kNeighborhood * state_.size());
  }

  void erase(const MeshPoint& point) {
    const MortonKey owner = state_.octree.leaf_owning(state_.run.frame, point.position);
    auto& points = state_.leaves.edit_points(owner).points;
    const auto place = std::ranges::lower_bound(points, point.id, {}, &MeshPoint::id);
    if (place == points.end() || place->id != point.id)
      throw RefineError("deleted point " + std::to_string(point.id) + " is not in P");
    points.erase(place);
    --state_.leaves.edit_info(owner).num_points;
    --state_.run.num_points;
    loader_.note_deleted(point);
    enqueue_around(point.position, kReach * state_.size());
    forbid_shorter_visits(point.position);
  }

  // A later visit knows the points that came by their ids; of those that went it would know
  // nothing.
  void forbid_shorter_visits(const Point& deleted) {
    for (const MortonKey other : state_.octree.leaves_within(state_.run.frame, Box::around(deleted),
                                                             kReach * state_.size()))
      if (other != leaf_ && state_.leaves.info(other).first_new_id != 0)
        state_.leaves.edit_info(other).first_new_id = 0;
  }

  // The other leaves within the distance. Leaves without points have nothing to restore: they are
  // enqueued with the point that gives them one.
  void enqueue_around(const Point& changed, double distance) {
    if (is_deeper(changed, distance)) return;
    const Box dirty = Box::around(changed);
    for (const MortonKey other : state_.octree.leaves_within(state_.run.frame, dirty, distance))
      if (other != leaf_ && state_.leaves.info(other).num_points > 0) state_.enqueue(other, dirty);
  }

  // Of other leaves' points.
  void enqueue_owners(const std::vector<Point>& points, const Point& changed) {
    for (const Point& p : points)
      if (const MortonKey owner = state_.octree.leaf_owning(state_.run.frame, p); owner != leaf_)
        state_.enqueue(owner, Box::around(changed));
  }

  // Spares most points the search.
  bool is_deeper(const Point& p, double distance) const {
    return box_.expanded(-distance).contains(p);
  }

  void count(const LeafDelta& delta) {
    LeafInfo& info = state_.leaves.edit_info(leaf_);
    ++info.num_visits;
    ++state_.run.num_visits;
    info.num_deletions += delta.stats.deletions;
    state_.run.num_deletions += delta.stats.deletions;
    for (std::size_t c = 0; c < kNumConditions; ++c) {
      info.num_insertions[c] += delta.stats.insertions[c];
      state_.run.num_insertions[c] += delta.stats.insertions[c];
    }
  }

  // The ids of new points ascend in order of insertion, and are larger than all others: the list of
  // vertices stays in order.
  void store_cells(const CellList& list) {
    LeafCells cells;
    cells.vertices.reserve(list.vertices.size());
    for (const VertexRef ref : list.vertices) cells.vertices.push_back(id_of(ref));
    cells.cells = list.cells;
    LeafInfo& info = state_.leaves.edit_info(leaf_);
    state_.run.num_cells += cells.cells.size() - info.num_cells;  // modulo 2^64, as it should be
    info.num_cells = cells.cells.size();
    state_.leaves.put_cells(leaf_, std::move(cells));
  }

  std::uint64_t id_of(VertexRef ref) const {
    if ((ref & kNewPoint) == 0) return ref;
    const auto id = ids_.at(ref & ~kNewPoint);
    if (!id) throw RefineError("a cell has a vertex that was deleted");
    return *id;
  }

  void store_unresolved(const std::vector<Violation>& violations) {
    if (violations.empty() && state_.leaves.info(leaf_).num_unresolved == 0) return;
    std::vector<UnresolvedSite> sites;
    for (const Violation& v : violations)
      sites.push_back({static_cast<std::uint8_t>(v.condition), v.position, v.radius});
    state_.put_unresolved(leaf_, {thinned(sites, {}, state_.size())});
  }

  // The leaf's points, triangles and known side go to its children; those with points are enqueued.
  void split() {
    const LeafInfo parent = state_.leaves.info(leaf_);
    const auto [points, core] = state_.leaves.points(leaf_);
    const std::vector<Triangle> triangles = state_.leaves.surface(leaf_).triangles;
    if (parent.queued) state_.dequeue(leaf_);
    state_.run.num_cells -= parent.num_cells + parent.num_core_cells;
    state_.run.num_unresolved -= parent.num_unresolved;
    state_.leaves.erase_leaf(leaf_);
    state_.octree.split(leaf_);

    std::array<LeafPoints, 8> child_points;
    for (const MeshPoint& point : points) {
      const MortonKey owner = state_.run.frame.key_of(point.position, leaf_.level() + 1);
      child_points[static_cast<std::size_t>(owner.octant())].points.push_back(point);
    }
    for (int octant = 0; octant < 8; ++octant)
      child_points[static_cast<std::size_t>(octant)].core =
          clipped(core, state_.sites(leaf_.child(octant)));
    std::array<LeafSurface, 8> child_surfaces;
    std::array<std::uint8_t, 8> parities{};
    for (int octant = 0; octant < 8; ++octant) {
      const auto i = static_cast<std::size_t>(octant);
      const Box child_box = state_.box(leaf_.child(octant));
      std::ranges::copy_if(triangles, std::back_inserter(child_surfaces[i].triangles),
                           [&](const Triangle& t) { return meets(t, child_box); });
      parities[i] = center_to_corner_parities(child_surfaces[i].triangles, child_box);
    }
    const std::vector<bool> sides = center_sides_of_children(parent.is_center_inside, parities);
    for (int octant = 0; octant < 8; ++octant) {
      const auto i = static_cast<std::size_t>(octant);
      add_child(leaf_.child(octant), sides[i], std::move(child_points[i]),
                std::move(child_surfaces[i]));
    }
    for (int octant = 0; octant < 8; ++octant) {
      const MortonKey child = leaf_.child(octant);
      note_core_cells(state_, child, num_core_cells(state_, child));
    }
  }

  void add_child(MortonKey child, bool is_center_inside, LeafPoints points, LeafSurface surface) {
    LeafInfo info;
    info.is_center_inside = is_center_inside;
    info.num_points = points.points.size();
    info.num_core_points = num_points(points.core, state_.sites(child));
    info.num_triangles = surface.triangles.size();
    state_.leaves.add_leaf(child, info, std::move(points), std::move(surface));
    if (info.num_points > 0) state_.enqueue(child, state_.surroundings(child));
  }

  RunState& state_;
  LeafLoader& loader_;
  MortonKey leaf_;
  Box box_;
  std::vector<std::optional<std::uint64_t>> ids_;  // of the inserted points, unless deleted again
};

}  // namespace

void apply_visit(RunState& state, LeafLoader& loader, MortonKey leaf, const LeafDelta& delta) {
  Visit(state, loader, leaf).apply(delta);
}

void apply_cover(RunState& state, MortonKey leaf, const CoverPoints& points) {
  const auto require_own = [&](const Point& position) {
    if (state.run.frame.key_of(position, leaf.level()) != leaf)
      throw RefineError("its cover has a point outside its box");
  };
  state.dequeue(leaf);
  for (const LatticeSite& site : points.lattice)
    require_own(state.add_lattice_point(site).position);
  for (const Point& p : points.samples) {
    require_own(p);
    state.add_point(p, PointKind::kSurface);
  }
  if (!points.samples.empty() || !points.lattice.empty())
    state.enqueue(leaf, state.surroundings(leaf));
  if (points.core.is_empty()) return;
  const auto num_core_points = num_points(points.core, state.sites(leaf));
  state.leaves.edit_points(leaf).core = points.core;
  state.leaves.edit_info(leaf).num_core_points = num_core_points;
  state.run.num_points += num_core_points;
}

void apply_fill(RunState& state, MortonKey leaf, const FillPoints& points) {
  state.dequeue(leaf);
  for (const Point& center : points.centers) state.add_point(center, PointKind::kVolume);
  for (const std::uint64_t id : points.met_core) list_core_point(state, site_of(id));
}

void enqueue_for_refinement(RunState& state, const StopToken* stop) {
  const auto leaves = state.octree.leaves();
  std::vector<std::uint64_t> num_cells;  // of the core: to count them takes most of the time
  num_cells.reserve(leaves.size());
  for (const MortonKey leaf : leaves) {
    throw_if_stopped(stop);
    num_cells.push_back(num_core_cells(state, leaf));
    state.leaves.trim();
  }
  for (std::size_t i = 0; i < leaves.size(); ++i) {
    const MortonKey leaf = leaves[i];
    if (state.leaves.info(leaf).num_points > 0) state.enqueue(leaf, state.surroundings(leaf));
    note_core_cells(state, leaf, num_cells[i]);
    state.leaves.trim();
  }
}

}  // namespace locvol
