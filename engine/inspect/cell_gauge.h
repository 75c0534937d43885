// CellGauge measures the cells of a mesh, one by one and together. Internal to engine/inspect.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "engine/inspect/mesh_statistics.h"
#include "engine/shared/compensated_sum.h"
#include "octree/geometry.h"

namespace locvol {

// What is known of some cells. Counts and extremes know no order; volumes are added up in the order
// that they come in.
class CellGauge {
 public:
  using Corners = std::array<Point, 4>;
  static constexpr std::size_t kAtOnce = 2;

  // `size`: λ, in units of which cells are measured, so that nothing overflows.
  explicit CellGauge(double size);

  // At most kAtOnce, at little more than the price of one.
  void add(std::span<const Corners> cells);
  // Cells of the lattice core: all congruent, taken by formula.
  void add_core(std::uint64_t num_cells);
  void add(const CellGauge& other);

  std::uint64_t num_cells() const { return counted_.num_cells; }
  MeshStatistics statistics() const;

 private:
  struct Measures;
  static Measures measures_of(std::span<const Corners> cells, double scale);
  void add_angles(const std::array<double, 6>& cosines);
  void add_radius(double radius, double ratio);

  double size_;
  MeshStatistics counted_;  // but for what the members below tell
  CompensatedSum volume_;
  double min_cosine_ = 1, max_cosine_ = -1;  // of dihedral angles
};

}  // namespace locvol
