#include "engine/surface_orientation.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "refine/exact_predicates.h"

namespace locvol {
namespace {

// A sum that keeps the rounding errors of its additions (Neumaier).
class CompensatedSum {
 public:
  void add(double term) {
    const double sum = sum_ + term;
    lost_ += std::abs(sum_) >= std::abs(term) ? (sum_ - sum) + term : (term - sum) + sum_;
    sum_ = sum;
  }
  double value() const { return sum_ + lost_; }

 private:
  double sum_ = 0, lost_ = 0;
};

struct VolumeSum {
  Point origin;  // on the component: small terms, small errors
  CompensatedSum sum;
  double sum_of_sizes = 0;
  bool is_begun = false;
};

// A vertex of a component, and how often a ray upward from it has met the other components.
struct NestingQuery {
  Point point;
  std::uint32_t component = 0;
  bool is_odd = false;
};

// The side of the directed edge ab on which p lies, seen from above, with p moved by an
// infinitesimal (ε, ε²): 0 only if a and b are one point from there.
int side_of_edge(const Point& a, const Point& b, const Point& p) {
  const int side = orientation_along(2, a, b, p);
  if (side != 0) return side;
  if (a.y != b.y) return a.y > b.y ? 1 : -1;
  return a.x == b.x ? 0 : b.x > a.x ? 1 : -1;
}

// Does the ray from p upward, so moved, cross the triangle? REQUIRES: p is not on the triangle
bool ray_crosses(const Point& p, const Point& a, const Point& b, const Point& c) {
  const int side = side_of_edge(a, b, p);
  if (side == 0 || side_of_edge(b, c, p) != side || side_of_edge(c, a, p) != side) return false;
  // The triangle turns left (right) as seen from above, so p is below it if abcp is negative
  // (positive).
  return orientation(a, b, c, p) * side < 0;
}

std::vector<NestingQuery> nesting_queries(std::span<const Point> vertices,
                                          std::span<const TriangleCorners> triangles,
                                          const Components& components) {
  std::vector<NestingQuery> queries;
  for (std::size_t t = 0; t < triangles.size(); ++t)
    if (components.of_triangle[t] == queries.size())
      queries.push_back({vertices[triangles[t][0]], components.of_triangle[t]});
  return queries;
}

}  // namespace

std::vector<SignedVolume> component_volumes(std::span<const Point> vertices,
                                            std::span<const TriangleCorners> triangles,
                                            const Components& components) {
  std::vector<VolumeSum> sums(components.count);
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    VolumeSum& of = sums[components.of_triangle[t]];
    if (!of.is_begun) of = {vertices[triangles[t][0]], {}, 0, true};
    const Point a = vertices[triangles[t][0]] - of.origin,
                b = vertices[triangles[t][1]] - of.origin,
                c = vertices[triangles[t][2]] - of.origin;
    const double term = dot(a, cross(b, c));
    of.sum.add(term);
    of.sum_of_sizes += norm(a) * norm(b) * norm(c);
  }
  std::vector<SignedVolume> volumes;
  for (const VolumeSum& of : sums) {
    const double error = 16 * std::numeric_limits<double>::epsilon() * of.sum_of_sizes;
    volumes.push_back({of.sum.value() / 6, std::abs(of.sum.value()) > error});
  }
  return volumes;
}

std::vector<bool> find_cavities(std::span<const Point> vertices,
                                std::span<const TriangleCorners> triangles,
                                const Components& components) {
  std::vector<bool> is_cavity(components.count);
  if (components.count < 2) return is_cavity;
  std::vector<NestingQuery> queries = nesting_queries(vertices, triangles, components);
  std::stable_sort(
      queries.begin(), queries.end(),
      [](const NestingQuery& q, const NestingQuery& r) { return q.point.x < r.point.x; });
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    const Point &a = vertices[triangles[t][0]], &b = vertices[triangles[t][1]],
                &c = vertices[triangles[t][2]];
    const Box box = Box::around(a).joined(b).joined(c);
    auto query = std::lower_bound(queries.begin(), queries.end(), box.min.x,
                                  [](const NestingQuery& q, double x) { return q.point.x < x; });
    for (; query != queries.end() && query->point.x <= box.max.x; ++query) {
      const Point& p = query->point;
      if (p.y < box.min.y || p.y > box.max.y || p.z > box.max.z) continue;
      if (query->component == components.of_triangle[t]) continue;
      if (ray_crosses(p, a, b, c)) query->is_odd = !query->is_odd;
    }
  }
  for (const NestingQuery& query : queries) is_cavity[query.component] = query.is_odd;
  return is_cavity;
}

}  // namespace locvol
