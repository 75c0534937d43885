// Pieces of a surface, as visits get them.
#pragma once

#include <algorithm>
#include <iterator>

#include "refine/domain/leaf_domain.h"
#include "tests/refine/brute_force.h"
#include "tests/refine/shapes.h"

namespace locvol {

// What of the closed mesh may matter in the region.
inline DomainPiece piece_around(const Box& region, const shapes::Mesh& mesh) {
  DomainPiece piece{.triangles = {},
                    .region = region,
                    .reference = region.center(),
                    .is_reference_inside = brute_force::is_inside(region.center(), mesh)};
  std::ranges::copy_if(mesh, std::back_inserter(piece.triangles),
                       [&](const Triangle& t) { return t.box().overlaps(region); });
  return piece;
}

}  // namespace locvol
