// Delaunay: CGAL's Delaunay triangulation of points in space, with numbers for its vertices and
// cells. Internal to refine/.
//
// Equal calls give equal numbers: nothing depends on addresses, as CGAL's own lists of cells do
// after removals. A cell beyond the convex hull has the vertex kInfinite at index 3; every other
// cell is positively oriented, and of the orders of its vertices that make it so it has the one
// that ascends but for the first two. Cospherical points are moved apart in thought, by their
// coordinates alone (Devillers and Teillaud, "Perturbations for Delaunay and weighted Delaunay 3D
// triangulations", 2011): the same points always have the same cells.
//
// Memory: 160 bytes a cell, with its share of a vertex. Time: about 6 µs a vertex in a build.
// Threads: used by one at a time; const functions use scratch.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <stdexcept>
#include <utility>
#include <vector>

#include "octree/geometry.h"
#include "octree/sort_and_unite.h"
#include "octree/stop.h"
#include "refine/ball_filter.h"

namespace locvol {

// Sorts the vertices of a cell; true if that took an odd number of exchanges. Without branches,
// which nobody could foretell.
template <class Name>
bool sort_oddly(std::array<Name, 4>& v) {
  bool is_odd = false;
  const auto order = [&](std::size_t a, std::size_t b) {
    const Name first = v[a], second = v[b];
    v[a] = std::min(first, second);
    v[b] = std::max(first, second);
    is_odd ^= second < first;
  };
  order(0, 1), order(2, 3), order(0, 2), order(1, 3), order(1, 2);
  return is_odd;
}

// Sorts the vertices of a cell as far as its orientation permits.
template <class Name>
void sort_oriented(std::array<Name, 4>& v) {
  if (sort_oddly(v)) std::swap(v[2], v[3]);
}

// The vertices of cells or facets in ascending order, once each.
template <class Name, std::size_t kNum>
std::vector<Name> distinct_vertices(const std::vector<std::array<Name, kNum>>& items) {
  std::vector<Name> vertices;
  vertices.reserve(kNum * items.size());
  for (const auto& item : items) vertices.insert(vertices.end(), item.begin(), item.end());
  sort_and_unite(vertices);
  return vertices;
}

// A facet's corners by the index of the vertex off it, counterclockwise seen from that: with it,
// last, they are positively oriented.
inline constexpr std::array<std::array<int, 3>, 4> kFacetCorners{
    {{1, 3, 2}, {0, 2, 3}, {0, 3, 1}, {0, 1, 2}}};

// Of the facet opposite the vertex `off`, in this order.
template <class Name>
std::array<Name, 3> facet_of(const std::array<Name, 4>& cell, int off) {
  const auto& [a, b, c] = kFacetCorners[std::size_t(off)];
  return {cell[std::size_t(a)], cell[std::size_t(b)], cell[std::size_t(c)]};
}

// The predicates contradict each other: a bug, or arithmetic that is not what it should be. What is
// left of the triangulation is of no use.
class DelaunayError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// build(), find_conflict(), insert() and remove() throw DelaunayError.
class Delaunay {
 public:
  using Vertex = std::uint32_t;
  using Cell = std::uint32_t;
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
  static constexpr Vertex kInfinite = kNone;

  struct Facet {
    Cell cell = kNone;
    int index = 0;  // of the vertex off the facet
  };

  Delaunay();
  ~Delaunay();
  Delaunay(const Delaunay&) = delete;
  Delaunay& operator=(const Delaunay&) = delete;

  // Adds vertices, numbered on from those there are, and numbers all cells anew, by their smallest
  // vertex. Without four points in general position there are no cells yet. False if two points
  // coincide. Fastest if the points follow a space-filling curve, and so is what looks at all cells
  // in order of number: neighbors are then close in memory. Throws Stopped, and is of no use then.
  bool build(std::span<const Point> points, const StopToken* stop = nullptr);

  bool has_cells() const { return !corners_.empty(); }
  std::size_t num_vertices() const { return points_.size(); }
  const Point& point(Vertex v) const { return points_[v]; }
  Cell cell_of(Vertex v) const { return cell_of_[v]; }  // one that has it, or kNone if removed

  // Cells are numbered below cell_bound(), with gaps; numbers of cells that are gone return.
  Cell cell_bound() const { return static_cast<Cell>(corners_.size()); }
  bool is_cell(Cell c) const { return corners_[c].vertex[0] != corners_[c].vertex[1]; }
  bool is_infinite(Cell c) const { return corners_[c].vertex[3] == kInfinite; }
  bool is_infinite(Facet f) const { return is_infinite(f.cell) && f.index != 3; }
  const std::array<Vertex, 4>& vertices(Cell c) const { return corners_[c].vertex; }
  Vertex vertex(Cell c, int i) const { return corners_[c].vertex[std::size_t(i)]; }
  Cell neighbor(Cell c, int i) const { return corners_[c].neighbor[std::size_t(i)]; }
  // REQUIRES: c has v
  int index_of(Cell c, Vertex v) const { return place_of(v, corners_[c].vertex); }
  // REQUIRES: they are neighbors
  int index_of_neighbor(Cell c, Cell neighbor) const {
    return place_of(neighbor, corners_[c].neighbor);
  }
  void cells_around(Vertex v, std::vector<Cell>& out) const;
  void neighbors_of(Vertex v, std::vector<Vertex>& out) const;  // finite ones

  // What inserting a point would replace.
  struct Conflict {
    std::vector<Cell> cells;
    std::vector<Facet> border;  // between these and the cells around, of the latter
    Vertex coincident = kNone;  // a vertex at this place; then the rest is empty
  };
  // `hint`: a cell, best one nearby. REQUIRES: has_cells()
  void find_conflict(const Point& q, Cell hint, Conflict& conflict) const;
  // The vertex of q, whose `conflict` is given; new_cells() are those around it.
  Vertex insert(const Point& q, const Conflict& conflict);
  // Removes the vertices at once, which takes a fraction of the time of one after another. Their
  // numbers are not used again. False if all cells were numbered anew, and their old numbers mean
  // nothing. REQUIRES: different vertices, at least one
  bool remove(std::span<const Vertex> vertices);

  // A cell that a change would make.
  struct NewCell {
    std::array<Vertex, 4> vertex;           // positively oriented
    std::array<std::uint32_t, 4> neighbor;  // opposite the vertex: a cell, or kNewCell | an index
    WayToCenter way;                        // from vertex 3
  };
  static constexpr std::uint32_t kNewCell = std::uint32_t{1} << 31;
  // The triangulation as it is once `vertex` is at `place`.
  struct Change {
    Vertex vertex = kNone;
    Point place;
    std::vector<Cell> gone;
    std::vector<NewCell> made;
  };
  // Tells whether q is in the cell's circumball; by symbolic perturbation if it is on it.
  bool is_in_conflict(Cell c, const Point& q) const;
  // Tells the same of a cell that may not be there, positively oriented.
  bool is_in_circumball(const std::array<Point, 4>& cell, const Point& p) const;
  // REQUIRES: what `change` says is so; vertex_move finds it
  void move(const Change& change);

  const std::vector<Cell>& new_cells() const {
    return new_cells_;
  }                                                       // of the last insert, move or remove
  Cell newest_cell() const { return new_cells_.back(); }  // REQUIRES: has_cells()

 private:
  struct Impl;
  struct Corners {
    std::array<Vertex, 4> vertex;  // all equal: not a cell
    std::array<Cell, 4> neighbor;  // opposite the vertex
  };

  static int place_of(std::uint32_t number, const std::array<std::uint32_t, 4>& all) {
    return number == all[0] ? 0 : number == all[1] ? 1 : number == all[2] ? 2 : 3;
  }
  void number_all();
  void number_new();
  void set_corners(Cell c, const std::array<Vertex, 4>& sorted, bool is_odd);
  void free_cells(std::span<const Cell> cells);

  std::unique_ptr<Impl> impl_;
  std::vector<Point> points_;
  std::vector<Cell> cell_of_;
  std::vector<Corners> corners_;
  std::vector<Cell> free_;
  std::vector<Cell> new_cells_;
  bool has_removed_ = false;

  mutable std::vector<std::uint32_t> mark_;  // of cells; below epoch_: not seen
  mutable std::uint32_t epoch_ = 1;
  mutable std::vector<Cell> seen_, around_;
};

}  // namespace locvol
