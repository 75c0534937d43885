#include "refine/domain/self_intersection.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Intersections_3/Segment_3_Triangle_3.h>
#include <CGAL/Intersections_3/Triangle_3_Triangle_3.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace locvol {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Corners = std::array<std::uint32_t, 3>;

// ---- Cheap proofs, in rounded arithmetic, that two triangles do not meet ----
//
// An axis, however rounded, separates two point sets if all projections of one lie clearly above
// those of the other. Most pairs end here; what is left, coplanar pairs above all, would cost the
// exact predicates a hundred times more.

// Bounds the error of dot(axis, p - o), p - o included, for |axis| and |p - o| measured by their
// largest coordinates; the last term covers underflow.
constexpr double kProjectionError = 16 * std::numeric_limits<double>::epsilon();
constexpr double kProjectionUnderflow = 1e-290;

// Is `axis` positive on all of `above` and negative on all of `below`, which are vectors?
template <std::size_t N, std::size_t M>
bool separates(const Point& axis, const std::array<Point, N>& above,
               const std::array<Point, M>& below) {
  double largest = 0, low = std::numeric_limits<double>::infinity(), high = -low;
  for (const Point& p : above) {
    low = std::min(low, dot(axis, p));
    largest = std::max(largest, max_norm(p));
  }
  for (const Point& p : below) {
    high = std::max(high, dot(axis, p));
    largest = std::max(largest, max_norm(p));
  }
  const double error = kProjectionError * max_norm(axis) * largest + kProjectionUnderflow;
  return low - high > 2 * error;
}

template <std::size_t N, std::size_t M>
bool separates_either_way(const Point& axis, const std::array<Point, N>& a,
                          const std::array<Point, M>& b) {
  return separates(axis, a, b) || separates(axis, b, a);
}

Point unit(const Point& v) {
  const double length = norm(v);
  return length > 0 ? (1 / length) * v : v;
}

using ThreePoints = std::array<Point, 3>;

bool are_clearly_apart(const ThreePoints& s, const ThreePoints& t) {
  const Point o = s[0];
  const ThreePoints a{Point{}, s[1] - o, s[2] - o}, b{t[0] - o, t[1] - o, t[2] - o};
  const Point na = cross(a[1], a[2]), nb = cross(b[1] - b[0], b[2] - b[0]);
  if (separates_either_way(na, a, b) || separates_either_way(nb, a, b)) return true;
  for (std::size_t i = 0; i < 3; ++i) {  // across the edges, in the planes
    const std::size_t j = (i + 1) % 3;
    if (separates_either_way(cross(na, a[j] - a[i]), a, b)) return true;
    if (separates_either_way(cross(nb, b[j] - b[i]), a, b)) return true;
  }
  return false;
}

// Two triangles at a common corner o, by the vectors to their other corners: does a plane through o
// have them strictly on its two sides, or the plane of one have the other strictly on one side?
bool are_clearly_apart(const std::array<Point, 2>& a, const std::array<Point, 2>& b) {
  const std::array<Point, 1> o{Point{}};
  const auto is_beyond = [&](const Point& axis, const std::array<Point, 2>& p) {
    return separates_either_way(axis, p, o);
  };
  if (is_beyond(cross(a[0], a[1]), b) || is_beyond(cross(b[0], b[1]), a)) return true;
  const Point axis = unit(unit(a[0]) + unit(a[1])) - unit(unit(b[0]) + unit(b[1]));
  return separates(axis, a, o) && separates(axis, o, b);
}

// Two triangles with the edge from the origin to e, by the vectors to their other corners: do they
// lie clearly not on the same side of it, in one plane?
bool are_clearly_unfolded(const Point& e, const Point& a, const Point& b) {
  const double cosine = dot(cross(e, a), cross(e, b));
  const double scale = max_norm(e) * max_norm(e) * max_norm(a) * max_norm(b);
  return cosine < -8 * kProjectionError * scale - kProjectionUnderflow;
}

// ---- Exact tests ----

class PairTest {
 public:
  PairTest(std::span<const Point> vertices, std::span<const Corners> triangles)
      : vertices_(vertices), triangles_(triangles) {}

  // `has_copies`: do those with the same vertices?
  bool intersect(std::uint32_t first, std::uint32_t second, bool has_copies = true) const {
    Corners s = triangles_[first], t = triangles_[second];
    switch (move_shared_to_front(s, t)) {
      case 0:
        return intersect_disjoint(s, t);
      case 1:
        return intersect_at_vertex(s, t);
      case 2:
        return is_folded(s, t);
      default:
        return has_copies;  // the same triangle twice
    }
  }

 private:
  // Reorders both so that they begin with their shared vertices, in the same order; counts those.
  static std::size_t move_shared_to_front(Corners& s, Corners& t) {
    std::size_t num_shared = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      const auto same =
          std::find(t.begin() + static_cast<std::ptrdiff_t>(num_shared), t.end(), s[i]);
      if (same == t.end()) continue;
      std::swap(s[num_shared], s[i]);
      std::iter_swap(t.begin() + static_cast<std::ptrdiff_t>(num_shared), same);
      ++num_shared;
    }
    return num_shared;
  }

  bool intersect_disjoint(const Corners& s, const Corners& t) const {
    if (are_clearly_apart(points(s), points(t))) return false;
    return CGAL::do_intersect(triangle(s), triangle(t));
  }

  // Whatever two triangles share beside a common corner reaches the opposite edge of one of them.
  bool intersect_at_vertex(const Corners& s, const Corners& t) const {
    const Point& o = vertices_[s[0]];
    if (are_clearly_apart(std::array{vertices_[s[1]] - o, vertices_[s[2]] - o},
                          std::array{vertices_[t[1]] - o, vertices_[t[2]] - o}))
      return false;
    return CGAL::do_intersect(triangle(s), Kernel::Segment_3(point(t[1]), point(t[2]))) ||
           CGAL::do_intersect(triangle(t), Kernel::Segment_3(point(s[1]), point(s[2])));
  }

  bool is_folded(const Corners& s, const Corners& t) const {
    const Point& o = vertices_[s[0]];
    if (are_clearly_unfolded(vertices_[s[1]] - o, vertices_[s[2]] - o, vertices_[t[2]] - o))
      return false;
    const auto u = point(s[0]), v = point(s[1]), a = point(s[2]), b = point(t[2]);
    return CGAL::coplanar(u, v, a, b) && CGAL::coplanar_orientation(u, v, a, b) == CGAL::POSITIVE;
  }

  ThreePoints points(const Corners& t) const {
    return {vertices_[t[0]], vertices_[t[1]], vertices_[t[2]]};
  }
  Kernel::Point_3 point(std::uint32_t v) const {
    return {vertices_[v].x, vertices_[v].y, vertices_[v].z};
  }
  Kernel::Triangle_3 triangle(const Corners& t) const {
    return {point(t[0]), point(t[1]), point(t[2])};
  }

  std::span<const Point> vertices_;
  std::span<const Corners> triangles_;
};

}  // namespace

std::optional<IntersectingPair> find_self_intersection(std::span<const Point> vertices,
                                                       std::span<const Corners> triangles,
                                                       const TriangleTree& tree,
                                                       const StopToken* stop) {
  const PairTest test(vertices, triangles);
  std::optional<IntersectingPair> smallest;
  std::uint32_t limit = std::numeric_limits<std::uint32_t>::max();
  StopPoll poll(stop);
  tree.for_each_pair(limit, [&](std::uint32_t s, std::uint32_t t) {
    poll();
    const IntersectingPair pair{std::min(s, t), std::max(s, t)};
    if (smallest && *smallest < pair) return;
    if (!test.intersect(pair.first, pair.second)) return;
    smallest = pair;
    limit = pair.first;
  });
  return smallest;
}

void for_each_intersection(std::span<const Point> vertices, std::span<const Corners> triangles,
                           const TriangleTree& tree,
                           const std::function<bool(std::uint32_t, std::uint32_t)>& is_asked,
                           const std::function<void(std::uint32_t, std::uint32_t)>& visit,
                           const StopToken* stop) {
  const PairTest test(vertices, triangles);
  StopPoll poll(stop);
  tree.for_each_pair(std::numeric_limits<std::uint32_t>::max(),
                     [&](std::uint32_t s, std::uint32_t t) {
                       if (!is_asked(s, t)) return;
                       poll();
                       if (test.intersect(s, t, false)) visit(s, t);
                     });
}

}  // namespace locvol
