// Where a run's leaves lie at the start.
#pragma once

#include "octree/frame.h"
#include "octree/size_shapes.h"
#include "storage/records.h"

namespace locvol {

inline constexpr std::size_t kMaxStartLeaves = std::size_t{1} << 21;
inline constexpr double kMinLeafSide = 4;  // over λ, of a leaf at the start

// Near the surface and inside, leaves are nodes of `level`.
struct OctreePlan {
  Frame frame;
  int level = 0;
};

// So wide that a leaf filled with lattice points has half as many as κ, but at least 4 λ. Where
// sizes vary: about as wide as to have a quarter of κ of the points near the surface, so that cubes
// that halve come down to the lattice's at λ.
double start_leaf_side(const RunParameters& parameters);

// Which nodes of the octree are narrow enough for leaves at the start: those of the plan's level,
// and where shapes ask for smaller cells, as much smaller ones.
class StartSides {
 public:
  // `parameters`: must outlive it
  StartSides(const RunParameters& parameters, const OctreePlan& plan);

  bool is_narrow(MortonKey node);  // near the surface
  bool is_narrow_inside(MortonKey node);
  double least_size(MortonKey node);  // of h near the surface

 private:
  double size_, most_, side_, side_inside_;  // the last two: where h is λ, and where it is 1
  OctreePlan plan_;
  ShapesOfNodes shapes_;
};

// Cover: leaves that will hold about half of κ lattice points, at least 4 λ wide; paper: one leaf.
// Throws InputError, with the cure, if the surface is too large for leaves that small at all.
OctreePlan plan_octree(const RunParameters& parameters, const Box& surface);

}  // namespace locvol
