#include "refine/delaunay.h"

#include <CGAL/Delaunay_triangulation_3.h>
#include <CGAL/Delaunay_triangulation_cell_base_3.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_cell_base_with_info_3.h>
#include <CGAL/Triangulation_vertex_base_with_info_3.h>
#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cassert>
#include <functional>
#include <numeric>
#include <optional>
#include <utility>

#include "octree/mix.h"
#include "octree/sort_and_unite.h"
#include "refine/ball_filter.h"
#include "refine/near_sphere.h"

namespace locvol {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
struct VertexInfo {
  Delaunay::Vertex number = Delaunay::kNone;
  // On the border of the cavity with this stamp: its place among the vertices there.
  std::uint32_t place = 0;
  std::uint64_t stamp = 0;
};
// Of a cell.
struct CellInfo {
  Delaunay::Cell number = Delaunay::kNone;
  WayToCenter to_center;  // from vertex 3
};
using VertexBase = CGAL::Triangulation_vertex_base_with_info_3<VertexInfo, Kernel>;
using CellBase =
    CGAL::Triangulation_cell_base_with_info_3<CellInfo, Kernel,
                                              CGAL::Delaunay_triangulation_cell_base_3<Kernel>>;
using CgalDelaunay =
    CGAL::Delaunay_triangulation_3<Kernel,
                                   CGAL::Triangulation_data_structure_3<VertexBase, CellBase>>;
struct Triangulation : CgalDelaunay {
  using CgalDelaunay::side_of_oriented_sphere;  // with symbolic perturbation, for cells yet to be
};
using CellHandle = Triangulation::Cell_handle;
using VertexHandle = Triangulation::Vertex_handle;

Kernel::Point_3 cgal(const Point& p) { return {p.x, p.y, p.z}; }
Point ours(const Kernel::Point_3& p) { return {p.x(), p.y(), p.z()}; }
std::array<Point, 4> corners_of(CellHandle c) {
  return {ours(c->vertex(0)->point()), ours(c->vertex(1)->point()), ours(c->vertex(2)->point()),
          ours(c->vertex(3)->point())};
}

// Is p in the cell's circumball, and so no vertex? Empty where to_center does not tell.
[[gnu::always_inline]] inline std::optional<bool> is_in_ball(CellHandle c,
                                                             const Kernel::Point_3& p) {
  return locvol::is_in_ball(c->info().to_center, ours(c->vertex(3)->point()), ours(p));
}

// In which to insert points that follow a space-filling curve: an eighth of them after an eighth of
// these and so on, each round along the curve (Amenta, Choi and Rote, "Incremental constructions
// con BRIO", 2003).
std::vector<std::uint32_t> insertion_order(std::size_t num_points) {
  constexpr int kMaxRound = 6;
  std::vector<std::uint32_t> order;
  order.reserve(num_points);
  for (int round = kMaxRound; round >= 0; --round)
    for (std::uint32_t i = 0; i < num_points; ++i)
      if (std::min(std::countr_zero(mix(i)) / 3, kMaxRound) == round) order.push_back(i);
  return order;
}

using Vertices = std::array<Delaunay::Vertex, 4>;

Delaunay::Vertex vertex_number(CellHandle c, int i) { return c->vertex(i)->info().number; }

Vertices vertices_of(CellHandle c) {
  return {c->vertex(0)->info().number, c->vertex(1)->info().number, c->vertex(2)->info().number,
          c->vertex(3)->info().number};
}

}  // namespace

struct Delaunay::Impl {
  Triangulation triangulation;
  std::vector<VertexHandle> vertices;  // by number
  std::vector<CellHandle> cells;       // by number
  std::vector<CellHandle> new_cells;   // of the change at hand
  // Of cells that are being numbered: their vertices in CGAL's order, so that its cells and
  // vertices, which are all over memory, are read once.
  struct Fresh {
    Vertices sorted, original;
    CellHandle handle;
    bool is_odd = false;

    explicit Fresh(CellHandle c) : sorted(vertices_of(c)), original(sorted), handle(c) {
      is_odd = sort_oddly(sorted);
    }
  };
  std::vector<Fresh> fresh;  // of number_new()

  // A new point's: the cells in conflict with it, which are connected; and the cells around these,
  // each with the index of a facet between.
  struct Cavity {
    std::vector<CellHandle> inside;
    std::vector<Triangulation::Facet> border;
  };
  Cavity cavity;

  // A cell in conflict with a new point; or a vertex at its place, which forbids it.
  struct Start {
    CellHandle in_conflict;
    VertexHandle there;
  };

  VertexHandle insert(const Kernel::Point_3& p, CellHandle hint);
  Start start_for(const Kernel::Point_3& p, CellHandle hint) const;
  Start locate(const Kernel::Point_3& p, CellHandle from) const;
  bool is_in_conflict(CellHandle c, const Kernel::Point_3& p) const {
    if (const auto is_inside = is_in_ball(c, p)) return *is_inside;
    if (!triangulation.is_infinite(c))
      if (const auto is_inside = is_in_near_sphere(corners_of(c), ours(p))) return *is_inside;
    return triangulation.side_of_sphere(c, p, true) == CGAL::ON_BOUNDED_SIDE;
  }
  void find_cavity(const Kernel::Point_3& p, CellHandle in_conflict);
  VertexHandle fill_cavity(const Kernel::Point_3& p);
  void find_new_cells(std::span<const CellHandle> rim);

 private:
  VertexHandle fill_small_cavity(const Point& p);
  VertexHandle fill_large_cavity(const Point& p);
  // In order of first call; the same for the same vertex.
  std::uint32_t place_on_border(VertexHandle v) {
    VertexInfo& at = v->info();
    if (std::exchange(at.stamp, stamp) != stamp) at.place = num_on_border++;
    return at.place;
  }
  // All vertices of the border have places. It has each edge twice or more often, as what bounds
  // cells has; by Euler's formula it is a sphere. CGAL would fill another one for ever.
  void require_ball(const Point& p) const {
    if (2 * std::size_t{num_on_border} != cavity.border.size() + 4) throw_no_ball(p);
  }
  [[noreturn]] static void throw_no_ball(const Point& p) {
    throw DelaunayError(
        fmt::format("the cavity of a new point is no ball, at ({}, {}, {})", p.x, p.y, p.z));
  }

  static constexpr std::size_t kMaxBorder = 124;                   // of a small cavity, in facets
  static constexpr std::size_t kMaxVertices = kMaxBorder / 2 + 2;  // on its border, a sphere
  // Of a small cavity's border, by the places of an edge's ends: the facet that has the edge in
  // this direction. The facet beyond the edge has it in the other one.
  std::array<std::array<std::uint8_t, kMaxVertices>, kMaxVertices> facet_at_edge;
  std::array<std::array<std::uint32_t, 3>, kMaxBorder> corners;  // of facets, as places
  std::uint64_t stamp = 0;
  std::uint32_t num_on_border = 0;
};

// What CGAL's insert() does, for points in space that are no vertices; its cavities are filled
// through a hash map, which takes half as long again in all.
VertexHandle Delaunay::Impl::insert(const Kernel::Point_3& p, CellHandle hint) {
  if (triangulation.dimension() < 3) return triangulation.insert(p, hint);
  const auto [start, there] = start_for(p, hint);
  if (there != VertexHandle()) return there;
  find_cavity(p, start);
  return fill_cavity(p);
}

// The balls of the cells where a walk begins and ends often tell, and then nothing needs to be
// located exactly.
Delaunay::Impl::Start Delaunay::Impl::start_for(const Kernel::Point_3& p, CellHandle hint) const {
  if (is_in_ball(hint, p).value_or(false)) return {hint, {}};
  const CellHandle near = triangulation.inexact_locate(p, hint);
  if (is_in_ball(near, p).value_or(false)) return {near, {}};
  return locate(p, near);
}

// A walk from cell to cell through facets that p is beyond. In a Delaunay triangulation none comes
// twice, whichever facets are taken (De Floriani, Falcidieno, Nagy and Pienovi, "On sorting
// triangles in a Delaunay tessellation", 1991). CGAL's own walk has no bound.
Delaunay::Impl::Start Delaunay::Impl::locate(const Kernel::Point_3& p, CellHandle from) const {
  const VertexHandle infinite = triangulation.infinite_vertex();
  int across = 0;
  if (from->has_vertex(infinite, across)) from = from->neighbor(across);
  const auto is_beyond_facet = [&](CellHandle c, int i) {
    std::array<const Kernel::Point_3*, 4> points;
    for (int k = 0; k < 4; ++k) points[std::size_t(k)] = k == i ? &p : &c->vertex(k)->point();
    return CGAL::orientation(*points[0], *points[1], *points[2], *points[3]) == CGAL::NEGATIVE;
  };
  CellHandle before;
  for (auto left = triangulation.tds().number_of_cells(); left > 0; --left) {
    int i = 0;
    while (i < 4 && (from->neighbor(i) == before || !is_beyond_facet(from, i))) ++i;
    if (i == 4) {
      for (int k = 0; k < 4; ++k)
        if (from->vertex(k)->point() == p) return {from, from->vertex(k)};
      return {from, {}};
    }
    before = from;
    from = from->neighbor(i);
    if (from->has_vertex(infinite)) return {from, {}};
  }
  throw DelaunayError(fmt::format("the walk to ({}, {}, {}) does not end", p.x(), p.y(), p.z()));
}

// Leaves no marks.
void Delaunay::Impl::find_cavity(const Kernel::Point_3& p, CellHandle in_conflict) {
  auto& [inside, border] = cavity;
  inside.clear();
  border.clear();
  const auto take_in = [&](CellHandle c) {
    c->tds_data().mark_in_conflict();
    inside.push_back(c);
    for (int i = 0; i < 4; ++i) {  // they are all over memory, and looked at soon
      const auto* next = reinterpret_cast<const char*>(&*c->neighbor(i));
      __builtin_prefetch(next);
      __builtin_prefetch(next + sizeof(Triangulation::Cell) - 1);
    }
  };
  take_in(in_conflict);
  for (std::size_t n = 0; n < inside.size(); ++n) {
    const CellHandle c = inside[n];
    for (int i = 0; i < 4; ++i) {
      const CellHandle next = c->neighbor(i);
      if (next->tds_data().is_in_conflict()) continue;
      if (next->tds_data().is_clear()) {
        if (is_in_conflict(next, p)) {
          take_in(next);
          continue;
        }
        next->tds_data().mark_on_boundary();
      }
      border.emplace_back(next, next->index(c));
    }
  }
  for (const CellHandle c : inside) c->tds_data().clear();
  for (const auto& [outside, index] : border) outside->tds_data().clear();
}

// A new cell for each facet of the border, in new_cells, and the vertex of them all.
VertexHandle Delaunay::Impl::fill_cavity(const Kernel::Point_3& p) {
  new_cells.clear();
  ++stamp;
  num_on_border = 0;
  const VertexHandle v =
      cavity.border.size() <= kMaxBorder ? fill_small_cavity(ours(p)) : fill_large_cavity(ours(p));
  v->set_point(p);
  return v;
}

// Cells that go make room for new ones.
VertexHandle Delaunay::Impl::fill_small_cavity(const Point& p) {
  auto& [inside, border] = cavity;
  auto& tds = triangulation.tds();
  const VertexHandle v = tds.create_vertex();
  for (std::size_t n = 0; n < border.size(); ++n) {
    const auto& [outside, index] = border[n];
    // Counterclockwise seen from v.
    const std::array<VertexHandle, 3> corner{
        outside->vertex(Triangulation::vertex_triple_index(index, 1)),
        outside->vertex(Triangulation::vertex_triple_index(index, 0)),
        outside->vertex(Triangulation::vertex_triple_index(index, 2))};
    if (n < inside.size()) {
      inside[n]->set_vertices(corner[0], corner[1], corner[2], v);
      new_cells.push_back(inside[n]);
    } else {
      new_cells.push_back(tds.create_cell(corner[0], corner[1], corner[2], v));
    }
    outside->set_neighbor(index, new_cells[n]);
    CellInfo& info = new_cells[n]->info();
    info = {};
    if (std::ranges::find(corner, triangulation.infinite_vertex()) == corner.end())
      info.to_center = way_to_center(ours(corner[0]->point()) - p, ours(corner[1]->point()) - p,
                                     ours(corner[2]->point()) - p);
    for (std::size_t k = 0; k < 3; ++k) {
      corners[n][k] = place_on_border(corner[k]);
      if (corners[n][k] >= kMaxVertices) throw_no_ball(p);
      corner[k]->set_cell(new_cells[n]);
    }
    const auto& [a, b, c] = corners[n];
    facet_at_edge[a][b] = facet_at_edge[b][c] = facet_at_edge[c][a] = static_cast<std::uint8_t>(n);
  }
  require_ball(p);
  for (std::size_t n = 0; n < border.size(); ++n) {
    const auto& [a, b, c] = corners[n];
    new_cells[n]->set_neighbors(new_cells[facet_at_edge[c][b]], new_cells[facet_at_edge[a][c]],
                                new_cells[facet_at_edge[b][a]], border[n].first);
  }
  for (std::size_t n = border.size(); n < inside.size(); ++n) tds.delete_cell(inside[n]);
  v->set_cell(new_cells[0]);
  return v;
}

// Of most or all of the hull.
VertexHandle Delaunay::Impl::fill_large_cavity(const Point& p) {
  for (const auto& [cell, off] : cavity.border)
    for (int k = 0; k < 3; ++k)
      place_on_border(cell->vertex(Triangulation::vertex_triple_index(off, k)));
  require_ball(p);
  const auto [outside, index] = cavity.border.front();
  const CellHandle begin = outside->neighbor(index);
  const VertexHandle v = triangulation.tds().insert_in_hole(
      cavity.inside.begin(), cavity.inside.end(), begin, begin->index(outside));
  triangulation.incident_cells(v, std::back_inserter(new_cells));
  return v;
}

// Those without a number, within a rim of cells that stay. Each gets some number.
void Delaunay::Impl::find_new_cells(std::span<const CellHandle> rim) {
  new_cells.clear();
  const auto take_in_neighbors = [&](CellHandle c) {
    for (int i = 0; i < 4; ++i) {
      const CellHandle next = c->neighbor(i);
      if (next->info().number != kNone) continue;
      next->info().number = 0;
      new_cells.push_back(next);
    }
  };
  std::ranges::for_each(rim, take_in_neighbors);
  for (std::size_t n = 0; n < new_cells.size(); ++n) take_in_neighbors(new_cells[n]);
}

Delaunay::Delaunay() : impl_(std::make_unique<Impl>()) {
  const VertexHandle infinite = impl_->triangulation.infinite_vertex();
  infinite->info().number = kInfinite;
  infinite->set_point({0, 0, 0});  // it is read, though it decides nothing
}
Delaunay::~Delaunay() = default;

void Delaunay::cells_around(Vertex v, std::vector<Cell>& out) const {
  out.clear();
  out.push_back(cell_of_[v]);
  ++epoch_;
  mark_[out[0]] = epoch_;
  for (std::size_t n = 0; n < out.size(); ++n) {
    const Corners& corners = corners_[out[n]];
    for (std::size_t i = 0; i < 4; ++i) {
      const Cell next = corners.neighbor[i];
      if (corners.vertex[i] == v || mark_[next] == epoch_) continue;
      mark_[next] = epoch_;
      out.push_back(next);
    }
  }
}

void Delaunay::neighbors_of(Vertex v, std::vector<Vertex>& out) const {
  cells_around(v, seen_);
  out.clear();
  for (const Cell c : seen_)
    for (const Vertex w : corners_[c].vertex)
      if (w != v && w != kInfinite) out.push_back(w);
  sort_and_unite(out);
}

bool Delaunay::build(std::span<const Point> points, const StopToken* stop) {
  const auto first = static_cast<Vertex>(points_.size());
  points_.insert(points_.end(), points.begin(), points.end());
  impl_->vertices.resize(points_.size());
  cell_of_.resize(points_.size(), kNone);
  Triangulation& triangulation = impl_->triangulation;
  const auto num_before = triangulation.number_of_vertices();
  if (num_before == 0) triangulation.tds().vertices().reserve(points.size() + 1);
  int dimension = triangulation.dimension();
  CellHandle nearby = triangulation.infinite_cell();
  StopPoll poll(stop);
  for (const std::uint32_t i : insertion_order(points.size())) {
    poll();
    const VertexHandle v = impl_->insert(cgal(points[i]), nearby);
    v->info().number = first + i;
    impl_->vertices[first + i] = v;
    nearby = v->cell();
    constexpr std::size_t kUsualCells = 7;  // a vertex
    if (std::exchange(dimension, triangulation.dimension()) < 3 && dimension == 3)
      triangulation.tds().cells().reserve(kUsualCells * points.size());
  }
  if (triangulation.number_of_vertices() != num_before + points.size()) return false;
  number_all();
  return true;
}

// By smallest vertex, and then as they are in CGAL's list, whose order depends on addresses after a
// removal.
void Delaunay::number_all() {
  corners_.clear();
  mark_.clear();
  free_.clear();
  new_cells_.clear();
  impl_->cells.clear();
  if (impl_->triangulation.dimension() < 3) return;
  const auto num_cells = impl_->triangulation.number_of_cells();
  std::vector<Impl::Fresh> fresh;
  fresh.reserve(num_cells);
  std::vector<Cell> next(points_.size() + 1, 0);  // number for a cell with this smallest vertex
  for (const CellHandle c : impl_->triangulation.all_cell_handles()) {
    fresh.emplace_back(c);
    ++next[fresh.back().sorted[0] + 1];
  }
  if (has_removed_) std::ranges::sort(fresh, {}, &Impl::Fresh::sorted);
  std::partial_sum(next.begin(), next.end(), next.begin());
  corners_.reserve(num_cells + num_cells / 4);
  corners_.resize(fresh.size());
  mark_.resize(fresh.size(), 0);
  impl_->cells.reserve(num_cells + num_cells / 4);
  impl_->cells.resize(fresh.size());
  for (const auto& [sorted, original, handle, is_odd] : fresh) {
    const Cell c = next[sorted[0]]++;
    handle->info().number = c;
    impl_->cells[c] = handle;
    set_corners(c, sorted, is_odd);
  }
  for (const Impl::Fresh& f : fresh) {
    const Cell c = f.handle->info().number;
    for (int i = 0; i < 4; ++i)
      corners_[c].neighbor[std::size_t(index_of(c, f.original[std::size_t(i)]))] =
          f.handle->neighbor(i)->info().number;
  }
  new_cells_.push_back(cell_bound() - 1);
}

void Delaunay::set_corners(Cell c, const std::array<Vertex, 4>& sorted, bool is_odd) {
  corners_[c].vertex = sorted;
  if (is_odd) std::swap(corners_[c].vertex[0], corners_[c].vertex[1]);
  for (const Vertex v : sorted)
    if (v != kInfinite) cell_of_[v] = c;
}

// Takes the cells in impl_->new_cells in, in an order that does not depend on their addresses.
void Delaunay::number_new() {
  std::vector<Impl::Fresh>& fresh = impl_->fresh;
  fresh.clear();
  for (const CellHandle c : impl_->new_cells) fresh.emplace_back(c);
  std::ranges::sort(fresh, {}, &Impl::Fresh::sorted);
  new_cells_.clear();
  for (const auto& [sorted, original, handle, is_odd] : fresh) {
    Cell c = cell_bound();
    if (free_.empty()) {
      corners_.emplace_back();
      mark_.push_back(0);
      impl_->cells.push_back(handle);
    } else {
      c = free_.back();
      free_.pop_back();
      impl_->cells[c] = handle;
    }
    handle->info().number = c;
    new_cells_.push_back(c);
    set_corners(c, sorted, is_odd);
  }
  for (std::size_t n = 0; n < fresh.size(); ++n) {
    const Cell c = new_cells_[n];
    for (int i = 0; i < 4; ++i) {
      const Vertex off = fresh[n].original[std::size_t(i)];
      const Cell other = fresh[n].handle->neighbor(i)->info().number;
      corners_[c].neighbor[std::size_t(index_of(c, off))] = other;
      // And of those around the new ones: opposite the vertex that is not on the facet.
      for (std::size_t k = 0; k < 4; ++k)
        if (std::ranges::find(fresh[n].sorted, corners_[other].vertex[k]) == fresh[n].sorted.end())
          corners_[other].neighbor[k] = c;
    }
  }
}

void Delaunay::free_cells(std::span<const Cell> cells) {
  const auto first = static_cast<std::ptrdiff_t>(free_.size());
  free_.insert(free_.end(), cells.begin(), cells.end());
  std::sort(free_.begin() + first, free_.end(), std::greater());
  for (const Cell c : cells) corners_[c].vertex.fill(kNone);
}

void Delaunay::find_conflict(const Point& q, Cell hint, Conflict& conflict) const {
  const auto p = cgal(q);
  conflict.cells.clear();
  conflict.border.clear();
  conflict.coincident = kNone;
  const auto [start, there] = impl_->start_for(p, impl_->cells[hint]);
  if (there != VertexHandle()) {
    conflict.coincident = there->info().number;
    return;
  }
  impl_->find_cavity(p, start);
  for (const CellHandle c : impl_->cavity.inside) conflict.cells.push_back(c->info().number);
  for (const auto& [outside, index] : impl_->cavity.border) {
    const Cell c = outside->info().number;
    conflict.border.push_back({c, index_of(c, outside->vertex(index)->info().number)});
  }
}

Delaunay::Vertex Delaunay::insert(const Point& q, const Conflict& conflict) {
  assert(!conflict.cells.empty());
  auto& [inside, border] = impl_->cavity;
  inside.clear();
  for (const Cell c : conflict.cells) inside.push_back(impl_->cells[c]);
  border.clear();
  for (const Facet& f : conflict.border) {
    const CellHandle outside = impl_->cells[f.cell];
    const Vertex off = vertex(f.cell, f.index);
    border.emplace_back(outside,
                        outside->index(off == kInfinite ? impl_->triangulation.infinite_vertex()
                                                        : impl_->vertices[off]));
  }
  const VertexHandle v = impl_->fill_cavity(cgal(q));
  const auto number = static_cast<Vertex>(points_.size());
  v->info().number = number;
  points_.push_back(q);
  cell_of_.push_back(kNone);
  impl_->vertices.push_back(v);
  free_cells(conflict.cells);
  number_new();
  return number;
}

bool Delaunay::is_in_conflict(Cell c, const Point& q) const {
  return impl_->is_in_conflict(impl_->cells[c], cgal(q));
}

bool Delaunay::is_in_circumball(const std::array<Point, 4>& cell, const Point& p) const {
  if (const auto is_inside = is_in_near_sphere(cell, p)) return *is_inside;
  const auto& [a, b, c, d] = cell;
  return impl_->triangulation.side_of_oriented_sphere(cgal(a), cgal(b), cgal(c), cgal(d), cgal(p),
                                                      true) == CGAL::ON_POSITIVE_SIDE;
}

// CGAL's cells are made anew, for the ones that go may be fewer.
void Delaunay::move(const Change& change) {
  auto& tds = impl_->triangulation.tds();
  const auto v = impl_->vertices[change.vertex];
  points_[change.vertex] = change.place;
  v->set_point(cgal(change.place));
  std::vector<CellHandle>& made = impl_->new_cells;
  made.clear();
  for (const NewCell& cell : change.made) {
    std::array<VertexHandle, 4> corner;
    for (std::size_t i = 0; i < 4; ++i) corner[i] = impl_->vertices[cell.vertex[i]];
    made.push_back(tds.create_cell(corner[0], corner[1], corner[2], corner[3]));
    made.back()->info().to_center = cell.way;
    for (const VertexHandle& w : corner) w->set_cell(made.back());
  }
  for (std::size_t n = 0; n < made.size(); ++n)
    for (int i = 0; i < 4; ++i) {
      const std::uint32_t beyond = change.made[n].neighbor[std::size_t(i)];
      if (beyond & kNewCell) {
        made[n]->set_neighbor(i, made[beyond & ~kNewCell]);
        continue;
      }
      const CellHandle other = impl_->cells[beyond];
      made[n]->set_neighbor(i, other);
      int off = 0;  // of the other cell's vertices, the one that is not on the facet
      while (std::ranges::find(change.made[n].vertex, vertex_number(other, off)) !=
             change.made[n].vertex.end())
        ++off;
      other->set_neighbor(off, made[n]);
    }
  for (const Cell c : change.gone) tds.delete_cell(impl_->cells[c]);
  has_removed_ = true;
  free_cells(change.gone);
  number_new();
}

bool Delaunay::remove(std::span<const Vertex> vertices) {
  has_removed_ = true;
  seen_.clear();
  std::vector<VertexHandle> leaving;
  for (const Vertex v : vertices) {
    cells_around(v, around_);
    seen_.insert(seen_.end(), around_.begin(), around_.end());
    leaving.push_back(std::exchange(impl_->vertices[v], {}));
    cell_of_[v] = kNone;
  }
  sort_and_unite(seen_);

  // The cells around these stay.
  ++epoch_;
  for (const Cell c : seen_) mark_[c] = epoch_;
  std::vector<CellHandle> rim;
  for (const Cell c : seen_)
    for (const Cell next : corners_[c].neighbor)
      if (std::exchange(mark_[next], epoch_) != epoch_) rim.push_back(impl_->cells[next]);

  Triangulation& triangulation = impl_->triangulation;
  if (leaving.size() > 1 && !rim.empty())
    triangulation.remove_cluster(leaving.begin(), leaving.end());
  else
    for (const VertexHandle v : leaving) triangulation.remove(v);
  if (triangulation.dimension() < 3 || rim.empty()) {
    for (auto& cell : triangulation.tds().cells()) cell.info() = {};  // changed, not new
    number_all();
    return false;
  }
  impl_->find_new_cells(rim);
  free_cells(seen_);
  number_new();
  return true;
}

}  // namespace locvol
