#include "engine/stages/apply_visit.h"

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

#include "engine/run/core_around.h"
#include "engine/run/listed_cells.h"
#include "engine/run/unresolved_sites.h"
#include "engine/stages/split_leaves.h"

namespace locvol {
namespace {

class VisitChanges {
 public:
  VisitChanges(RunState& state, HeldModel& model, MortonKey leaf)
      : state_(state), model_(model), leaf_(leaf), box_(state.box(leaf)) {}

  void apply(const LeafDelta& delta) {
    state_.queue().dequeue(leaf_);
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
    state_.records().add_visit(leaf_, delta.stats);
    if (!delta.is_overfull) {
      state_.records().put_cells(leaf_, stored_cells(ids_of(delta.cells.vertices), delta.cells));
      state_.records().put_facets(leaf_, {ids_of(delta.facets.vertices), delta.facets.facets});
      change_others(delta.others_gone, delta.others_made);
      change_others(delta.others_facets_gone, delta.others_facets_made);
      for (const PoorCell& cell : delta.poor) have_others_try(cell);
      store_unresolved(delta.unresolved);
      if (delta.unresolved.empty())
        state_.records().allow_short_visit(leaf_);
      else
        state_.records().require_whole_visit(leaf_);
    }
    for (const std::uint64_t id : delta.met_core) make_explicit(state_, site_of(id));
    if (delta.is_overfull) split_leaf(state_, leaf_);
  }

 private:
  // `size`: h there
  void insert(const InsertedPoint& point, double size) {
    if (point.is_deleted) return ids_.push_back(std::nullopt);
    const MeshPoint added = state_.points().add(point.position, point.kind);
    ids_.push_back(added.id);
    model_.note_inserted(added);
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
      if (other != leaf_) state_.records().require_whole_visit(other);
  }

  // They would look for what the point changed where it is now.
  void have_others_look(const Point& place, double size) {
    for (const MortonKey other : leaves_within(place, reach_of_size(size, kNeighborhood)))
      if (other != leaf_ && state_.leaves().info(other).queued)
        state_.records().ask_for_visit(other, place);
  }

  double reach_of_size(double size, double k) const {
    return reach_factor(state_.parameters().growth, k) * size;
  }

  // What a move changes of other leaves, the delta tells.
  void take_away(const MeshPoint& point) {
    state_.points().remove(point);
    model_.note_deleted(point);
  }

  void have_others_try(const PoorCell& cell) {
    for (const Point& p : cell.others)
      state_.records().ask_for_visit(state_.octree().leaf_owning(state_.frame(), p), p);
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
        const MortonKey owner = state_.octree().leaf_owning(state_.frame(), item.smallest);
        (changes[owner].*list).push_back(item.name);
      }
    };
    add(gone, &Changes<List>::gone);
    add(made, &Changes<List>::made);
    for (auto& [owner, change] : changes) {
      const LeafInfo& info = state_.leaves().info(owner);
      if (info.queued && info.first_new_id == 0) continue;
      change.is_strict = !info.queued;
      state_.records().change(owner, change);
    }
  }

  std::vector<MortonKey> leaves_within(const Point& p, double distance) const {
    return state_.octree().leaves_within(state_.frame(), Box::around(p), distance);
  }

  // The other leaves within the distance. Leaves without points have nothing to restore: they are
  // enqueued with the point that gives them one.
  void enqueue_around(const Point& changed, double distance) {
    if (is_deeper(changed, distance)) return;
    for (const MortonKey other : leaves_within(changed, distance))
      if (other != leaf_ && state_.leaves().info(other).num_points > 0)
        state_.queue().enqueue(other);
  }

  // Of other leaves' points.
  void enqueue_owners(const std::vector<Point>& points) {
    for (const Point& p : points)
      if (const MortonKey owner = state_.octree().leaf_owning(state_.frame(), p); owner != leaf_)
        state_.queue().enqueue(owner);
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
    if (state_.is_beyond(leaf_)) return;
    if (violations.empty() && state_.leaves().info(leaf_).num_unresolved == 0) return;
    std::vector<UnresolvedSite> sites;
    for (const Violation& v : violations)
      sites.push_back({static_cast<std::uint8_t>(v.condition), v.position, v.radius});
    state_.records().put_unresolved(leaf_, {thinned(sites, {}, state_.size())});
  }

  RunState& state_;
  HeldModel& model_;
  MortonKey leaf_;
  Box box_;
  std::vector<std::optional<std::uint64_t>> ids_;  // of the inserted points, unless deleted again
};

}  // namespace

void begin_refinement(RunState& state, const StopToken* stop) {
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
    if (state.leaves().info(leaf).num_points > 0) state.queue().enqueue(leaf);
    state.records().put_num_core_cells(leaf, num_cells[i]);
    state.leaves().trim();
  }
}

LeafDelta with_sizes(const RunView& run, LeafDelta delta) {
  if (run.is_uniform()) return delta;
  for (const InsertedPoint& point : delta.inserted)
    delta.sizes.push_back(run.size_at(point.position));
  for (const MeshPoint& point : delta.deleted) delta.sizes.push_back(run.size_at(point.position));
  for (const Point& place : delta.left) delta.sizes.push_back(run.size_at(place));
  return delta;
}

void apply_visit(RunState& state, HeldModel& model, MortonKey leaf, const LeafDelta& delta) {
  VisitChanges(state, model, leaf).apply(delta);
}

}  // namespace locvol
