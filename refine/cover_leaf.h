// The initial points of one leaf in cover mode (refine/ALGORITHM.md): a maximal Poisson-disk sample
// of its piece of the surface, and the points of the global BCC lattice that are deep enough.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "octree/geometry.h"
#include "octree/lattice.h"
#include "octree/size_field.h"
#include "octree/stop.h"
#include "refine/domain/leaf_domain.h"
#include "refine/mirror.h"

namespace locvol {

// Over λ. Every point of the surface has a sample within kSampleRadius, r_s, and samples are at
// least kSampleSpacing apart: if the two were one, half of the work would go to slits between
// discs.
inline constexpr double kSampleRadius = 0.92, kSampleSpacing = 0.84;
// How close samples are where sizes vary. There most cells are near the surface, so fewer samples
// are worth more time: the first are so far apart that what they leave open takes few more.
inline constexpr double kGradedSampleRadius = 0.98, kGradedSampleSpacing = 0.95,
                        kGradedFirstSpacing = 1.3;
constexpr double sample_radius(bool is_uniform) {
  return is_uniform ? kSampleRadius : kGradedSampleRadius;
}
// How far samples that hide p may be, if p is not on the surface: no place of the surface that is
// as far or farther has all samples farther. `size`: the largest h on the surface
inline double sample_radius_from(const SizeField& sizes, double size, const Point& p) {
  const double radius = sample_radius(sizes.is_uniform());
  if (!sizes.has_shapes()) return radius * size;
  return radius * std::min(size, sizes.at(p) / (1 - radius * sizes.growth()));
}
// How deep lattice points begin below the surface, over λ. From r_s on there are all; between
// kLeastLatticeDepth and that only those that a sample hides from each point of the surface. Others
// would be vertices of facets on the boundary (C2).
inline constexpr double kLeastLatticeDepth = 0.5;
// Lattice points this far from the surface or farther, over λ, are of the core. All neighbors of
// such a point are lattice points inside, for they are deeper than r_s; and what is inserted near
// the surface seldom comes within kLatticeStar of it.
inline constexpr double kCoreDepth = 3.0;

// The least side of cubes with lattice points where sizes vary, over base_size(). In smaller ones,
// near the surface, steps of two in size would make too many cells; there fill_leaf has what it
// takes. Where h has a bound no cube has any: there is the lattice of that size, as everywhere in
// uniform runs, as deep as kLatticeMargin says.
inline constexpr double kLeastCube = 5;
inline bool has_lattice(const SizeLaw& law, const SizeCube& cube, double side) {
  return !law.has_core() && side >= kLeastCube * base_size(law, cube);
}

// How far around a leaf whose sides are sampled each by itself samples are read, and points on
// creases with their neighbors, over h: samples are put as far as kMirrorDistance.
inline constexpr double kCreasedReach = kMirrorDistance + 1.5;

struct CoverInput {
  double size = 0;  // λ; of shapes: the largest h on the surface in the leaf
  std::uint64_t seed = 0;
  Lattice lattice;                        // of λ; where sizes vary of the largest h, or of cubes
  Box box;                                // of the leaf, half-open
  DomainPiece domain;                     // region contains the box expanded by kCoreDepth λ
  std::vector<Point> nearby_samples;      // surface samples of other leaves within r_s of the box;
                                          // where sides are apart, all within kCreasedReach
  std::vector<Point> crease_points = {};  // of P on creases, the leaf's and around it
  bool are_sides_apart = false;           // sampled each by itself; so where creases are near
  bool is_surface_only = false;           // no point comes inside
  // The cubes of sizes that meet the closed box, and where these samples are; none: λ everywhere.
  // With them r_s and distances between samples are over h.
  SizeCubes sizes = {};
};

struct CoverPoints {
  std::vector<Point> samples;        // on the surface, in the half-open box, but for mirrors
  std::vector<LatticeSite> lattice;  // inside, as deep as that, but not of the core; ascending
  LatticeCore core;                  // inside, kCoreDepth λ from the surface or farther; where
                                     // sizes vary, as kCoreMargin says
};

// Covers a leaf. Afterwards every point of the surface in the box is within kSampleRadius λ of a
// sample, own or nearby, and own samples are at least kSampleSpacing λ from one another and from
// the nearby ones. The result is a function of the geometry, ids, λ and seed: not of what else is
// loaded, or of any order. Time: about 9 µs a sample, with the lattice below it. Throws Stopped.
// REQUIRES: size > 0, a valid lattice; `stop` may be null
CoverPoints cover_leaf(CoverInput input, const StopToken* stop = nullptr);

}  // namespace locvol
