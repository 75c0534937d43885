// The creases in a leaf's triangulation: which vertices follow each other on them, which balls no
// other vertex may enter, and which sheets a vertex lies on. Internal to refine/.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "refine/crease_graph.h"
#include "refine/leaf_mesh.h"
#include "refine/point_cubes.h"

namespace locvol {

class LeafCreases {
 public:
  // All must outlive it. `points`: LeafInput::crease_points
  LeafCreases(const LeafDomain& domain, const LeafMesh& mesh, std::span<const MeshPoint> points,
              double size);

  // ---- Points. To be told of each that the mesh gets.
  void add(LocalIndex v);

  // ---- Segments, between vertices that follow each other on a crease
  struct Segment {
    LocalIndex a = 0, b = 0;
    CreaseGraph::Neighbor way;  // from a to b
  };
  // At a vertex of kind kCrease; without those whose other end is not known.
  void segments(LocalIndex v, std::vector<Segment>& out) const;
  // Its middle; or, of a point that it has in its way, the place where that is closest to it, if
  // this is not close to an end.
  Point halved(const Segment& segment, const std::optional<Point>& q) const;
  // Between the sheets that meet along it, outside or inside, in radians.
  double angle(const Segment& segment) const;

  // ---- Points that slide
  // Appends the places that a vertex has along its crease at these parts of the way to its closer
  // neighbor, towards each. None if the crease ends or is to have a vertex there, or if a neighbor
  // is not known.
  void append_places_along(LocalIndex v, std::span<const double> parts,
                           std::vector<Point>& out) const;
  // Likewise the place to which `shift`, short beside the way to a neighbor, leads along the
  // crease.
  void append_place_towards(LocalIndex v, const Point& shift, std::vector<Point>& out) const;
  // May it stand there? Its steps are at most so long and turn by at most kMostTurn, its sheets are
  // the same, and it is in no smallest ball around another segment.
  bool may_slide(LocalIndex v, const Point& q, double most_step) const;
  // Its neighbors on the crease: of one that may slide, two.
  std::array<LocalIndex, 2> neighbors_of(LocalIndex v) const;
  // It has moved, between its neighbors.
  void slide(LocalIndex v);

  // May more than two triangles meet along creases here?
  bool has_junctions() const { return !domain_.only_body(); }
  // How many meet along the segment, beside its first vertex; 0: it is not known.
  std::size_t num_sides(const Segment& segment) const;

  // ---- Balls
  // Those around vertices: where first points and mirrors do not come, nor others that move.
  bool is_in_ball(const Point& q) const;
  // Of the smallest balls around segments, that which has q most deeply in it. Null: none has.
  // Ends that are not in the triangulation are kInfiniteVertex. `but_at`: not of segments there
  std::optional<Segment> segment_at(const Point& q, LocalIndex but_at = kInfiniteVertex) const;

  // ---- Sheets
  // That a vertex on the surface lies on: of a crease, all that meet there. Ascending.
  std::span<const SheetId> sheets(LocalIndex v) const;
  bool have_common_sheet(LocalIndex a, LocalIndex b, LocalIndex c) const;
  bool have_common_sheet(LocalIndex a, LocalIndex b) const;
  // Are these places of the surface on sides that face each other?
  bool are_facing(const Point& a, const Point& b) const;
  // Do they follow each other on a crease?
  bool is_neighbor(LocalIndex a, LocalIndex b) const;
  // C6 is not asked of a cell whose shortest edge leads from sheet to sheet, across a thin part of
  // one, or from crease to crease: there the surface itself comes that close.
  bool is_exempt(const std::array<LocalIndex, 4>& vertices,
                 const std::array<Point, 4>& corners) const;
  // Unit normals of the surface at vertices, 0 on a crease. Null if not all lie on it.
  std::optional<std::array<Point, 4>> normals(const std::array<LocalIndex, 4>& vertices,
                                              const std::array<Point, 4>& corners) const;

 private:
  struct Ball {
    Point position;
    CreaseGraph::Index index = 0;
  };
  double tolerance() const { return kOffCrease * size_; }
  // Of a segment that ends at an acute corner: how far along it is as far from there as the first
  // point on another crease, if that is closer.
  std::optional<double> as_far_as_others(const Segment& segment) const;
  void match(LocalIndex v, CreaseGraph::Index index);
  // To both neighbors, of one that may slide; else null.
  std::optional<std::array<CreaseGraph::Neighbor, 2>> ways_to_slide(LocalIndex v) const;
  CreaseGraph::Index index_of(LocalIndex v) const {
    return v < index_.size() ? index_[v] : CreaseGraph::kNone;
  }

  const LeafDomain& domain_;
  const LeafMesh& mesh_;
  std::span<const MeshPoint> points_;  // in order of id
  std::vector<CreaseGraph::Index> index_of_points_;
  const double size_;
  CreaseGraph graph_;
  std::vector<CreaseGraph::Index> index_;  // of locals
  std::vector<LocalIndex> local_;          // of the graph's points, or kInfiniteVertex
  std::vector<double> radius_;             // likewise
  double largest_radius_ = 0;
  std::optional<CubesOf<Ball>> balls_;
  mutable std::vector<std::vector<SheetId>> sheets_;  // of locals, as far as they were asked for
  mutable std::vector<CreaseGraph::Neighbor> neighbors_;
  mutable std::vector<std::size_t> num_sides_;  // of edges, with one more, as far as asked for
};

}  // namespace locvol
