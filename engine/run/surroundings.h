// Surroundings are what lies in and around a leaf, copied from the run for a visit of it.
#pragma once

#include <cstdint>
#include <vector>

#include "engine/run/run_view.h"
#include "octree/size_field.h"
#include "octree/stop.h"
#include "refine/domain/domain_piece.h"

namespace locvol {

class Surroundings {
 public:
  explicit Surroundings(RunView run, const StopToken* stop = nullptr) : run_(run), stop_(stop) {}

  // Of the domain what is within the distance of the leaf. Throws Stopped.
  DomainPiece domain(MortonKey leaf, double distance, GridFineness fineness) const;
  DomainPiece whole_domain(GridFineness fineness) const;
  // Of that no more than creases and corners.
  DomainPiece creases(MortonKey leaf, double distance) const;
  // What surface a visit looks up lies this far from where h(p) is, at points that it may matter
  // to.
  double surface_reach(MortonKey leaf) const;
  // Points of other leaves that a ball through a point of the leaf may reach, in order of id, if
  // its radius is at most k / 2 times h at its center.
  std::vector<MeshPoint> points(MortonKey leaf, double k) const;
  // Points on creases, its own and those of other leaves that are no farther away, in order of id.
  std::vector<MeshPoint> crease_points(MortonKey leaf, double distance) const;
  // Is each side of the surface in a leaf sampled by itself, where creases are near or not? It is
  // in runs with creases whose surface faces itself across less than mirrors reach.
  bool are_sides_apart() const;
  // Those on the surface, but for creases, likewise.
  std::vector<MeshPoint> samples(MortonKey leaf, double distance) const;
  // h wherever a ball through a point of the leaf may be centered, and wherever it may reach, if
  // its radius is at most k / 2 times h at its center.
  SizeCubes sizes(MortonKey leaf, double k) const;
  // h within the distance of the leaf.
  SizeCubes sizes_within(MortonKey leaf, double distance) const;

 private:
  template <class IsTaken>
  std::vector<MeshPoint> points_within(MortonKey leaf, double distance,
                                       const IsTaken& is_taken) const;
  double crease_floor() const;
  // What leaves have of it goes there by `add`.
  DomainPiece piece_in(const Box& region, GridFineness fineness,
                       void (DomainPiece::*add)(const LeafSurface&) = &DomainPiece::add) const;

  RunView run_;
  const StopToken* stop_;
};

inline constexpr double kDistanceSlack = 1.01;  // on distances whose exact value does not matter

// Of a LeafDomain's grid, with resolutions over the size. Making a fine one pays where all facets
// of a leaf are held against it; first points and the few facets of a later visit ask less.
inline constexpr GridFineness kFinenessOfCover{4, 64};
inline GridFineness fineness(GridFineness over_size, double size) {
  return {over_size.resolution * size, over_size.triangles_per_cell};
}
// `size`: the least that matters there
double volume_over_size(const Box& box, double size);

}  // namespace locvol
