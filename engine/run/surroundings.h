// Surroundings are what lies in and around a leaf, copied from the run for a visit of it.
#pragma once

#include <cstdint>
#include <vector>

#include "engine/run/run_view.h"
#include "octree/size_field.h"
#include "octree/stop.h"
#include "refine/domain/leaf_domain.h"

namespace locvol {

class Surroundings {
 public:
  explicit Surroundings(RunView run, const StopToken* stop = nullptr) : run_(run), stop_(stop) {}

  // Each once, in order of id; and some more, that only come close. Throws Stopped.
  std::vector<Triangle> triangles_meeting(const Box& region) const;
  DomainPiece domain(MortonKey leaf, double distance, std::vector<Triangle> triangles,
                     GridFineness fineness) const;
  // What triangles a visit looks up lies this far from where h(p) is, at points that the surface
  // may matter to.
  double surface_reach(MortonKey leaf) const;
  // Points of other leaves that a ball through a point of the leaf may reach, in order of id, if
  // its radius is at most k / 2 times h at its center.
  std::vector<MeshPoint> points(MortonKey leaf, double k) const;
  // h wherever a ball through a point of the leaf may be centered, and wherever it may reach, if
  // its radius is at most k / 2 times h at its center.
  SizeCubes sizes(MortonKey leaf, double k) const;

 private:
  RunView run_;
  const StopToken* stop_;
};

inline constexpr double kDistanceSlack = 1.01;  // on distances whose exact value does not matter

// Of a patch's grid, with resolutions over the size. Making a fine one pays where all facets of a
// leaf are held against it; first points and the few facets of a later visit ask less.
inline constexpr GridFineness kFinenessOfCover{4, 64};
inline GridFineness fineness(GridFineness over_size, double size) {
  return {over_size.resolution * size, over_size.triangles_per_cell};
}
// `size`: the least that matters there
double volume_over_size(const Box& box, double size);

}  // namespace locvol
