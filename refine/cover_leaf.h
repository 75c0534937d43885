// The initial points of one leaf in cover mode (refine/ALGORITHM.md): a maximal Poisson-disk sample
// of its piece of the surface, and the points of the global BCC lattice that are deep enough.
#pragma once

#include <cstdint>
#include <vector>

#include "octree/geometry.h"
#include "octree/lattice.h"
#include "octree/stop.h"
#include "refine/surface_patch.h"

namespace locvol {

// Over λ. Every point of the surface has a sample within kSampleRadius, r_s, and samples are at
// least kSampleSpacing apart: if the two were one, half of the work would go to slits between
// discs.
inline constexpr double kSampleRadius = 0.92, kSampleSpacing = 0.84;
// Of lattice points below the surface, over λ. Between the two only those that a sample hides from
// each point of the surface: others would be vertices of facets on the boundary (C2).
inline constexpr double kLatticeDepth = kSampleRadius, kLeastLatticeDepth = 0.5;
// Lattice points this far from the surface or farther, over λ, are of the core. All neighbors of
// such a point are lattice points inside, for they are deeper than kLatticeDepth; and what is
// inserted near the surface seldom comes within kLatticeStar of it.
inline constexpr double kCoreDepth = 3.0;

struct CoverInput {
  double size = 0;  // λ
  std::uint64_t seed = 0;
  Lattice lattice;
  Box box;                            // of the leaf, half-open
  SurfacePiece surface;               // region contains the box expanded by kCoreDepth λ
  std::vector<Point> nearby_samples;  // surface samples of other leaves within r_s of the box
};

struct CoverPoints {
  std::vector<Point> samples;        // on the surface, in the half-open box
  std::vector<LatticeSite> lattice;  // inside, as deep as that, but not of the core
  LatticeCore core;                  // inside, kCoreDepth λ from the surface or farther
};

// Afterwards every point of the surface in the box is within kSampleRadius λ of a sample, own or
// nearby, and own samples are at least kSampleSpacing λ from one another and from the nearby ones.
// A function of the geometry, ids, λ and seed: not of what else is loaded, or of any order.
// Time: about 9 µs a sample, with the lattice below it.
// Throws Stopped. REQUIRES: size > 0, a valid lattice; `stop` may be null
CoverPoints cover_leaf(CoverInput input, const StopToken* stop = nullptr);

}  // namespace locvol
