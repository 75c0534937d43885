// Paper mode has all of the surface and of P in memory: circumcenters may fall anywhere.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>

#include "engine/run/point_grid.h"
#include "engine/run/run_view.h"
#include "engine/shared/memory_budget.h"
#include "octree/stop.h"
#include "refine/domain/leaf_domain.h"
#include "refine/refine_leaf.h"

namespace locvol {

class HeldModel {
 public:
  // In cover mode holds nothing. Throws OverBudget, Stopped.
  HeldModel(const RunView& run, MemoryBudget& budget, const StopToken* stop = nullptr);

  WholeModel whole() const { return {domain_.get(), points_ ? &*points_ : nullptr}; }
  // Keeps up with P.
  void note_inserted(const MeshPoint& point);
  void note_deleted(const MeshPoint& point);
  // Before a visit, and not as its points come: what is half applied must not be given up. Throws
  // OverBudget: P has outgrown the memory.
  void keep_memory_of_points();

 private:
  MemoryBudget& budget_;
  std::unique_ptr<const LeafDomain> domain_;
  std::uint64_t num_points_reserved_ = 0, num_points_ = 0;
  std::optional<PointGrid> points_;
};

}  // namespace locvol
