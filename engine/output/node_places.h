// NodePlaces finds where the nodes of boundary edges lie on the surface, around one leaf.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "octree/leaf_surface.h"
#include "refine/crease_segments.h"
#include "refine/domain/box_tree.h"
#include "refine/domain/leaf_domain.h"

namespace locvol {

// What is known of the edge of two boundary facets.
struct BoundaryEdgeShape {
  std::array<Point, 2> ends;
  std::array<SheetId, 2> sheets = {1, 1};  // of the facets
  Point outward;                           // the sum of their unit normals
};

// Nodes are no farther off the middle than this, over the edge's length. What is closer to it than
// the other is in it: the surface is flat there, but for rounding.
inline constexpr double kFarthestNode = 0.25, kFlat = 1e-7;

class NodePlaces {
 public:
  // `triangles`: all that come close to the edges' middles, in order of id. `creases`, if there are
  // any: edges and corners within reach of the leaf; `crease_points`: of the mesh, there. `size`: λ
  NodePlaces(std::vector<Triangle> triangles, DomainPiece creases, std::vector<Point> crease_points,
             double size);

  // Of an edge between points that follow each other on a crease, the place on it that is closest
  // to the edge's middle. Of any other, that of the facets' sheets, where these face the same way.
  // Null: none is close enough.
  std::optional<Point> place(const BoundaryEdgeShape& edge) const;

 private:
  // Null: the ends do not follow each other.
  const CreaseSegment* segment(const BoundaryEdgeShape& edge) const;
  std::optional<Point> on_sheets(const BoundaryEdgeShape& edge, const Point& q,
                                 double distance) const;

  std::vector<Triangle> triangles_;
  BoxTree tree_;
  std::vector<Point> crease_points_;  // ascending
  std::vector<CreaseSegment> segments_;
};

}  // namespace locvol
