// VertexMove tells what moving one vertex would do to a Delaunay triangulation, and changes
// nothing: so that many places can be tried. Internal to refine/.
//
// The vertex is taken out in thought: the hole that its cells leave is filled by wrapping, facet by
// facet, with cells between its neighbors. A place to try is then an insertion into these cells and
// those around. Signs are exact, and ties told as in Delaunay, so that the change can be made as it
// is.
//
// Cost: 4 µs for the hole, 2 µs for a place.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "refine/delaunay.h"

namespace locvol {

class VertexMove {
 public:
  using Vertex = Delaunay::Vertex;
  using Cell = Delaunay::Cell;
  using NewCell = Delaunay::NewCell;
  using Change = Delaunay::Change;

  // What a cell at the vertex must not go beyond.
  struct Limits {
    double cosine = 1;                                                // of its dihedral angles
    double squared_radius = std::numeric_limits<double>::infinity();  // of its circumsphere
    double radius_edge = std::numeric_limits<double>::infinity();     // its ratio
    bool are_any() const { return cosine < 1; }
  };

  // Valid while the triangulation is as it is; take_out() begins anew after a change.
  explicit VertexMove(const Delaunay& delaunay) : delaunay_(delaunay) {}

  // Takes v out in thought. False if it is not surrounded by finite cells, or has too many.
  bool take_out(Vertex v);
  // Puts a new vertex, whose number would be the next, where there is none yet; for insertions.
  void put_in_new() { begin(static_cast<Vertex>(delaunay_.num_vertices())); }

  const std::vector<Cell>& star() const { return star_; }  // the cells at the vertex
  // For each cell that the change found last makes, the largest of its dihedral angles' cosines.
  const std::vector<double>& cosines() const { return cosines_; }
  // The change that puts the vertex at q. False if q is not in the hole or at another vertex, if a
  // cell at the vertex goes beyond the limits, or if too large a part of the triangulation would
  // change. Valid until the next call.
  bool find(const Point& q, const Limits& limits, Change& change);
  // Finds what find() finds, of a new vertex; false also if `start` is not in conflict with q.
  bool find_insertion(const Point& q, Cell start, const Limits& limits, Change& change);

 private:
  static constexpr std::uint32_t kNew = Delaunay::kNewCell;
  static constexpr std::size_t kMaxFacets = 200;                   // of a border
  static constexpr std::size_t kMaxVertices = kMaxFacets / 2 + 2;  // on it, a sphere

  // A facet that has a cell on one side only so far.
  struct Open {
    std::array<Vertex, 3> corner;  // with a vertex on the open side: positively oriented
    std::uint32_t beyond = 0;      // the cell on the other side; kNew |: of hole_
    int index = 0;                 // of the facet in that cell
  };
  // A facet between the hole and a cell around it.
  struct Rim {
    Cell outer = 0;
    int index = 0;
    std::uint32_t inner = 0;  // in hole_
  };
  // A facet on the border of the cells in conflict with the place.
  struct Border {
    std::uint32_t inside = 0, beyond = 0;
    std::array<Vertex, 3> corner;
    WayToCenter way;  // from the place, of the cell there
    double cosine = 0;
  };
  enum class Seen : std::uint8_t { kNot, kInside, kOutside };

  void begin(Vertex v);
  bool fill_hole();
  Vertex apex(const Open& facet);
  Vertex exact_apex(const Open& facet) const;
  bool is_delaunay(const NewCell& cell) const;
  const Point& point(Vertex v) const { return delaunay_.point(v); }
  std::array<Point, 4> corners(const NewCell& cell) const {
    return {point(cell.vertex[0]), point(cell.vertex[1]), point(cell.vertex[2]),
            point(cell.vertex[3])};
  }
  bool is_any_at(std::span<const Vertex> vertices, const Point& q) const;
  bool is_in_conflict(std::uint32_t cell, const Point& q) const;
  std::uint32_t beyond(std::uint32_t cell, int index) const;
  const std::array<Vertex, 4>& vertices(std::uint32_t cell) const {
    return cell & kNew ? hole_[cell & ~kNew].vertex : delaunay_.vertices(cell);
  }
  Seen& seen(std::uint32_t cell);
  bool spread(const Point& q, const Limits& limits);
  bool make_cells(const Point& q, Change& change);
  std::uint32_t place_on_border(Vertex v);

  const Delaunay& delaunay_;
  Vertex vertex_ = Delaunay::kNone;
  std::vector<Cell> star_;
  // Neighbors of the vertex; their coordinates side by side, not numbers behind the last; and room
  // for a value of each.
  static constexpr std::size_t kLanes = 4;
  using Lanes [[gnu::vector_size(kLanes * sizeof(double))]] = double;
  std::vector<Vertex> link_;
  std::array<std::vector<Lanes>, 3> link_points_;
  std::vector<Lanes> heights_;
  std::vector<NewCell> hole_;
  std::vector<double> hole_cosines_;  // once they are needed
  std::vector<Rim> rim_;
  std::vector<Open> open_;

  // Marks of cells: whether they are of the star, and what is known of them and the place. Both
  // count only under the stamp of the day.
  struct Mark {
    std::uint32_t star = 0, place = 0;
    Seen seen = Seen::kNot;
  };
  std::vector<Mark> marks_;
  std::vector<Seen> seen_in_hole_;
  std::uint32_t star_stamp_ = 0, place_stamp_ = 0;
  std::vector<std::uint32_t> inside_;  // in conflict
  std::vector<Border> border_;
  std::vector<double> cosines_;

  struct OnBorder {
    std::uint32_t stamp = 0, place = 0;
  };
  std::vector<OnBorder> on_border_;  // of vertices
  std::uint32_t border_stamp_ = 0, num_on_border_ = 0;
  std::array<std::array<std::uint8_t, kMaxVertices>, kMaxVertices> facet_at_edge_;
};

}  // namespace locvol
