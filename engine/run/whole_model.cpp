#include "engine/run/whole_model.h"

#include <utility>
#include <vector>

#include "engine/run/surroundings.h"

namespace locvol {
namespace {

constexpr std::uint64_t kPointsOfReservation = 100000, kGridBytesPerPoint = 130;

}  // namespace

HeldModel::HeldModel(const RunView& run, MemoryBudget& budget, const StopToken* stop)
    : budget_(budget) {
  if (run.is_cover()) return;
  const Box root = run.frame().root_box();
  std::vector<Triangle> triangles = Surroundings(run, stop).triangles_meeting(root);
  budget_.keep(
      VisitSize{.volume = volume_over_size(root, run.size()), .num_triangles = triangles.size()}
          .bytes_to_refine());
  domain_ = std::make_unique<LeafDomain>(DomainPiece{.triangles = std::move(triangles),
                                                     .region = root,
                                                     .reference = root.min,
                                                     .is_reference_inside = false,
                                                     .fineness = {run.size()}},
                                         stop);
  points_.emplace(run.size());
  for (const MortonKey leaf : run.octree().leaves()) {
    throw_if_stopped(stop);
    for (const MeshPoint& point : run.leaves().points(leaf).points) note_inserted(point);
  }
}

void HeldModel::note_inserted(const MeshPoint& point) {
  if (!points_) return;
  ++num_points_;
  points_->insert(point);
}

void HeldModel::note_deleted(const MeshPoint& point) {
  if (!points_) return;
  --num_points_;
  points_->erase(point);
}

void HeldModel::keep_memory_of_points() {
  while (num_points_ > num_points_reserved_) {
    budget_.keep(kPointsOfReservation * kGridBytesPerPoint);
    num_points_reserved_ += kPointsOfReservation;
  }
}

}  // namespace locvol
