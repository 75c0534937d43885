// Holes between the first points of cover mode: places inside, between the surface's samples and
// the lattice, that are about λ from all of them. C5 would fill them one by one in a triangulation,
// and have neighboring leaves visited again; before there is one, that takes less than half the
// time.
#pragma once

#include <cstdint>
#include <vector>

#include "octree/geometry.h"
#include "octree/size_field.h"
#include "octree/stop.h"
#include "refine/core_index.h"
#include "refine/domain/leaf_domain.h"

namespace locvol {

// Over λ. What lies within this distance of the leaf is known.
inline constexpr double kFillReach = 2.2;

struct FillInput {
  double size = 0;  // λ; of shapes: the largest h on the surface in the leaf
  Box box;          // of the leaf, half-open
  // P in the leaf and within kFillReach λ of it, but for the lattice core. In order of id: the
  // result depends on it.
  std::vector<MeshPoint> points;
  CoreRows core;
  DomainPiece domain;    // region contains the box expanded by λ
  SizeCubes sizes = {};  // around the leaf; none: λ everywhere. Then distances are over h
};

struct FillPoints {
  std::vector<Point> centers;           // of holes in the half-open box
  std::vector<std::uint64_t> met_core;  // as in LeafDelta
};

// Centers are as deep below the surface as a lattice point must be, and kHoleRadius λ from all
// points and one another. It is a search by sampling: some holes may be missed, and are left to C5.
// Time: about 3.5 µs to λ² of surface.
// Throws Stopped. REQUIRES: size > 0; `stop` may be null
FillPoints fill_leaf(FillInput input, const StopToken* stop = nullptr);

}  // namespace locvol
