// The creases around a leaf as a graph, and points of P on them: which follow each other, and the
// balls around them that no other point may enter. Internal to refine/.
//
// A point on a crease has its place from its coordinates and the edges alone, so all leaves that
// have loaded both find the same neighbors for it.
//
// Fixed vertices that are closer along creases than the domain's crease_floor() are one: the first
// of them, corners before others, each in lexicographic order. Edges between such are left out, as
// are creases that come back to where they began within three floors.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "octree/crease.h"
#include "octree/geometry.h"
#include "refine/domain/leaf_domain.h"

namespace locvol {

// Radius of a crease point's ball over the distance to the farther one of its neighbors: a little
// more than 1/√2, so that the balls of two neighbors hold the ball on the segment between them.
inline constexpr double kCreaseBall = 0.7072;
// How far from its edge a point on a crease may lie, over λ: the point is rounded.
inline constexpr double kOffCrease = 1e-6;
// Cosine: creases that meet at less than 60 degrees, but for rounding, make a corner acute.
inline constexpr double kAcuteCorner = 0.5 + 1e-6;
// Between edges of a crease, in degrees: a vertex that turns by more has a point of P.
inline constexpr double kFixedTurn = 25;

class CreaseGraph {
 public:
  using Edge = std::uint32_t;    // place in LeafDomain::creases()
  using Vertex = std::uint32_t;  // end of an edge
  using Index = std::uint32_t;   // of a point that was added
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

  explicit CreaseGraph(const LeafDomain& domain);

  std::span<const CreaseEdge> edges() const { return edges_; }
  bool is_left_out(Edge e) const { return is_left_out_[e]; }
  std::size_t num_vertices() const { return positions_.size(); }
  const Point& position(Vertex v) const { return positions_[v]; }
  const std::array<Vertex, 2>& ends(Edge e) const { return ends_[e]; }
  double length(Edge e) const { return lengths_[e]; }
  std::span<const Edge> edges_at(Vertex v) const {
    return {at_vertex_.data() + first_at_[v], first_at_[v + 1] - first_at_[v]};
  }
  // Does a crease end there, or turn so far that the vertex is to be one of the mesh? Of several
  // that are one, the first.
  bool is_fixed(Vertex v) const { return is_fixed_[v]; }
  // By how much the crease turns there, in radians; 0 where it ends.
  double turn(Vertex v) const { return turns_[v]; }
  std::optional<Vertex> vertex_at(const Point& p) const;  // that one

  // On an edge, so far from its first end.
  struct Place {
    Edge edge = 0;
    double along = 0;
    friend bool operator==(const Place&, const Place&) = default;
  };
  Point position(const Place& place) const;
  std::optional<Place> place_of(const Point& p, double tolerance) const;
  // To go along creases: from a place, towards the edge's second end or its first.
  struct Heading {
    Place from;
    bool is_forward = true;
    double left(const CreaseGraph& graph) const {
      return is_forward ? graph.length(from.edge) - from.along : from.along;
    }
    Vertex next(const CreaseGraph& graph) const { return graph.ends(from.edge)[is_forward]; }
  };
  // From an end of the edge into it.
  Heading into(Edge e, Vertex from) const {
    return ends_[e][0] == from ? Heading{{e, 0}, true} : Heading{{e, lengths_[e]}, false};
  }
  // Past the vertex that a heading comes to: null where the crease is not loaded any farther, or
  // ends.
  std::optional<Heading> past(const Heading& heading) const;
  // All that leave a place: two, or of a vertex one for each of its edges.
  std::vector<Heading> headings(const Place& place) const;

  // ---- Points of P
  // Takes in a point of a crease. `tolerance`: how far from it an edge may be, by rounding. Null:
  // there is none.
  std::optional<Index> add(const Point& p, double tolerance);
  void remove(Index i);  // its index stays its own
  std::size_t num_points() const { return points_.size(); }
  const Point& point(Index i) const { return points_[i].position; }
  const Place& place(Index i) const { return points_[i].place; }
  bool has_point_at(Vertex v) const { return point_at_[v] != kNone; }
  Index point_at(Vertex v) const { return point_at_[v]; }
  bool has_point_at(const Place& place) const;
  // The first point on an edge beyond a place of it.
  Index next_on_edge(const Heading& heading) const;
  struct Neighbor {
    Index point = kNone;  // none: the crease is not loaded that far
    double along = 0;     // the way to it
    Heading heading;      // to it
  };
  // Of a point, in the order of headings().
  void neighbors(Index i, std::vector<Neighbor>& out) const;
  Neighbor neighbor(const Heading& heading) const;
  // Of the way from there, which is so long, the straight parts: visit(begin, end, way to it).
  template <class Visit>
  void for_each_part(const Heading& start, double length, const Visit& visit) const {
    double along = 0;
    for (std::optional<Heading> heading = start; heading && along < length;
         heading = past(*heading)) {
      const double part = std::min(heading->left(*this), length - along);
      const Place& from = heading->from;
      const Place to{from.edge, from.along + (heading->is_forward ? part : -part)};
      visit(position(from), position(to), along);
      along += part;
    }
  }
  // So far on the way. REQUIRES: length > 0
  Point position_along(const Heading& start, double length) const {
    Point place;
    for_each_part(start, length, [&](const Point&, const Point& end, double) { place = end; });
    return place;
  }
  // Of the edges that it lies on: ascending. Where several bodies meet, of all triangles at these.
  void sheets(Index i, std::vector<SheetId>& out) const { sheets(points_[i].place, out); }
  void sheets(const Place& place, std::vector<SheetId>& out) const;
  // By how much the crease turns on the way, which is so long, in radians.
  double turn(const Heading& start, double length) const;
  // Of the point's ball; 0 if no neighbor is known.
  double ball_radius(Index i) const;

 private:
  // At which end of its edge it is, if at one.
  std::optional<Vertex> vertex_of(const Place& place) const {
    if (place.along > 0 && place.along < lengths_[place.edge]) return std::nullopt;
    return ends_[place.edge][place.along > 0];
  }

  struct Held {
    Point position;
    Place place;
  };

  void list_edges();
  void find_fixed();
  void join_close(double floor);
  void join_around(Vertex v, double floor, std::vector<Vertex>& reached_from);
  void leave_out_short(double most);
  void leave_out_if_short(Edge start, double most);

  const LeafDomain& domain_;
  std::span<const CreaseEdge> edges_;
  std::vector<bool> is_left_out_;
  std::vector<Vertex> one_of_;    // of vertices, the one that they are
  std::vector<Point> positions_;  // ascending
  std::vector<std::array<Vertex, 2>> ends_;
  std::vector<double> lengths_;
  std::vector<std::uint32_t> first_at_;
  std::vector<Edge> at_vertex_;
  std::vector<double> turns_;
  std::vector<bool> is_fixed_, is_corner_;
  std::vector<bool> is_first_;  // others are one with it
  std::vector<Held> points_;
  double tolerance_ = 0;                     // of these
  std::vector<Index> point_at_;              // of vertices
  std::vector<std::vector<Index>> on_edge_;  // between its ends, in order
  mutable std::vector<Neighbor> neighbors_;
};

}  // namespace locvol
