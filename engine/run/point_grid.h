// PointGrid holds all of P in memory and finds nearest points: what paper mode needs, where a
// circumcenter may fall anywhere (refine/ALGORITHM.md, "Two initializations").
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <unordered_map>
#include <vector>

#include "octree/table_hash.h"
#include "refine/leaf.h"

namespace locvol {

// A uniform grid of hashed cells. Memory: about 100 bytes a point. Cost of nearest(): the points of
// the cells that the ball meets, 27 of them for a radius of one cell side.
class PointGrid : public PointIndex {
 public:
  explicit PointGrid(double cell_side) : cell_side_(cell_side) {}  // REQUIRES: > 0

  void insert(const MeshPoint& point);
  void erase(const MeshPoint& point);  // REQUIRES: it was inserted
  std::optional<MeshPoint> nearest(
      const Point& q, double radius,
      const std::function<bool(std::uint64_t)>& is_deleted) const override;

 private:
  using CellIndex = std::array<std::int64_t, 3>;
  CellIndex cell_of(const Point& p) const;

  double cell_side_;
  std::unordered_map<CellIndex, std::vector<MeshPoint>, TableHash> cells_;
};

}  // namespace locvol
