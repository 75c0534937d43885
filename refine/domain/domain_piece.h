// DomainPiece: of the domain what matters around a leaf, as a value, which can be stored, sent and
// replayed. A LeafDomain is built from it.
#pragma once

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <vector>

#include "octree/crease.h"
#include "octree/domain_state.h"
#include "octree/geometry.h"
#include "octree/leaf_surface.h"
#include "octree/sort_and_unite.h"

namespace locvol {

// How fine a LeafDomain's grid is. Decides no answer but distance_bound's.
struct GridFineness {
  double resolution = 0;          // distances to the surface of about this size matter; 0: unknown
  double triangles_per_cell = 4;  // at most, on average over cells that the surface passes through
  friend bool operator==(const GridFineness&, const GridFineness&) = default;
};

struct DomainPiece {
  std::vector<Triangle> triangles;  // all that meet `region`, each once, and others; in order of id
  Box region;
  Point reference;                   // in `region`
  DomainState reference_state = {};  // of that place
  GridFineness fineness = {};
  bool is_whole = false;  // nothing of the domain lies beyond `region`; else it is not loaded there
  std::vector<CreaseEdge> creases = {};   // likewise, in order of their ends
  std::vector<CornerPoint> corners = {};  // all in `region`, in order of id
  double crease_floor = 0;                // what of creases is shorter than this is not told apart

  // Adds what comes close to the region. Once all is there, each part of it is to be there once.
  void add(const LeafSurface& surface) {
    std::ranges::copy_if(surface.triangles, std::back_inserter(triangles),
                         [&](const Triangle& t) { return t.box().overlaps(region); });
    add_creases(surface);
  }
  void add_creases(const LeafSurface& surface) {
    std::ranges::copy_if(surface.creases, std::back_inserter(creases),
                         [&](const CreaseEdge& e) { return e.box().overlaps(region); });
    std::ranges::copy_if(surface.corners, std::back_inserter(corners),
                         [&](const CornerPoint& c) { return region.contains(c.position); });
  }
  void unite() {
    sort_and_unite(triangles, &Triangle::id);
    sort_and_unite(creases, &CreaseEdge::ends);
    sort_and_unite(corners, &CornerPoint::corner);
  }

  bool has_surface() const { return !triangles.empty(); }
  // What it weighs, in estimates.
  std::size_t surface_size() const { return triangles.size() + creases.size(); }
  // Of all of its surface.
  double area() const {
    double area = 0;
    for (const Triangle& t : triangles) {
      const auto& [a, b, c] = t.corners;
      area += 0.5 * norm(cross(b - a, c - a));
    }
    return area;
  }
  friend bool operator==(const DomainPiece&, const DomainPiece&) = default;
};

}  // namespace locvol
