// Which points of P follow each other on the creases of a finished mesh's surface.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "octree/crease.h"
#include "octree/geometry.h"
#include "refine/domain/leaf_domain.h"

namespace locvol {

struct CreaseSegment {
  std::array<std::uint32_t, 2> points{};  // places among those given, the smaller one first
  double length = 0;                      // along the crease
  CreaseId crease = 1;
  std::vector<Point> way;  // along it, from the first to the second: both, and the corners between
  friend auto operator<=>(const CreaseSegment&, const CreaseSegment&) = default;
};

// `piece`: its creases are asked alone. `points`: all on creases in its region. `size`: λ. Each two
// that follow each other come once, by the shortest way, in the order of their places, if the way
// between them is loaded: the neighbors of a point are known if the region reaches a step beyond
// it. A point that lies on no crease has none.
std::vector<CreaseSegment> crease_segments(DomainPiece piece, std::span<const Point> points,
                                           double size);

}  // namespace locvol
