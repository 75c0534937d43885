#include "engine/run/run_points.h"

#include <algorithm>
#include <string>
#include <utility>

namespace locvol {

void RunPoints::begin_ids(std::uint64_t first) {
  data_.run.next_point_id = first;
  ids_end_ = first + kIdsOfVisit;
}

void RunPoints::end_ids() {
  data_.run.next_point_id = std::exchange(ids_end_, std::numeric_limits<std::uint64_t>::max());
}

MeshPoint RunPoints::add(const Point& position, PointKind kind) {
  if (run().next_point_id == ids_end_)
    throw RefineError("a visit has more than " + std::to_string(kIdsOfVisit) + " new points");
  const MeshPoint point{data_.run.next_point_id++, position, kind};
  add_to_leaf(point);
  return point;
}

MeshPoint RunPoints::add(const LatticeSite& site) {
  const MeshPoint point = lattice().point(site);
  add_to_leaf(point);
  return point;
}

void RunPoints::add_to_leaf(const MeshPoint& point) {
  const MortonKey owner = owner_of(point.position);
  if (is_beyond(owner)) return;
  auto& points = data_.leaves.edit_points(owner).points;
  points.insert(std::ranges::upper_bound(points, point.id, {}, &MeshPoint::id), point);
  data_.put_count(owner, &LeafInfo::num_points, points.size(), &RunCounts::num_points);
}

void RunPoints::remove(const MeshPoint& point) {
  const MortonKey owner = owner_of(point.position);
  if (is_beyond(owner)) return;
  auto& points = data_.leaves.edit_points(owner).points;
  const auto place = std::ranges::lower_bound(points, point.id, {}, &MeshPoint::id);
  if (place == points.end() || place->id != point.id)
    throw RefineError("deleted point " + std::to_string(point.id) + " is not in P");
  points.erase(place);
  data_.put_count(owner, &LeafInfo::num_points, points.size(), &RunCounts::num_points);
}

void RunPoints::put_core(MortonKey leaf, const LatticeCore& core) {
  if (is_beyond(leaf)) return;
  data_.leaves.edit_points(leaf).core = core;
  data_.put_count(leaf, &LeafInfo::num_core_points, num_points(core, sites(leaf)),
                  &RunCounts::num_points);
}

void RunPoints::list_core_point(MortonKey leaf, const LatticeSite& site) {
  if (is_beyond(leaf)) return;
  LatticeCore& core = data_.leaves.edit_points(leaf).core;
  core = without(core, sites(leaf), site);
  data_.put_count(leaf, &LeafInfo::num_core_points, leaves().info(leaf).num_core_points - 1,
                  &RunCounts::num_points);
  add(site);
}

}  // namespace locvol
