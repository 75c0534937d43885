#include "refine/leaf.h"

#include "refine/cover_leaf.h"

namespace locvol {

Criteria Criteria::of_cover(double size, double radius_edge_bound, double spacing_floor) {
  constexpr double kSlack = 1.01;
  return {.size = size,
          .radius_edge_bound = radius_edge_bound,
          .reach = kReach * size,
          .spacing_floor = spacing_floor * size,
          .cover_radius = kSlack * kSampleRadius * size};
}

Criteria Criteria::of_paper(double size, double radius_edge_bound, double spacing_floor) {
  return {.size = size,
          .radius_edge_bound = radius_edge_bound,
          .reach = std::numeric_limits<double>::infinity(),
          .spacing_floor = spacing_floor * size};
}

}  // namespace locvol
