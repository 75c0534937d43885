// The first points on the creases in a leaf, in cover mode (refine/ALGORITHM.md, "Creases"). They
// come before all others, which keep out of the balls around them.
#pragma once

#include <vector>

#include "octree/geometry.h"
#include "octree/size_field.h"
#include "octree/stop.h"
#include "refine/domain/leaf_domain.h"

namespace locvol {

// Along a crease, over h: how far points are apart at most.
inline constexpr double kCreaseStep = 0.84;
// What is no longer than this is one step: in two, the cells beside it would be too slender (C6).
inline constexpr double kLongestStep = 1.0;
// Steps change along creases by no more than this times the way, so that next to a short one they
// grow step by step.
inline constexpr double kCreaseGrowth = 0.5;
// In degrees: a step turns by no more, and so a hole has no fewer points.
inline constexpr double kMostTurn = 45;
// How far around a leaf, over λ, creases matter to it: a corner makes steps smaller up to 2
// kCreaseStep away, and is itself given its own by chains as long as that; and it may have points
// around it.
inline constexpr double kCreaseReach = 6 * kCreaseStep;

struct CreaseInput {
  double size = 0;  // λ; of shapes: the largest h on the surface in the leaf
  Box box;          // of the leaf, half-open
  // Creases and corners; and triangles, where asks_for_surface(). The region contains the box
  // expanded by kCreaseReach λ.
  DomainPiece domain;
  std::vector<Point> nearby;  // points on creases of other leaves, as far as that
  SizeCubes sizes = {};       // around all of these; no cubes: λ everywhere
};

struct CreasePoints {
  std::vector<Point> positions;  // in the half-open box
};

// May there be points in the box that lie on no crease, but beside a corner: around the tip of a
// cone, or on a face where creases meet at an acute angle? Asks the domain for creases and corners
// alone.
bool asks_for_surface(const CreaseInput& input);

// Every vertex of the surface in the box where creases end, or turn by more than kFixedTurn, and
// tips of cones with points around them (refine/tip_ring.h); between them, points along creases, so
// that with those nearby steps in the box are as long as they may be. A function of what is given
// alone. Throws Stopped.
CreasePoints crease_leaf(CreaseInput input, const StopToken* stop = nullptr);

}  // namespace locvol
