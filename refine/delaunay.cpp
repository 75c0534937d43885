#include "refine/delaunay.h"

#include <CGAL/Delaunay_triangulation_3.h>
#include <CGAL/Delaunay_triangulation_cell_base_3.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_cell_base_with_info_3.h>
#include <CGAL/Triangulation_vertex_base_with_info_3.h>

#include <algorithm>
#include <bit>
#include <boost/iterator/function_output_iterator.hpp>
#include <cassert>
#include <functional>
#include <numeric>
#include <utility>

#include "octree/mix.h"

namespace locvol {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using VertexBase = CGAL::Triangulation_vertex_base_with_info_3<Delaunay::Vertex, Kernel>;
using CellBase =
    CGAL::Triangulation_cell_base_with_info_3<Delaunay::Cell, Kernel,
                                              CGAL::Delaunay_triangulation_cell_base_3<Kernel>>;
using Triangulation =
    CGAL::Delaunay_triangulation_3<Kernel,
                                   CGAL::Triangulation_data_structure_3<VertexBase, CellBase>>;
using CellHandle = Triangulation::Cell_handle;
using VertexHandle = Triangulation::Vertex_handle;

Kernel::Point_3 cgal(const Point& p) { return {p.x, p.y, p.z}; }

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

Vertices vertices_of(CellHandle c) {
  return {c->vertex(0)->info(), c->vertex(1)->info(), c->vertex(2)->info(), c->vertex(3)->info()};
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
};

Delaunay::Delaunay() : impl_(std::make_unique<Impl>()) {
  impl_->triangulation.infinite_vertex()->info() = kInfinite;
}
Delaunay::~Delaunay() = default;

int Delaunay::index_of(Cell c, Vertex v) const {
  const auto& all = corners_[c].vertex;
  return v == all[0] ? 0 : v == all[1] ? 1 : v == all[2] ? 2 : 3;
}

int Delaunay::index_of_neighbor(Cell c, Cell neighbor) const {
  const auto& all = corners_[c].neighbor;
  return neighbor == all[0] ? 0 : neighbor == all[1] ? 1 : neighbor == all[2] ? 2 : 3;
}

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
  std::ranges::sort(out);
  const auto repeated = std::ranges::unique(out);
  out.erase(repeated.begin(), repeated.end());
}

bool Delaunay::build(std::span<const Point> points) {
  const auto first = static_cast<Vertex>(points_.size());
  points_.insert(points_.end(), points.begin(), points.end());
  impl_->vertices.resize(points_.size());
  cell_of_.resize(points_.size(), kNone);
  Triangulation& triangulation = impl_->triangulation;
  const auto num_before = triangulation.number_of_vertices();
  constexpr std::size_t kUsualCells = 7;  // a vertex
  if (num_before == 0) {
    triangulation.tds().vertices().reserve(points.size() + 1);
    triangulation.tds().cells().reserve(kUsualCells * points.size());
  }
  CellHandle nearby;
  for (const std::uint32_t i : insertion_order(points.size())) {
    const VertexHandle v = triangulation.insert(cgal(points[i]), nearby);
    v->info() = first + i;
    impl_->vertices[first + i] = v;
    nearby = v->cell();
  }
  if (triangulation.number_of_vertices() != num_before + points.size()) return false;
  number_all();
  return true;
}

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
  std::partial_sum(next.begin(), next.end(), next.begin());
  corners_.reserve(num_cells + num_cells / 4);
  corners_.resize(fresh.size());
  mark_.resize(fresh.size(), 0);
  impl_->cells.reserve(num_cells + num_cells / 4);
  impl_->cells.resize(fresh.size());
  for (const auto& [sorted, original, handle, is_odd] : fresh) {
    const Cell c = next[sorted[0]]++;
    handle->info() = c;
    impl_->cells[c] = handle;
    set_corners(c, sorted, is_odd);
  }
  for (const Impl::Fresh& f : fresh) {
    const Cell c = f.handle->info();
    for (int i = 0; i < 4; ++i)
      corners_[c].neighbor[std::size_t(index_of(c, f.original[std::size_t(i)]))] =
          f.handle->neighbor(i)->info();
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
    handle->info() = c;
    new_cells_.push_back(c);
    set_corners(c, sorted, is_odd);
  }
  for (std::size_t n = 0; n < fresh.size(); ++n) {
    const Cell c = new_cells_[n];
    for (int i = 0; i < 4; ++i) {
      const Vertex off = fresh[n].original[std::size_t(i)];
      const Cell other = fresh[n].handle->neighbor(i)->info();
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
  const Triangulation& triangulation = impl_->triangulation;
  const auto p = cgal(q);
  conflict.cells.clear();
  conflict.border.clear();
  conflict.coincident = kNone;
  CellHandle start = impl_->cells[hint];
  // Not perturbed, for p may be a vertex of the cell.
  if (triangulation.side_of_sphere(start, p) != CGAL::ON_BOUNDED_SIDE) {
    Triangulation::Locate_type type;
    int i = 0, j = 0;
    start = triangulation.locate(p, type, i, j, start);
    if (type == Triangulation::VERTEX) {
      conflict.coincident = start->vertex(i)->info();
      return;
    }
  }
  triangulation.find_conflicts(
      p, start, boost::make_function_output_iterator([&](const Triangulation::Facet& f) {
        const Cell c = f.first->info();
        conflict.border.push_back({c, index_of(c, f.first->vertex(f.second)->info())});
      }),
      boost::make_function_output_iterator(
          [&](CellHandle c) { conflict.cells.push_back(c->info()); }));
}

Delaunay::Vertex Delaunay::insert(const Point& q, const Conflict& conflict) {
  assert(!conflict.cells.empty());
  std::vector<CellHandle>& cells = impl_->new_cells;
  cells.clear();
  for (const Cell c : conflict.cells) cells.push_back(impl_->cells[c]);
  const auto [inside, index] = conflict.border.front();
  const CellHandle begin = impl_->cells[inside];
  const Vertex off = vertex(inside, index);
  const int i = begin->index(off == kInfinite ? impl_->triangulation.infinite_vertex()
                                              : impl_->vertices[off]);
  const VertexHandle v =
      impl_->triangulation.insert_in_hole(cgal(q), cells.begin(), cells.end(), begin, i);
  const auto number = static_cast<Vertex>(points_.size());
  v->info() = number;
  points_.push_back(q);
  cell_of_.push_back(kNone);
  impl_->vertices.push_back(v);
  cells.clear();
  impl_->triangulation.incident_cells(v, std::back_inserter(cells));
  free_cells(conflict.cells);
  number_new();
  return number;
}

bool Delaunay::remove(Vertex v) {
  cells_around(v, seen_);
  impl_->new_cells.clear();
  impl_->triangulation.remove_and_give_new_cells(impl_->vertices[v],
                                                 std::back_inserter(impl_->new_cells));
  cell_of_[v] = kNone;
  impl_->vertices[v] = VertexHandle();
  if (impl_->triangulation.dimension() < 3) {
    number_all();
    return false;
  }
  free_cells(seen_);
  number_new();
  return true;
}

}  // namespace locvol
