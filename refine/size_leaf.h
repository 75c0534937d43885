// The octree of sizes in a leaf: cubes as large as h lets the lattice's cells in them be, with the
// distance of their corners from the surface.
#pragma once

#include <vector>

#include "octree/frame.h"
#include "octree/morton_key.h"
#include "octree/size_field.h"
#include "octree/size_nodes.h"
#include "octree/size_shapes.h"
#include "octree/stop.h"
#include "refine/domain/far_surface.h"
#include "refine/domain/leaf_domain.h"

namespace locvol {

// Cubes are no smaller than this: their corners and centers have coordinates on the grid of level
// 20, below 2^20.
inline constexpr int kMaxCubeLevel = 19;
// Over the largest size at the surface in the leaf. So far from the leaf the surface is looked up;
// FarSurface stands for what is farther.
inline constexpr double kExactDistance = 6;

struct SizeInput {
  SizeLaw law;
  double exact_distance = 0;
  Frame frame;
  MortonKey leaf;
  DomainPiece domain;  // region contains the leaf's box
  // All shapes that make h smaller in the leaf.
  std::vector<SizeShape> shapes = {};
  std::vector<SizedNode> nodes = {};
  // By body, from id 1 on: what h is at most in all of it, as on its sides; infinite: anything.
  // Empty: of all.
  std::vector<double> body_sizes = {};
};

// The cubes of the leaf, in Morton order. A cube is halved as long as the circumradius of the
// lattice's cells in it, √5/4 of its side, may exceed h at a circumcenter; outside, as long as the
// surface may pass through it. In the core (SizeLaw::has_core) cubes are of any size. Throws
// Stopped; `stop` may be null
std::vector<SizeCube> size_leaf(SizeInput input, const FarSurface& far,
                                const StopToken* stop = nullptr);

}  // namespace locvol
