// The initial points of one leaf in cover mode (DESIGN 3.4): a maximal Poisson-disk sample of its
// piece of the surface, and the points of the global BCC lattice that lie deep enough inside.
#pragma once

#include <cstdint>
#include <vector>

#include "octree/geometry.h"
#include "refine/surface_patch.h"

namespace locvol {

inline constexpr double kSampleRadius = 0.8;     // r_s over λ
inline constexpr double kLatticeSpacing = 1.75;  // a over λ
inline constexpr double kLatticeDepth = 0.75;    // of lattice points below the surface, over λ

// The BCC lattice of cubic spacing `a`: the points origin + a/2 (i, j, k) with i, j, k all even or
// all odd, each moved by up to 2^-18 a along each axis. One expression gives their coordinates, so
// that all leaves get the same bits.
//
// The displacement, a function of (i, j, k), keeps lattice points out of common planes and spheres,
// where predicates would fall to exact arithmetic: that makes a triangulation take 2.5 times as
// long. It is too small to change the lattice's cells: the circumball of each has no other lattice
// point within 1.6 times its radius.
class BccLattice {
 public:
  static constexpr double kDisplacement = 0x1p-17;  // at most, over a/2
  BccLattice(const Point& origin, double spacing) : origin_(origin), half_(0.5 * spacing) {}
  Point position(std::int64_t i, std::int64_t j, std::int64_t k) const;
  // Lattice points p with box.min <= p < box.max on each axis, lexicographically by (i, j, k).
  std::vector<Point> points_in(const Box& box) const;

 private:
  Point origin_;
  double half_;
};

struct CoverInput {
  double size = 0;  // λ
  std::uint64_t seed = 0;
  Point lattice_origin;
  Box box;                                // of the leaf, half-open
  const SurfacePatch* surface = nullptr;  // region contains the box expanded by λ
  std::vector<Point> nearby_samples;      // surface samples of other leaves within r_s of the box
};

struct CoverPoints {
  std::vector<Point> samples;  // on the surface, in the half-open box, r_s apart
  std::vector<Point> lattice;  // inside, farther than kLatticeDepth λ from the surface
};

// Afterwards every point of the surface in the box is within r_s (1 + 1e-6) of a sample, own or
// nearby, and own samples are at least r_s from one another and from the nearby ones.
// A function of the geometry, ids, λ and seed: not of what else is loaded, or of any order.
// Time: about 5 µs a sample, and 0.2 µs a triangle that meets the box.
// REQUIRES: size > 0, surface is not null
CoverPoints cover_leaf(const CoverInput& input);

}  // namespace locvol
