// Pieces of a surface, as visits get them.
#pragma once

#include <algorithm>
#include <iterator>

#include "refine/domain/leaf_domain.h"
#include "tests/refine/brute_force.h"
#include "tests/refine/shapes.h"

namespace locvol {

inline DomainState state_if(bool is_inside) {
  return is_inside ? DomainState::in(kOnlyBody) : DomainState();
}
inline bool is_inside(const LeafDomain& domain, const Point& p) {
  return is_in_body(domain.label(p));
}

// All of the closed mesh. REQUIRES: it lies in the region, away from its border
inline DomainPiece whole_piece(const Box& region, const shapes::Mesh& mesh) {
  return {.triangles = mesh,
          .region = region,
          .reference = region.min,
          .reference_state = {},
          .is_whole = true};
}

// What of the closed mesh may matter in the region.
inline DomainPiece piece_around(const Box& region, const shapes::Mesh& mesh) {
  DomainPiece piece{.triangles = {},
                    .region = region,
                    .reference = region.center(),
                    .reference_state = state_if(brute_force::is_inside(region.center(), mesh))};
  std::ranges::copy_if(mesh, std::back_inserter(piece.triangles),
                       [&](const Triangle& t) { return t.box().overlaps(region); });
  return piece;
}

}  // namespace locvol
