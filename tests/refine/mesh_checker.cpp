#include "tests/refine/mesh_checker.h"

#include <CGAL/Delaunay_triangulation_3.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_cell_base_with_info_3.h>
#include <CGAL/Triangulation_vertex_base_with_info_3.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <optional>
#include <set>
#include <utility>

#include "refine/cell_shape.h"
#include "tests/refine/brute_force.h"

namespace locvol {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;

struct CellFacts {
  Point center;
  double radius = 0;
  bool is_inside = false;
};

using Tds = CGAL::Triangulation_data_structure_3<
    CGAL::Triangulation_vertex_base_with_info_3<std::size_t, Kernel>,
    CGAL::Triangulation_cell_base_with_info_3<CellFacts, Kernel,
                                              CGAL::Delaunay_triangulation_cell_base_3<Kernel>>>;
using Triangulation = CGAL::Delaunay_triangulation_3<Kernel, Tds>;
using Cell = Triangulation::Cell_handle;
using Vertex = Triangulation::Vertex_handle;

// Edges of a closed polygon or of several, each with both its directions.
template <class Index>
using Link = std::multimap<Index, Index>;

template <class Index>
void add_edge(Link<Index>& link, Index a, Index b) {
  link.emplace(a, b);
  link.emplace(b, a);
}

// One cycle: two edges at every vertex, and all of them are met on the way around.
template <class Index>
bool is_one_cycle(const Link<Index>& link) {
  for (const auto& [vertex, other] : link)
    if (link.count(vertex) != 2) return false;
  std::set<Index> seen{link.begin()->first};
  std::vector<Index> open{link.begin()->first};
  while (!open.empty()) {
    const Index here = open.back();
    open.pop_back();
    const auto [begin, end] = link.equal_range(here);
    for (auto i = begin; i != end; ++i)
      if (seen.insert(i->second).second) open.push_back(i->second);
  }
  return 2 * seen.size() == link.size();
}

using IndexedFacet = std::array<std::size_t, 3>;  // ascending

std::map<IndexedFacet, int> cells_per_facet(const std::vector<IndexedCell>& cells) {
  std::map<IndexedFacet, int> count;
  for (const IndexedCell& cell : cells)
    for (std::size_t i = 0; i < 4; ++i) {
      IndexedFacet facet{cell[(i + 1) % 4], cell[(i + 2) % 4], cell[(i + 3) % 4]};
      std::ranges::sort(facet);
      ++count[facet];
    }
  return count;
}

}  // namespace

CellKey key_of(CellKey vertices) {
  std::ranges::sort(vertices);
  return vertices;
}

struct MeshChecker::Impl {
  std::vector<MeshPoint> points;
  shapes::Mesh surface;
  double limit = 0;  // from a point of the domain, what is farther away is outside
  Triangulation triangulation;

  Point position(Vertex v) const { return points[v->info()].position; }
  std::optional<Point> finite_position(Vertex v) const {
    if (triangulation.is_infinite(v)) return std::nullopt;
    return position(v);
  }
  bool is_inside(Cell c) const { return !triangulation.is_infinite(c) && c->info().is_inside; }
  bool is_near(Cell c) const { return !triangulation.is_infinite(c) && c->info().radius < limit; }
  void measure(Cell c) const;
  std::array<Vertex, 3> vertices_of(Cell c, int i) const {
    return {c->vertex((i + 1) & 3), c->vertex((i + 2) & 3), c->vertex((i + 3) & 3)};
  }
  // The points where the facet's dual edge crosses the surface.
  std::vector<Point> ball_centers(Cell c, int i) const;
  void check_cell(Cell c, double size, double ratio, std::vector<BrokenCondition>& broken) const;
  void check_facet(Cell c, int i, const std::vector<Point>& centers, double size,
                   std::vector<BrokenCondition>& broken) const;
};

void MeshChecker::Impl::measure(Cell c) const {
  const auto ball = brute_force::circumball({position(c->vertex(0)), position(c->vertex(1)),
                                             position(c->vertex(2)), position(c->vertex(3))});
  CellFacts& facts = c->info();
  facts.radius = ball ? ball->radius : std::numeric_limits<double>::infinity();
  if (!ball) return;
  facts.center = ball->center;
  facts.is_inside = facts.radius < limit && brute_force::is_inside(facts.center, surface);
}

std::vector<Point> MeshChecker::Impl::ball_centers(Cell c, int i) const {
  const Cell other = c->neighbor(i);
  std::array<Point, 2> edge{c->info().center, other->info().center};
  if (!is_near(c) || !is_near(other)) {
    const auto v = vertices_of(c, i);
    const std::array facet{position(v[0]), position(v[1]), position(v[2])};
    if (brute_force::circumball(facet)->radius > limit) return {};
    const auto cut = brute_force::dual_edge(facet, finite_position(c->vertex(i)),
                                            finite_position(other->vertex(other->index(c))), limit);
    if (!cut) return {};
    edge = *cut;
  }
  std::vector<Point> centers;
  for (const auto id : brute_force::crossings(edge[0], edge[1], surface)) {
    const auto& [a, b, d] = surface[id].corners;
    const Point n = cross(b - a, d - a);
    const double from = dot(edge[0] - a, n), to = dot(edge[1] - a, n);
    const double t = from == to ? 0.5 : from / (from - to);
    centers.push_back(edge[0] + t * (edge[1] - edge[0]));
  }
  return centers;
}

void MeshChecker::Impl::check_cell(Cell c, double size, double ratio,
                                   std::vector<BrokenCondition>& broken) const {
  const auto& [center, radius, is_member] = c->info();
  if (!is_member) return;
  if (radius >= size) broken.push_back({5, center, radius});
  double shortest = std::numeric_limits<double>::infinity();
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < i; ++j)
      shortest = std::min(shortest, norm(position(c->vertex(i)) - position(c->vertex(j))));
  if (radius > ratio * shortest * (1 + 1e-12)) broken.push_back({6, center, radius});
}

void MeshChecker::Impl::check_facet(Cell c, int i, const std::vector<Point>& centers, double size,
                                    std::vector<BrokenCondition>& broken) const {
  if (centers.empty()) return;
  const auto vertices = vertices_of(c, i);
  const auto radius = [&](const Point& center) { return norm(center - position(vertices[0])); };
  const Point center = *std::ranges::max_element(centers, {}, radius);
  const double largest = radius(center);
  if (largest >= size) broken.push_back({1, center, largest});
  if (std::ranges::any_of(vertices,
                          [&](Vertex v) { return points[v->info()].kind != PointKind::kSurface; }))
    broken.push_back({2, center, largest});
  if (centers.size() > 1) broken.push_back({4, center, largest});
}

MeshChecker::MeshChecker(const std::vector<MeshPoint>& points, const shapes::Mesh& surface)
    : impl_(std::make_unique<Impl>()) {
  impl_->points = points;
  impl_->surface = surface;
  const Box box = shapes::bounding_box(surface);
  impl_->limit = 3 * norm(box.max - box.min);
  std::vector<std::pair<Kernel::Point_3, std::size_t>> sites;
  for (const MeshPoint& p : points)
    sites.emplace_back(Kernel::Point_3(p.position.x, p.position.y, p.position.z), sites.size());
  impl_->triangulation.insert(sites.begin(), sites.end());
  for (const Cell c : impl_->triangulation.finite_cell_handles()) impl_->measure(c);
}

MeshChecker::~MeshChecker() = default;

std::vector<CellKey> MeshChecker::inside_cells() const {
  std::vector<CellKey> cells;
  for (const Cell c : impl_->triangulation.finite_cell_handles())
    if (impl_->is_inside(c))
      cells.push_back(key_of({impl_->position(c->vertex(0)), impl_->position(c->vertex(1)),
                              impl_->position(c->vertex(2)), impl_->position(c->vertex(3))}));
  std::ranges::sort(cells);
  return cells;
}

std::vector<BrokenCondition> MeshChecker::broken_conditions(double size,
                                                            double radius_edge_bound) const {
  std::vector<BrokenCondition> broken;
  std::map<std::size_t, Link<std::size_t>> stars;
  for (const Cell c : impl_->triangulation.finite_cell_handles())
    impl_->check_cell(c, size, radius_edge_bound, broken);
  for (const auto& [c, i] : impl_->triangulation.finite_facets()) {
    const std::vector<Point> centers = impl_->ball_centers(c, i);
    impl_->check_facet(c, i, centers, size, broken);
    if (centers.empty()) continue;
    const auto v = impl_->vertices_of(c, i);
    for (std::size_t k = 0; k < 3; ++k)
      add_edge(stars[v[k]->info()], v[(k + 1) % 3]->info(), v[(k + 2) % 3]->info());
  }
  for (const auto& [vertex, link] : stars) {
    const MeshPoint& p = impl_->points[vertex];
    if (p.kind == PointKind::kSurface && !is_one_cycle(link)) broken.push_back({3, p.position, 0});
  }
  return broken;
}

std::string manifold_fault(const std::vector<IndexedCell>& cells,
                           const std::vector<MeshPoint>& points) {
  std::map<std::size_t, Link<std::size_t>> links;
  std::map<std::array<std::size_t, 2>, int> facets_per_edge;
  for (const auto& [facet, count] : cells_per_facet(cells)) {
    if (count > 2) return "a facet in more than two cells";
    if (count == 2) continue;
    const auto& [a, b, c] = facet;
    for (const auto& edge : {std::array{a, b}, {a, c}, {b, c}}) ++facets_per_edge[edge];
    add_edge(links[a], b, c);
    add_edge(links[b], a, c);
    add_edge(links[c], a, b);
  }
  for (const auto& [edge, count] : facets_per_edge)
    if (count != 2) return "a boundary edge in other than two boundary facets";
  for (const auto& [vertex, link] : links) {
    if (!is_one_cycle(link)) return "a boundary vertex whose link is not one cycle";
    if (points[vertex].kind != PointKind::kSurface) return "a boundary vertex off the surface";
  }
  return "";
}

long boundary_euler_characteristic(const std::vector<IndexedCell>& cells) {
  std::set<std::size_t> vertices;
  std::set<std::array<std::size_t, 2>> edges;
  long num_facets = 0;
  for (const auto& [facet, count] : cells_per_facet(cells)) {
    if (count != 1) continue;
    ++num_facets;
    const auto& [a, b, c] = facet;
    vertices.insert({a, b, c});
    edges.insert({{a, b}, {a, c}, {b, c}});
  }
  return static_cast<long>(vertices.size()) - static_cast<long>(edges.size()) + num_facets;
}

double smallest_boundary_angle(const std::vector<IndexedCell>& cells,
                               const std::vector<MeshPoint>& points) {
  double cosine = -1;
  for (const auto& [facet, count] : cells_per_facet(cells)) {
    if (count != 1) continue;
    const auto& [a, b, c] = facet;
    cosine = std::max(cosine, largest_cosine(std::array{points[a].position, points[b].position,
                                                        points[c].position}));
  }
  return std::acos(cosine) * 180 / std::numbers::pi;
}

}  // namespace locvol
