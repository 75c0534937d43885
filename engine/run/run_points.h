// RunPoints are the points of P: each is listed by the leaf that owns its position, or of the core
// of that leaf, and has an id of its own.
#pragma once

#include <cstdint>
#include <limits>

#include "engine/run/run_view.h"

namespace locvol {

// Each visit of an epoch has so many ids for its new points, far more than it takes: which ones
// depends on its place among those visits alone.
inline constexpr std::uint64_t kIdsOfVisit = std::uint64_t{1} << 24;

class RunPoints : RunView {
 public:
  using RunView::RunView;

  // Whose ids follow each other from here on, until they end: those of a visit.
  void begin_ids(std::uint64_t first);
  void begin_ids() { begin_ids(run().next_point_id); }
  void end_ids();
  // Appends to the points of the leaf that owns `position`, and gives the next id. Throws
  // RefineError: a visit has too few
  MeshPoint add(const Point& position, PointKind kind);
  // A point of the lattice has the site's id.
  MeshPoint add(const LatticeSite& site);
  void remove(const MeshPoint& point);  // throws RefineError unless it is in P
  // REQUIRES: the leaf had no core
  void put_core(MortonKey leaf, const LatticeCore& core);
  // From now on the leaf's record lists the point. REQUIRES: the site is of its core
  void list_core_point(MortonKey leaf, const LatticeSite& site);

 private:
  void add_to_leaf(const MeshPoint& point);

  std::uint64_t ids_end_ = std::numeric_limits<std::uint64_t>::max();
};

}  // namespace locvol
