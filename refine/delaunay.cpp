#include "refine/delaunay.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>

#include <algorithm>
#include <bit>
#include <cassert>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "refine/exact_predicates.h"

namespace locvol {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Int128 = __int128;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kEpsilon = 0x1p-53;  // of one rounding

Kernel::Point_3 cgal(const Point& p) { return {p.x, p.y, p.z}; }

double max_abs(const Point& p) { return std::max({std::abs(p.x), std::abs(p.y), std::abs(p.z)}); }

// The other two corners of a cell, such that (i, k, a, b) is an even permutation: around a hole,
// the edge from a to b of one facet of its border is the edge from b to a of the next.
constexpr std::array<std::array<std::array<int, 2>, 4>, 4> kEdge = [] {
  std::array<std::array<std::array<int, 2>, 4>, 4> edge{};
  for (int i = 0; i < 4; ++i)
    for (int k = 0; k < 4; ++k) {
      if (i == k) continue;
      int a = 0;
      while (a == i || a == k) ++a;
      int b = 6 - i - k - a;
      const int order[4] = {i, k, a, b};
      int inversions = 0;
      for (int m = 0; m < 4; ++m)
        for (int n = m + 1; n < 4; ++n) inversions += order[m] > order[n];
      if (inversions % 2 == 1) std::swap(a, b);
      edge[std::size_t(i)][std::size_t(k)] = {a, b};
    }
  return edge;
}();

// ---- The order of insertion: along a Hilbert curve, a random eighth of the points first, and of
// these an eighth before (Amenta, Choi, Rote, "Incremental constructions con BRIO", 2003).

constexpr int kHilbertBits = 10;

// Skilling, "Programming the Hilbert curve", 2004.
std::uint32_t hilbert_key(std::array<std::uint32_t, 3> x) {
  constexpr std::uint32_t kTop = 1u << (kHilbertBits - 1);
  for (std::uint32_t q = kTop; q > 1; q >>= 1) {
    const std::uint32_t p = q - 1;
    for (std::size_t i = 0; i < 3; ++i) {
      if (x[i] & q) {
        x[0] ^= p;
      } else {
        const std::uint32_t t = (x[0] ^ x[i]) & p;
        x[0] ^= t;
        x[i] ^= t;
      }
    }
  }
  x[1] ^= x[0];
  x[2] ^= x[1];
  std::uint32_t t = 0;
  for (std::uint32_t q = kTop; q > 1; q >>= 1)
    if (x[2] & q) t ^= q - 1;
  for (auto& v : x) v ^= t;
  std::uint32_t key = 0;
  for (int bit = kHilbertBits - 1; bit >= 0; --bit)
    for (std::size_t i = 0; i < 3; ++i) key = key << 1 | (x[i] >> bit & 1);
  return key;
}

std::uint32_t scrambled(std::uint32_t x) {
  x ^= x >> 16;
  x *= 0x7feb352d;
  x ^= x >> 15;
  x *= 0x846ca68b;
  return x ^ x >> 16;
}

std::vector<std::uint32_t> insertion_order(const std::vector<Point>& points,
                                           const std::vector<std::uint32_t>& alive) {
  Box box = Box::around(points[alive.front()]);
  for (const std::uint32_t v : alive) box = box.joined(points[v]);
  const Point d = box.max - box.min;
  constexpr double kCells = 1 << kHilbertBits;
  const double scale = (kCells - 1) / std::max({d.x, d.y, d.z, 1e-300});
  std::vector<std::pair<std::uint64_t, std::uint32_t>> keyed;
  keyed.reserve(alive.size());
  const int last_round = std::max(0, (int(std::bit_width(alive.size())) - 6) / 3);
  for (const std::uint32_t v : alive) {
    const Point p = scale * (points[v] - box.min);
    const std::uint64_t key =
        hilbert_key({std::uint32_t(p.x), std::uint32_t(p.y), std::uint32_t(p.z)});
    const int back = std::min(last_round, std::countl_zero(scrambled(v) | 1) / 3);
    keyed.emplace_back(std::uint64_t(last_round - back) << 32 | key, v);
  }
  std::ranges::sort(keyed);
  std::vector<std::uint32_t> order;
  order.reserve(keyed.size());
  for (const auto& [key, v] : keyed) order.push_back(v);
  return order;
}

}  // namespace

// ---- Signs --------------------------------------------------------------------------------------

// The differences of coordinates in steps of the grid: false unless they are few whole steps.
bool Delaunay::in_steps(const Point& from, const Point& to, Steps& steps) const {
  constexpr double kMaxSteps = 1 << 24;
  for (int axis = 0; axis < 3; ++axis) {
    const double a = from[axis], b = to[axis], d = b - a;
    const double part = d - b, rest = (b - (d - part)) - (a + part);  // of the rounding of d
    const double n = d * inverse_step_;
    if (rest != 0 || !(std::abs(n) <= kMaxSteps) || n != std::nearbyint(n)) return false;
    steps[std::size_t(axis)] = static_cast<std::int64_t>(n);
  }
  return true;
}

namespace {

using Steps = std::array<std::int64_t, 3>;

// With coordinates of at most 2^24, a cross product is at most 2^49, and a sphere's sign is that of
// a sum below 2^127.
Steps cross_of(const Steps& a, const Steps& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
Int128 dot_of(const Steps& a, const Steps& b) {
  return Int128(a[0]) * b[0] + Int128(a[1]) * b[1] + Int128(a[2]) * b[2];
}
int sign_of(Int128 v) { return v > 0 ? 1 : v < 0 ? -1 : 0; }

}  // namespace

int Delaunay::exact_orientation(const Point& a, const Point& b, const Point& c,
                                const Point& d) const {
  Steps u, v, w;
  if (inverse_step_ > 0 && in_steps(a, b, u) && in_steps(a, c, v) && in_steps(a, d, w))
    return sign_of(dot_of(cross_of(u, v), w));
  return CGAL::orientation(cgal(a), cgal(b), cgal(c), cgal(d));
}

int Delaunay::exact_side_of_sphere(const Point& a, const Point& b, const Point& c, const Point& d,
                                   const Point& q) const {
  Steps u, v, w, t;
  if (inverse_step_ > 0 && in_steps(a, b, u) && in_steps(a, c, v) && in_steps(a, d, w) &&
      in_steps(a, q, t)) {
    const Steps vw = cross_of(v, w), wu = cross_of(w, u), uv = cross_of(u, v);
    const Int128 uu = dot_of(u, u), vv = dot_of(v, v), ww = dot_of(w, w);
    Int128 sum = -dot_of(u, vw) * dot_of(t, t);
    for (std::size_t i = 0; i < 3; ++i) sum += (uu * vw[i] + vv * wu[i] + ww * uv[i]) * t[i];
    return sign_of(sum);
  }
  return CGAL::side_of_oriented_sphere(cgal(a), cgal(b), cgal(c), cgal(d), cgal(q));
}

// The determinant of the differences; a product of two is off by at most 4 roundings, so in all it
// is off by at most 8 · 3 + 3 · 2 + 4 of them, times the differences' bounds.
int Delaunay::orientation(const Point& a, const Point& b, const Point& c, const Point& d) const {
  const Point u = b - a, v = c - a, w = d - a;
  const double determinant = dot(cross(u, v), w);
  const double extent = max_abs(u) * max_abs(v) * max_abs(w);
  const double error = 56 * kEpsilon * extent;
  if (extent > 1e-120 && extent < 1e120) {
    if (determinant > error) return 1;
    if (determinant < -error) return -1;
  }
  return exact_orientation(a, b, c, d);
}

// inside: t·N - t² d > 0, where N = u² (v x w) + v² (w x u) + w² (u x v) and d = u·(v x w) > 0.
// With M the largest coordinate of u, v, w and T that of t, N is off by at most 216 M⁴ roundings
// and d by 48 M³; the whole by T M³ (918 M + 270 T).
void Delaunay::set_sphere(Cell c) {
  constexpr double kLeast = 1e-40, kMost = 1e40;  // beyond, products may underflow or overflow
  const auto& v = corners_[c].vertex;
  Sphere& s = spheres_[c];
  s.origin = points_[v[0]];
  const Point a = points_[v[1]] - s.origin, b = points_[v[2]] - s.origin;
  double extent = std::max(max_abs(a), max_abs(b));
  if (v[3] == kInfinite) {
    s.normal = cross(a, b);
    s.depth = 0;
  } else {
    const Point d = points_[v[3]] - s.origin;
    extent = std::max(extent, max_abs(d));
    const Point bd = cross(b, d);
    s.normal = dot(a, a) * bd + dot(b, b) * cross(d, a) + dot(d, d) * cross(a, b);
    s.depth = dot(a, bd);
  }
  s.extent = extent > kLeast && extent < kMost ? extent : kInfinity;
}

bool Delaunay::is_in_conflict(Cell c, const Point& q) const {
  const Sphere& s = spheres_[c];
  const Point t = q - s.origin;
  const double value = dot(t, s.normal) - dot(t, t) * s.depth;
  const double near = max_abs(t), m = s.extent;
  const double error = is_infinite(c) ? 56 * kEpsilon * (near * m * m)
                                      : 320 * kEpsilon * (near * m * m * m) * (near + 3.2 * m);
  if (value > error) return true;
  if (value < -error) return false;
  return is_in_conflict_exactly(c, q);
}

// Where q is on the sphere, the last of the five points in lexicographic order is moved most, and
// each less than the one behind it.
bool Delaunay::is_in_conflict_exactly(Cell c, const Point& q) const {
  const auto& vertices = corners_[c].vertex;
  std::array<const Point*, 4> p{};
  for (std::size_t i = 0; i < 4; ++i)
    p[i] = vertices[i] == kInfinite ? nullptr : &points_[vertices[i]];
  if (p[3] == nullptr) {
    const int side = exact_orientation(*p[0], *p[1], *p[2], q);
    // In the facet's plane: inside its circle, as moved, is inside the sphere of the cell below.
    return side != 0 ? side > 0 : is_in_conflict(corners_[c].neighbor[3], q);
  }
  const int side = exact_side_of_sphere(*p[0], *p[1], *p[2], *p[3], q);
  if (side != 0) return side > 0;
  for (std::size_t i = 0; i < 4; ++i)
    if (*p[i] == q) {
      coincident_ = vertices[i];
      return false;
    }
  std::array<const Point*, 5> order{p[0], p[1], p[2], p[3], &q};
  std::ranges::sort(order, [](const Point* a, const Point* b) { return *a < *b; });
  for (std::size_t i = 5; i-- > 3;) {
    if (order[i] == &q) return false;
    auto moved = p;
    *std::ranges::find(moved, order[i]) = &q;
    const int sign = exact_orientation(*moved[0], *moved[1], *moved[2], *moved[3]);
    if (sign != 0) return sign > 0;
  }
  return false;
}

// ---- Queries ------------------------------------------------------------------------------------

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

// Walks towards q from cell to cell until one is in conflict: through a facet with q beyond it,
// which in a Delaunay triangulation ends. kNone if q coincides with a vertex.
Delaunay::Cell Delaunay::cell_in_conflict(const Point& q, Cell hint) const {
  Cell here = hint, before = kNone;
  for (;;) {
    if (is_in_conflict(here, q)) return here;
    if (coincident_ != kNone) return kNone;
    const Corners& corners = corners_[here];
    Cell next = kNone;
    if (corners.vertex[3] == kInfinite) {
      next = corners.neighbor[3];
    } else {
      for (std::size_t i = 0; i < 4 && next == kNone; ++i) {
        if (corners.neighbor[i] == before) continue;
        std::array<const Point*, 4> p{};
        for (std::size_t k = 0; k < 4; ++k) p[k] = k == i ? &q : &points_[corners.vertex[k]];
        if (orientation(*p[0], *p[1], *p[2], *p[3]) < 0) next = corners.neighbor[i];
      }
    }
    if (next == kNone) throw std::logic_error("Delaunay: a point in no circumsphere of its cell");
    before = std::exchange(here, next);
  }
}

void Delaunay::find_conflict(const Point& q, Cell hint, Conflict& conflict) const {
  auto& [cells, border, coincident] = conflict;
  cells.clear();
  border.clear();
  coincident_ = kNone;
  const Cell start = cell_in_conflict(q, hint);
  coincident = coincident_;
  if (start == kNone) return;
  epoch_ += 2;
  const std::uint32_t in = epoch_, out = epoch_ - 1;
  mark_[start] = in;
  cells.push_back(start);
  for (std::size_t n = 0; n < cells.size(); ++n) {
    const Cell here = cells[n];
    for (int i = 0; i < 4; ++i) {
      const Cell next = neighbor(here, i);
      if (mark_[next] < out) {
        mark_[next] = is_in_conflict(next, q) ? in : out;
        if (mark_[next] == in) cells.push_back(next);
      }
      if (mark_[next] == out) border.push_back({here, i});
    }
  }
  coincident = coincident_;
}

// ---- Cells --------------------------------------------------------------------------------------

Delaunay::Cell Delaunay::new_cell() {
  if (!free_.empty()) {
    const Cell c = free_.back();
    free_.pop_back();
    return c;
  }
  corners_.emplace_back();
  spheres_.emplace_back();
  mark_.push_back(0);
  return static_cast<Cell>(corners_.size() - 1);
}

void Delaunay::free_cell(Cell c) {
  corners_[c].vertex.fill(kNone);
  free_.push_back(c);
}

bool Delaunay::build(std::span<const Point> points) {
  points_.insert(points_.end(), points.begin(), points.end());
  cell_of_.resize(points_.size(), 0);
  number_.resize(points_.size(), 0);
  return build_cells();
}

// Vertices that were removed have no cell, and get none.
bool Delaunay::build_cells() {
  corners_.clear();
  spheres_.clear();
  mark_.clear();
  free_.clear();
  new_cells_.clear();
  std::vector<Vertex> alive;
  for (Vertex v = 0; v < points_.size(); ++v)
    if (cell_of_[v] != kNone) alive.push_back(v);
  if (alive.size() < 2) return true;
  const std::vector<Vertex> order = insertion_order(points_, alive);

  std::array<Vertex, 4> simplex{order[0], kNone, kNone, kNone};
  std::size_t found = 1;
  for (std::size_t n = 1; n < order.size() && found < 4; ++n) {
    const auto p = [&](std::size_t i) { return points_[simplex[i]]; };
    const Point& q = points_[order[n]];
    if (found == 1 && q == p(0)) return false;
    if (found == 2 && are_collinear(p(0), p(1), q)) continue;
    if (found == 3 && orientation(p(0), p(1), p(2), q) == 0) continue;
    simplex[found++] = order[n];
  }
  if (found < 4) {  // flat: coincident points would go unnoticed
    std::vector<Point> sorted;
    for (const Vertex v : alive) sorted.push_back(points_[v]);
    std::ranges::sort(sorted);
    return std::ranges::adjacent_find(sorted) == sorted.end();
  }
  corners_.reserve(8 * alive.size());
  spheres_.reserve(8 * alive.size());
  mark_.reserve(8 * alive.size());
  make_first_cells(simplex);
  Cell hint = 0;
  for (const Vertex v : order) {
    if (std::ranges::find(simplex, v) != simplex.end()) continue;
    find_conflict(points_[v], hint, conflict_);
    if (conflict_.coincident != kNone) return false;
    fill_hole(v, conflict_);
    hint = new_cells_.back();
  }
  return true;
}

// One cell inside, and one beyond each of its facets.
void Delaunay::make_first_cells(const std::array<Vertex, 4>& simplex) {
  auto [a, b, c, d] = simplex;
  if (orientation(points_[a], points_[b], points_[c], points_[d]) < 0) std::swap(a, b);
  const std::array<std::array<Vertex, 4>, 5> cells{{{a, b, c, d},
                                                    {b, c, d, kInfinite},
                                                    {a, d, c, kInfinite},
                                                    {a, b, d, kInfinite},
                                                    {b, a, c, kInfinite}}};
  for (std::size_t n = 0; n < 5; ++n) {
    new_cells_.push_back(new_cell());
    corners_[n].vertex = cells[n];
  }
  for (Cell n = 0; n < 5; ++n)
    for (std::size_t i = 0; i < 4; ++i) {
      const auto has = [&](Cell m, Vertex v) {
        return std::ranges::find(corners_[m].vertex, v) != corners_[m].vertex.end();
      };
      for (Cell m = 0; m < 5; ++m) {
        if (m == n) continue;
        bool is_shared = true;
        for (std::size_t k = 0; k < 4; ++k)
          if (k != i) is_shared &= has(m, corners_[n].vertex[k]);
        if (is_shared) corners_[n].neighbor[i] = m;
      }
    }
  for (Cell n = 0; n < 5; ++n) {
    set_sphere(n);
    for (const Vertex v : corners_[n].vertex)
      if (v != kInfinite) cell_of_[v] = n;
  }
}

Delaunay::Vertex Delaunay::insert(const Point& q, const Conflict& conflict) {
  assert(!conflict.cells.empty());
  const auto v = static_cast<Vertex>(points_.size());
  points_.push_back(q);
  cell_of_.push_back(kNone);
  number_.push_back(0);
  fill_hole(v, conflict);
  return v;
}

// A new cell between v and each facet of the border.
void Delaunay::fill_hole(Vertex v, const Conflict& conflict) {
  new_cells_.clear();
  edges_.clear();
  first_number_ = next_number_ = next_number_ + 1;
  infinite_number_ = 0;
  const auto number = [&](Vertex w) {
    std::uint32_t& n = w == kInfinite ? infinite_number_ : number_[w];
    if (n < first_number_) n = next_number_++;
    return n - first_number_;
  };
  for (const auto [inside, i] : conflict.border) {
    const Cell c = new_cell();
    new_cells_.push_back(c);
    Corners& corners = corners_[c];
    corners.vertex = corners_[inside].vertex;
    corners.vertex[std::size_t(i)] = v;
    const Cell outside = corners_[inside].neighbor[std::size_t(i)];
    corners.neighbor[std::size_t(i)] = outside;
    corners_[outside].neighbor[std::size_t(index_of_neighbor(outside, inside))] = c;
    set_sphere(c);
    std::array<std::uint32_t, 4> numbers{};
    for (std::size_t k = 0; k < 4; ++k) {
      if (int(k) == i) continue;
      numbers[k] = number(corners.vertex[k]);
      if (corners.vertex[k] != kInfinite) cell_of_[corners.vertex[k]] = c;
    }
    for (std::size_t k = 0; k < 4; ++k) {
      if (int(k) == i) continue;
      const auto [a, b] = kEdge[std::size_t(i)][k];
      edges_.push_back({numbers[std::size_t(a)], numbers[std::size_t(b)], {c, int(k)}});
    }
  }
  cell_of_[v] = new_cells_.front();
  for (const Cell c : conflict.cells) free_cell(c);
  if (next_number_ - first_number_ <= 256)
    link_with_table();
  else
    link_sorted();
}

// Each edge of the border is there twice, once in each direction.
void Delaunay::link_with_table() {
  const std::size_t stride = std::bit_ceil(std::size_t(next_number_ - first_number_));
  if (table_.size() < stride * stride) table_.resize(stride * stride);
  for (const Edge& e : edges_) table_[e.from * stride + e.to] = e.facet;
  for (const Edge& e : edges_)
    corners_[e.facet.cell].neighbor[std::size_t(e.facet.index)] =
        table_[e.to * stride + e.from].cell;
}

void Delaunay::link_sorted() {
  const auto ends = [](const Edge& e) {
    return std::pair(std::min(e.from, e.to), std::max(e.from, e.to));
  };
  std::ranges::sort(edges_, {}, ends);
  for (std::size_t n = 0; n + 1 < edges_.size(); n += 2) {
    const Facet &a = edges_[n].facet, &b = edges_[n + 1].facet;
    corners_[a.cell].neighbor[std::size_t(a.index)] = b.cell;
    corners_[b.cell].neighbor[std::size_t(b.index)] = a.cell;
  }
}

// ---- Removal ------------------------------------------------------------------------------------

bool Delaunay::remove(Vertex v) {
  if (fill_hole_left_by(v)) return true;
  cell_of_[v] = kNone;
  build_cells();
  return false;
}

namespace {

// Do the positive orders a and b of four vertices agree, where `v` in a stands for the vertex of b
// that is not in a?
bool is_even(const std::array<std::uint32_t, 4>& a, const std::array<std::uint32_t, 4>& b,
             std::uint32_t v) {
  std::array<std::size_t, 4> place{};
  for (std::size_t i = 0; i < 4; ++i) {
    auto found = std::ranges::find(a, b[i]);
    if (found == a.end()) found = std::ranges::find(a, v);
    place[i] = std::size_t(found - a.begin());
  }
  int inversions = 0;
  for (std::size_t m = 0; m < 4; ++m)
    for (std::size_t n = m + 1; n < 4; ++n) inversions += place[m] > place[n];
  return inversions % 2 == 0;
}

}  // namespace

// The hole's cells are also cells of the triangulation of v's neighbors alone: they start at the
// hole's border, and go on until they fill it. False, and nothing is done, if the neighbors lie in
// a plane.
bool Delaunay::fill_hole_left_by(Vertex v) {
  std::vector<Cell> hole;
  cells_around(v, hole);
  std::vector<Vertex> link;
  neighbors_of(v, link);
  std::vector<Point> link_points;
  for (const Vertex w : link) link_points.push_back(points_[w]);
  Delaunay around(1 / inverse_step_);
  if (inverse_step_ == 0) around.inverse_step_ = 0;
  if (!around.build(link_points) || !around.has_cells()) return false;

  const auto global = [&](Vertex w) { return w == kInfinite ? kInfinite : link[w]; };
  const auto global_vertices = [&](Cell c) {
    std::array<Vertex, 4> all{};
    for (std::size_t i = 0; i < 4; ++i) all[i] = global(around.corners_[c].vertex[i]);
    return all;
  };
  using Triple = std::array<Vertex, 3>;
  const auto triple = [](const std::array<Vertex, 4>& all, std::size_t i) {
    Triple t{};
    for (std::size_t k = 0, n = 0; k < 4; ++k)
      if (k != i) t[n++] = all[k];
    std::ranges::sort(t);
    return t;
  };
  std::vector<std::pair<Triple, Facet>> facets;  // of the neighbors' triangulation
  for (Cell c = 0; c < around.cell_bound(); ++c) {
    if (!around.is_cell(c)) continue;
    const auto all = global_vertices(c);
    for (std::size_t i = 0; i < 4; ++i) facets.emplace_back(triple(all, i), Facet{c, int(i)});
  }
  const auto triple_of = [](const auto& facet) { return facet.first; };
  std::ranges::sort(facets, {}, triple_of);

  // The border: the cell of `around` behind each of its facets, and the facet before it.
  std::vector<std::pair<Facet, Facet>> border;
  for (const Cell c : hole) {
    const auto all = corners_[c].vertex;
    const int i = index_of(c, v);
    bool is_found = false;
    for (const auto& [t, f] :
         std::ranges::equal_range(facets, triple(all, std::size_t(i)), {}, triple_of)) {
      if (!is_even(all, global_vertices(f.cell), v)) continue;
      const Cell outside = neighbor(c, i);
      border.push_back({f, {outside, index_of_neighbor(outside, c)}});
      is_found = true;
    }
    if (!is_found) return false;
  }
  std::vector<Cell> made(around.cell_bound(), kNone);  // by cell of `around`
  std::vector<std::uint8_t> is_border(around.cell_bound(), 0);
  std::vector<Cell> inner;
  for (const auto& [f, outside] : border) {
    is_border[f.cell] = static_cast<std::uint8_t>(is_border[f.cell] | 1u << f.index);
    if (made[f.cell] == kNone) {
      made[f.cell] = 0;
      inner.push_back(f.cell);
    }
  }
  for (std::size_t n = 0; n < inner.size(); ++n)
    for (int i = 0; i < 4; ++i) {
      const Cell next = around.neighbor(inner[n], i);
      if ((is_border[inner[n]] >> i & 1) != 0 || made[next] != kNone) continue;
      made[next] = 0;
      inner.push_back(next);
    }

  new_cells_.clear();
  for (const Cell a : inner) {
    made[a] = new_cell();
    new_cells_.push_back(made[a]);
    corners_[made[a]].vertex = global_vertices(a);
  }
  for (const Cell a : inner)
    for (int i = 0; i < 4; ++i)
      if ((is_border[a] >> i & 1) == 0)
        corners_[made[a]].neighbor[std::size_t(i)] = made[around.neighbor(a, i)];
  for (const auto& [f, outside] : border) {
    corners_[made[f.cell]].neighbor[std::size_t(f.index)] = outside.cell;
    corners_[outside.cell].neighbor[std::size_t(outside.index)] = made[f.cell];
  }
  for (const Cell c : new_cells_) {
    set_sphere(c);
    for (const Vertex w : corners_[c].vertex)
      if (w != kInfinite) cell_of_[w] = c;
  }
  cell_of_[v] = kNone;
  for (const Cell c : hole) free_cell(c);
  return true;
}

}  // namespace locvol
