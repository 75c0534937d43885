#include "engine/shared/cell_quality.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>

#include "refine/predicates.h"

namespace locvol {
namespace {

// The angle between two facets is a straight angle less that between their outward normals.
void measure_dihedrals(const std::array<Point, 4>& c, CellQuality& quality) {
  std::array<Point, 4> normals = {cross(c[3] - c[1], c[2] - c[1]), cross(c[2] - c[0], c[3] - c[0]),
                                  cross(c[3] - c[0], c[1] - c[0]), cross(c[1] - c[0], c[2] - c[0])};
  for (std::size_t i = 0; i < 4; ++i)
    for (std::size_t j = i + 1; j < 4; ++j) {
      const double lengths = norm(normals[i]) * norm(normals[j]);
      const double cosine = lengths > 0 ? -dot(normals[i], normals[j]) / lengths : 1;
      const double degrees = std::acos(std::clamp(cosine, -1.0, 1.0)) * (180 / std::numbers::pi);
      quality.min_dihedral_degrees = std::min(quality.min_dihedral_degrees, degrees);
      quality.max_dihedral_degrees = std::max(quality.max_dihedral_degrees, degrees);
    }
}

}  // namespace

CellQuality quality_of(const std::array<Point, 4>& c) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  if (exact_orientation(c[0], c[1], c[2], c[3]) == 0) return {kInfinity, kInfinity, 0, 180};
  CellQuality quality;
  double shortest = kInfinity;
  for (std::size_t i = 0; i < 4; ++i)
    for (std::size_t j = i + 1; j < 4; ++j)
      shortest = std::min(shortest, squared_distance(c[i], c[j]));
  quality.circumradius = circumsphere_of(c[0], c[1], c[2], c[3]).radius;
  quality.radius_edge_ratio = quality.circumradius / std::sqrt(shortest);
  measure_dihedrals(c, quality);
  return quality;
}

}  // namespace locvol
