#include "refine/cure/fill_loop.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/triangulate_hole.h>
#include <CGAL/utility.h>

#include <algorithm>
#include <iterator>

namespace locvol {

std::vector<std::array<std::uint32_t, 3>> triangles_in_loop(std::span<const Point> loop,
                                                            std::span<const Point> beyond) {
  constexpr std::size_t kMostCubicEdges = 300;
  if (loop.size() == 3) return {{0, 1, 2}};
  using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
  const auto to_cgal = [](std::span<const Point> points) {
    std::vector<Kernel::Point_3> all;
    for (const Point& p : points) all.emplace_back(p.x, p.y, p.z);
    return all;
  };
  std::vector<CGAL::Triple<int, int, int>> found;
  CGAL::Polygon_mesh_processing::triangulate_hole_polyline(
      to_cgal(loop), to_cgal(beyond), std::back_inserter(found),
      CGAL::parameters::use_delaunay_triangulation(true).do_not_use_cubic_algorithm(
          loop.size() > kMostCubicEdges));
  std::vector<std::array<std::uint32_t, 3>> triangles;
  if (found.size() + 2 != loop.size()) return triangles;
  const auto at = [](int i) { return static_cast<std::uint32_t>(i); };
  for (const auto& t : found) triangles.push_back({at(t.first), at(t.second), at(t.third)});
  return triangles;
}

Point center_of_loop(std::span<const Point> loop) {
  Point sum;
  double length = 0;
  for (std::size_t i = 0; i < loop.size(); ++i) {
    const Point &p = loop[i], &q = loop[(i + 1) % loop.size()];
    const double weight = norm(q - p);
    sum = sum + 0.5 * weight * (p + q);
    length += weight;
  }
  return (1 / length) * sum;
}

}  // namespace locvol
