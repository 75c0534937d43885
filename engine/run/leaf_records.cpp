#include "engine/run/leaf_records.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "engine/run/listed_cells.h"

namespace locvol {

LeafRecords::LeafRecords(RunData& data, RunQueue& queue) : RunView(data), queue_(queue) {
  num_own_leaves_ =
      static_cast<std::uint64_t>(std::ranges::count_if(octree().leaves(), [&](MortonKey leaf) {
        return !data.rank || data.shares.owner_of(leaf) == static_cast<int>(data.rank->rank);
      }));
}

void LeafRecords::add_visit(MortonKey leaf, const VisitStats& stats) {
  if (is_beyond(leaf)) return;
  const auto add_to = [&](auto& counts) {
    ++counts.num_visits;
    counts.num_deletions += stats.deletions;
    counts.num_moves += stats.moves;
    for (std::size_t c = 0; c < kNumConditions; ++c)
      counts.num_insertions[c] += stats.insertions[c];
  };
  add_to(data_.leaves.edit_info(leaf));
  if (is_own(leaf)) add_to(data_.run.counts);
}

void LeafRecords::allow_short_visit(MortonKey leaf) {
  if (!is_beyond(leaf)) data_.leaves.edit_info(leaf).first_new_id = run().next_point_id;
}

void LeafRecords::require_whole_visit(MortonKey leaf) {
  if (is_beyond(leaf)) return;
  if (leaves().info(leaf).first_new_id != 0) data_.leaves.edit_info(leaf).first_new_id = 0;
}

void LeafRecords::ask_for_visit(MortonKey leaf, const Point& place) {
  if (leaves().info(leaf).num_points == 0) return;
  queue_.enqueue(leaf);
  if (leaves().info(leaf).first_new_id == 0) return;
  LeafCells cells = leaves().cells(leaf);
  cells.asked.push_back(place);
  put_cells(leaf, std::move(cells));
}

void LeafRecords::put_cells(MortonKey leaf, LeafCells cells) {
  if (is_own(leaf)) put_shared_cells(leaf, std::move(cells));
}

void LeafRecords::put_shared_cells(MortonKey leaf, LeafCells cells) {
  if (!parameters().is_surface_only)
    data_.put_count(leaf, &LeafInfo::num_cells, cells.cells.size(), &RunCounts::num_cells);
  data_.leaves.put_cells(leaf, std::move(cells));
}

void LeafRecords::put_facets(MortonKey leaf, LeafFacets facets) {
  if (!is_own(leaf)) return;
  if (parameters().is_surface_only)
    data_.put_count(leaf, &LeafInfo::num_cells, facets.facets.size(), &RunCounts::num_cells);
  data_.leaves.put_facets(leaf, std::move(facets));
}

void LeafRecords::change(MortonKey leaf, const Changes<CellList>& changes) {
  if (!is_own(leaf)) return;
  LeafCells held = leaves().cells(leaf);
  std::vector<Point> asked = std::move(held.asked);
  CellList list = listed_cells(std::move(held));
  apply(changes, list);
  LeafCells changed = stored_cells(std::move(list.vertices), list);
  changed.asked = std::move(asked);
  put_cells(leaf, std::move(changed));
}

void LeafRecords::change(MortonKey leaf, const Changes<FacetList>& changes) {
  if (!is_own(leaf)) return;
  LeafFacets held = leaves().facets(leaf);
  FacetList list{std::move(held.vertices), std::move(held.facets)};
  apply(changes, list);
  put_facets(leaf, {std::move(list.vertices), std::move(list.facets)});
}

void LeafRecords::leave_out_cells(MortonKey leaf, LeafCells left) {
  if (is_beyond(leaf)) return;
  LeafInfo& info = data_.leaves.edit_info(leaf);
  if (parameters().is_surface_only)  // which facets are gone is seen when they are listed anew
    info.num_left_out = left.cells.size();
  else
    info.num_left_out += info.num_cells - left.cells.size();
  put_shared_cells(leaf, std::move(left));
}

void LeafRecords::put_num_core_cells(MortonKey leaf, std::uint64_t num_cells) {
  // Of a copy, not all is known that it takes to count them.
  if (is_own(leaf) && leaves().info(leaf).num_core_cells != num_cells)
    data_.put_count(leaf, &LeafInfo::num_core_cells, num_cells, &RunCounts::num_cells);
}

void LeafRecords::put_unresolved(MortonKey leaf, LeafUnresolved unresolved) {
  if (is_beyond(leaf)) return;
  data_.put_count(leaf, &LeafInfo::num_unresolved, unresolved.sites.size(),
                  &RunCounts::num_unresolved);
  data_.leaves.put_unresolved(leaf, std::move(unresolved));
}

void LeafRecords::put_sizes(MortonKey leaf, LeafSizes sizes) {
  if (is_beyond(leaf)) return;
  LeafInfo& info = data_.leaves.edit_info(leaf);
  const SizeRange range = size_range(parameters().sizes(), frame(), sizes.cubes);
  info.least_size = range.least;
  info.largest_size = range.most;
  info.surface_size = range.on_surface;
  data_.leaves.put_sizes(leaf, std::move(sizes));
}

void LeafRecords::put_reached_size(MortonKey leaf, double size) {
  data_.leaves.edit_info(leaf).reached_size = size;
}

void LeafRecords::split(MortonKey leaf, std::array<Child, 8> children) {
  const LeafInfo parent = leaves().info(leaf);
  if (parent.holding == Holding::kOwn) {
    data_.run.counts.num_cells -= parent.num_cells + parent.num_core_cells;
    data_.run.counts.num_unresolved -= parent.num_unresolved;
  }
  if (parent.queued) queue_.dequeue(leaf);
  data_.leaves.erase_leaf(leaf);
  data_.octree.split(leaf);
  if (parent.holding == Holding::kOwn) num_own_leaves_ += 7;
  for (int octant = 0; octant < 8; ++octant) {
    auto& [center, points, surface, sizes] = children[static_cast<std::size_t>(octant)];
    const MortonKey key = leaf.child(octant);
    LeafInfo info;
    info.holding = parent.holding;
    info.ranks = parent.ranks;
    info.center = center;
    info.num_points = points.points.size();
    info.num_core_points = num_points(points.core, this->sites(key));
    info.num_triangles = surface.size();
    data_.leaves.add_leaf(key, info, std::move(points), std::move(surface));
    if (!is_uniform()) put_sizes(key, std::move(sizes));
    put_reached_size(key, parent.reached_size);
    if (info.num_points > 0) queue_.enqueue(key);
  }
}

}  // namespace locvol
