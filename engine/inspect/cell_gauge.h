// CellGauge measures the cells of a mesh, one by one and together.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <span>
#include <vector>

#include "engine/shared/compensated_sum.h"
#include "octree/geometry.h"
#include "octree/size_field.h"

namespace locvol {

// counts[i]: how many lie in edges[i] <= value < edges[i + 1]; the last bin also holds all above.
struct Histogram {
  std::vector<double> edges;  // ascending, one more than counts
  std::vector<std::uint64_t> counts;

  std::uint64_t total() const;
};

struct MeshStatistics {
  MeshStatistics();  // of a mesh without cells

  std::uint64_t num_cells = 0;  // with those of the lattice core
  std::uint64_t num_core_cells = 0;
  double volume = 0;
  double min_dihedral_degrees = 180, max_dihedral_degrees = 0;
  double min_dihedral_bound = 0;       // what the run asks for, in degrees; 0: nothing
  std::uint64_t num_poor_cells = 0;    // with a dihedral angle below that
  std::uint64_t num_forced_cells = 0;  // of these: walls or acute creases leave no room for more
  double max_radius_edge_ratio = 0;
  // Of cells up to the bound of C6, and how many are above it: beside creases these are excused.
  double max_bounded_ratio = 0;
  std::uint64_t num_above_ratio = 0;
  double max_circumradius = 0;      // over λ
  double max_radius_over_size = 0;  // circumradius over h at the circumcenter
  // Circumradii of two cells that share a facet, the larger over the smaller. 0: not asked for.
  double max_neighbor_ratio = 0;
  // Counts cells by h at their circumcenters: from 2 to this power to below twice that.
  std::map<int, std::uint64_t> num_cells_by_octave;
  // Angles are in degrees, with edges at 0, 1, 3, 5, ..., 179, 180: the angles of the lattice's
  // cells, 60 and 90 degrees, are in the middle of a bin.
  Histogram dihedral_angles;                // six a cell
  Histogram min_dihedral_angles;            // one a cell, its smallest
  Histogram radius_edge_ratios;             // edges at 0.6, 0.65, ..., 2, 2.05
  Histogram radii_over_size;                // edges at 0, 0.05, ..., 1
  std::vector<MeshStatistics> bodies = {};  // of each by itself, where there are several
};

// The statistics of all cells of both meshes, but for max_neighbor_ratio, which is lost.
MeshStatistics together(const MeshStatistics& a, const MeshStatistics& b);

// What is known of some cells. Counts and extremes know no order; volumes are added up in the order
// that they come in.
class CellGauge {
 public:
  using Corners = std::array<Point, 4>;
  static constexpr std::size_t kAtOnce = 2;

  // `size`: λ, in units of which cells are measured, so that nothing overflows. `min_dihedral`: in
  // degrees; cells with an angle below it, but for rounding, are poor. `core_size`: of the lattice
  // core, if that is not λ. `ratio_bound`: of radius-edge ratios.
  explicit CellGauge(double size, double min_dihedral = 0, double core_size = 0,
                     double ratio_bound = 2);

  struct Added {
    std::array<double, kAtOnce> radii{};  // of circumballs, over λ
    std::array<bool, kAtOnce> are_poor{};
  };

  // Adds at most kAtOnce cells, at little more than the price of one. `sizes`: h around them; null:
  // λ.
  Added add(std::span<const Corners> cells, const SizeField* sizes = nullptr);
  // One of the poor cells is so for the surface's sake.
  void add_forced() { ++counted_.num_forced_cells; }
  // Cells of the lattice core: all congruent, taken by formula.
  void add_core(std::uint64_t num_cells);
  void add(const CellGauge& other);

  std::uint64_t num_cells() const { return counted_.num_cells; }
  std::uint64_t num_poor_cells() const { return counted_.num_poor_cells; }
  MeshStatistics statistics() const;

 private:
  struct Measures;
  static Measures measures_of(std::span<const Corners> cells, double scale);
  bool add_angles(const std::array<double, 6>& cosines);  // is the cell poor?
  void add_radius(double radius, double ratio);
  void add_radius_over_size(double radius, double size, std::uint64_t num_cells = 1);

  double size_, core_size_, ratio_bound_;
  double poor_cosine_;      // of an angle that is just good enough
  MeshStatistics counted_;  // but for what the members below tell
  CompensatedSum volume_;
  double min_cosine_ = 1, max_cosine_ = -1;  // of dihedral angles
};

}  // namespace locvol
