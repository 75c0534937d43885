// What sizes the surface asks for by itself: where it is curved, where a part of it is thin, and on
// sheets that sizes are given for.
#pragma once

#include <vector>

#include "octree/frame.h"
#include "octree/morton_key.h"
#include "octree/size_nodes.h"
#include "octree/stop.h"
#include "refine/domain/leaf_domain.h"

namespace locvol {

struct SizeRules {              // each 0: none
  double per_circle = 0;        // edges of the boundary around a circle of the surface's curvature
  double deviation = 0;         // how far the boundary may be from the surface: a length
  double layers = 0;            // of cells across thin parts
  double least = 0;             // no smaller size is asked for. Above 0 if any of these is given
  double spacing_floor = 0.02;  // over the size: how close to each other points may come
  double growth = 0;            // of sizes around what asks for them, over the way
  // What each sheet asks for, from id 1 on, infinite for none. `least` is not for these.
  std::vector<double> sheet_sizes = {};
};

// How far from a leaf the surface matters to what is measured in it. `size`: λ
double measure_reach(const SizeRules& rules, double size);

// How thick a layer of cells is in a thin part, over h.
inline constexpr double kLayer = 1.35;

struct MeasureInput {
  SizeRules rules;
  double size = 0;  // λ
  Frame frame;
  MortonKey leaf;
  DomainPiece domain;  // region contains the leaf's box expanded by measure_reach()
};

// What the surface in the leaf asks for, wherever that is below λ; ascending. One node may lie in
// another.
//
// Curvature is measured at the scale of the size that it asks for, and so not on a scanner's noise:
// from λ downwards in nodes of half the side, until one is no larger than what the surface in it
// and in the 26 around it asks for. Of the triangles, a tensor of curvature (Rusinkiewicz 2004,
// "Estimating curvatures and their derivatives on triangle meshes") is averaged by area, and the
// covariance of places tells how flat they lie. Sheets are told apart by the directions of their
// normals. Throws Stopped; `stop` may be null
std::vector<SizedNode> measure_leaf(MeasureInput input, const StopToken* stop = nullptr);

// About how many pieces, as small as the sizes that it asks for, the surface in the leaf and near
// it has: what a visit keeps in memory.
double num_pieces_to_measure(const MeasureInput& input, const StopToken* stop = nullptr);

}  // namespace locvol
