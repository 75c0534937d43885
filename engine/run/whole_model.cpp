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
  DomainPiece whole = Surroundings(run, stop).whole_domain({run.size()});
  budget_.keep(VisitSize{.volume = volume_over_size(whole.region, run.size()),
                         .surface_size = whole.surface_size()}
                   .bytes_to_refine());
  domain_ = std::make_unique<LeafDomain>(std::move(whole), stop);
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
