#include "refine/grains/voronoi_grains.h"

#include <CGAL/Cartesian_converter.h>
#include <CGAL/Delaunay_triangulation_3.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Exact_rational.h>
#include <CGAL/Simple_cartesian.h>
#include <CGAL/Triangulation_cell_base_with_info_3.h>
#include <CGAL/Triangulation_vertex_base_with_info_3.h>

#include <algorithm>
#include <cstddef>
#include <tuple>
#include <utility>

#include "octree/sort_and_unite.h"

namespace locvol {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Exact = CGAL::Simple_cartesian<CGAL::Exact_rational>;
using VertexBase = CGAL::Triangulation_vertex_base_with_info_3<std::uint32_t, Kernel>;
using CellBase = CGAL::Triangulation_cell_base_with_info_3<std::uint32_t, Kernel>;
using Delaunay =
    CGAL::Delaunay_triangulation_3<Kernel,
                                   CGAL::Triangulation_data_structure_3<VertexBase, CellBase>>;

// In a cube, the Voronoi cell of a point is its cell among all points and their mirror images in
// the six sides: none of these is closer to a place in the cube than its point is, and each place
// outside is closer to one of them. So its sides come as faces between a point and its image.
class GrainsOfCube {
 public:
  explicit GrainsOfCube(std::span<const Point> seeds)
      : num_seeds_(static_cast<std::uint32_t>(seeds.size())) {
    points_.assign(seeds.begin(), seeds.end());
    points_.reserve(7 * seeds.size());
    for (const Point& seed : seeds)
      for (int axis = 0; axis < 3; ++axis)
        for (const double side : {-1.0, 1.0}) {
          points_.push_back(seed);
          points_.back()[axis] = 2 * side - seed[axis];
        }
    std::vector<std::pair<Kernel::Point_3, std::uint32_t>> points;
    points.reserve(points_.size());
    for (const auto& [x, y, z] : points_)
      points.emplace_back(Kernel::Point_3(x, y, z), static_cast<std::uint32_t>(points.size()));
    delaunay_.insert(points.begin(), points.end());
    if (delaunay_.number_of_vertices() != points.size())
      throw GrainError("two seeds of grains are one");
  }

  Grains run() && {
    find_corners();
    number_vertices();
    find_faces();
    return std::move(grains_);
  }

 private:
  static constexpr std::uint32_t kNoCorner = kNoGrain;

  bool is_seed(Delaunay::Vertex_handle v) const { return v->info() < num_seeds_; }

  // The circumcenter of each cell of a seed. Cells of one ball have equal ones.
  void find_corners() {
    const CGAL::Cartesian_converter<Kernel, Exact> exact;
    for (const auto cell : delaunay_.all_cell_handles()) {
      cell->info() = kNoCorner;
      if (delaunay_.is_infinite(cell)) continue;
      const auto has_seed = [&](int i) { return is_seed(cell->vertex(i)); };
      if (!has_seed(0) && !has_seed(1) && !has_seed(2) && !has_seed(3)) continue;
      const Exact::Point_3 center =
          CGAL::circumcenter(exact(cell->vertex(0)->point()), exact(cell->vertex(1)->point()),
                             exact(cell->vertex(2)->point()), exact(cell->vertex(3)->point()));
      cell->info() = static_cast<std::uint32_t>(corners_.size());
      corners_.push_back(
          {CGAL::to_double(center.x()), CGAL::to_double(center.y()), CGAL::to_double(center.z())});
    }
  }

  void number_vertices() {
    grains_.vertices = corners_;
    sort_and_unite(grains_.vertices);
    for (const Point& corner : corners_)
      vertex_of_corner_.push_back(static_cast<std::uint32_t>(
          std::ranges::lower_bound(grains_.vertices, corner) - grains_.vertices.begin()));
  }

  void find_faces() {
    for (const auto& edge : delaunay_.finite_edges()) {
      auto [cell, i, j] = edge;
      std::uint32_t a = cell->vertex(i)->info(), b = cell->vertex(j)->info();
      if (a > b) std::swap(a, b);
      if (a >= num_seeds_) continue;
      std::vector<std::uint32_t> ring;
      auto at = delaunay_.incident_cells(edge);
      const auto begin = at;
      do {
        const std::uint32_t v = vertex_of_corner_[at->info()];
        if (ring.empty() || ring.back() != v) ring.push_back(v);
      } while (++at != begin);
      if (ring.size() > 1 && ring.back() == ring.front()) ring.pop_back();
      if (ring.size() < 3) continue;
      add_face(a, b, std::move(ring));
    }
    std::ranges::sort(grains_.faces, [](const GrainFace& f, const GrainFace& g) {
      return std::tie(f.grains, f.vertices) < std::tie(g.grains, g.vertices);
    });
  }

  void add_face(std::uint32_t a, std::uint32_t b, std::vector<std::uint32_t> ring) {
    // From a to b it turns left.
    Point area;
    const Point& first = grains_.vertices[ring[0]];
    for (std::size_t k = 1; k + 1 < ring.size(); ++k)
      area = area + cross(grains_.vertices[ring[k]] - first, grains_.vertices[ring[k + 1]] - first);
    if (dot(area, points_[b] - points_[a]) < 0) std::ranges::reverse(ring);
    std::ranges::rotate(ring, std::ranges::min_element(ring));
    grains_.faces.push_back({{a, b < num_seeds_ ? b : kNoGrain}, std::move(ring)});
  }

  std::uint32_t num_seeds_;
  std::vector<Point> points_;  // seeds, then their images
  Delaunay delaunay_;
  std::vector<Point> corners_;  // of cells, by their info
  std::vector<std::uint32_t> vertex_of_corner_;
  Grains grains_;
};

}  // namespace

Grains voronoi_grains(std::span<const Point> seeds) { return GrainsOfCube(seeds).run(); }

}  // namespace locvol
