#include "refine/self_intersection.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Intersections_3/Segment_3_Triangle_3.h>
#include <CGAL/Intersections_3/Triangle_3_Triangle_3.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace locvol {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Corners = std::array<std::uint32_t, 3>;

// ---- Candidates: a bounding volume tree over the triangles along the Morton curve ----

// Places v from [low, low + extent] on 21 bits and spreads them for a Morton code.
std::uint64_t spread_bits(double v, double low, double extent) {
  const double unit = extent > 0 ? (v - low) / extent : 0.0;
  auto x = static_cast<std::uint64_t>(std::clamp(unit, 0.0, 1.0) * 2097151.0);
  x = (x | x << 32) & 0x001f00000000ffff;
  x = (x | x << 16) & 0x001f0000ff0000ff;
  x = (x | x << 8) & 0x100f00f00f00f00f;
  x = (x | x << 4) & 0x10c30c30c30c30c3;
  return (x | x << 2) & 0x1249249249249249;
}

// A tree without pointers: node i of level l has the children kFanOut·i … of level l - 1; the
// children of level 0 are runs of triangles in `order_`.
class TriangleTree {
 public:
  TriangleTree(std::span<const Point> vertices, std::span<const Corners> triangles)
      : vertices_(vertices), triangles_(triangles) {
    sort_along_curve();
    build_levels();
  }

  Box box(std::uint32_t triangle) const {
    const Corners& t = triangles_[triangle];
    return Box::around(vertices_[t[0]]).joined(vertices_[t[1]]).joined(vertices_[t[2]]);
  }

  // Appends the triangles with a number above `above` whose boxes overlap `query`.
  void overlapping(const Box& query, std::uint32_t above, std::vector<std::uint32_t>& found) const {
    const std::size_t top = levels_.size() - 1;
    for (std::size_t i = 0; i < levels_[top].size(); ++i) visit(top, i, query, above, found);
  }

 private:
  static constexpr std::size_t kFanOut = 4;
  struct Node {
    Box box;
    std::uint32_t max_triangle = 0;
  };

  void sort_along_curve() {
    Box all = Box::around(vertices_[triangles_[0][0]]);
    for (std::uint32_t t = 0; t < triangles_.size(); ++t) all = all.joined(box(t));
    std::vector<std::pair<std::uint64_t, std::uint32_t>> keys(triangles_.size());
    for (std::uint32_t t = 0; t < triangles_.size(); ++t) {
      const Point c = box(t).center();
      keys[t] = {spread_bits(c.x, all.min.x, all.max.x - all.min.x) |
                     spread_bits(c.y, all.min.y, all.max.y - all.min.y) << 1 |
                     spread_bits(c.z, all.min.z, all.max.z - all.min.z) << 2,
                 t};
    }
    std::sort(keys.begin(), keys.end());
    order_.reserve(keys.size());
    for (const auto& [key, t] : keys) order_.push_back(t);
  }

  void build_levels() {
    std::vector<Node> level;
    for (std::size_t begin = 0; begin < order_.size(); begin += kFanOut) {
      const std::size_t end = std::min(begin + kFanOut, order_.size());
      Node node{box(order_[begin]), order_[begin]};
      for (std::size_t i = begin + 1; i < end; ++i)
        node = {node.box.joined(box(order_[i])), std::max(node.max_triangle, order_[i])};
      level.push_back(node);
    }
    levels_.push_back(std::move(level));
    while (levels_.back().size() > kFanOut) {
      const std::vector<Node>& below = levels_.back();
      std::vector<Node> next;
      for (std::size_t begin = 0; begin < below.size(); begin += kFanOut) {
        const std::size_t end = std::min(begin + kFanOut, below.size());
        Node node = below[begin];
        for (std::size_t i = begin + 1; i < end; ++i)
          node = {node.box.joined(below[i].box),
                  std::max(node.max_triangle, below[i].max_triangle)};
        next.push_back(node);
      }
      levels_.push_back(std::move(next));
    }
  }

  void visit(std::size_t level, std::size_t i, const Box& query, std::uint32_t above,
             std::vector<std::uint32_t>& found) const {
    const Node& node = levels_[level][i];
    if (node.max_triangle <= above || !node.box.overlaps(query)) return;
    const std::size_t begin = kFanOut * i;
    const std::size_t end =
        std::min(begin + kFanOut, level == 0 ? order_.size() : levels_[level - 1].size());
    for (std::size_t child = begin; child < end; ++child) {
      if (level > 0)
        visit(level - 1, child, query, above, found);
      else if (order_[child] > above && box(order_[child]).overlaps(query))
        found.push_back(order_[child]);
    }
  }

  std::span<const Point> vertices_;
  std::span<const Corners> triangles_;
  std::vector<std::uint32_t> order_;
  std::vector<std::vector<Node>> levels_;
};

// ---- Cheap proofs, in rounded arithmetic, that two triangles do not meet ----
//
// An axis, however rounded, separates two point sets if all projections of one lie clearly above
// those of the other. Most pairs end here; what is left, coplanar pairs above all, would cost the
// exact predicates a hundred times more.

// Bounds the error of dot(axis, p - o), p - o included, for |axis| and |p - o| measured by their
// largest coordinates; the last term covers underflow.
constexpr double kProjectionError = 16 * std::numeric_limits<double>::epsilon();
constexpr double kUnderflow = 1e-290;

double max_abs(const Point& p) { return std::max({std::abs(p.x), std::abs(p.y), std::abs(p.z)}); }

// Is `axis` positive on all of `above` and negative on all of `below`, which are vectors?
template <std::size_t N, std::size_t M>
bool separates(const Point& axis, const std::array<Point, N>& above,
               const std::array<Point, M>& below) {
  double largest = 0, low = std::numeric_limits<double>::infinity(), high = -low;
  for (const Point& p : above) {
    low = std::min(low, dot(axis, p));
    largest = std::max(largest, max_abs(p));
  }
  for (const Point& p : below) {
    high = std::max(high, dot(axis, p));
    largest = std::max(largest, max_abs(p));
  }
  const double error = kProjectionError * max_abs(axis) * largest + kUnderflow;
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
  const double scale = max_abs(e) * max_abs(e) * max_abs(a) * max_abs(b);
  return cosine < -8 * kProjectionError * scale - kUnderflow;
}

// ---- Exact tests ----

class PairTest {
 public:
  PairTest(std::span<const Point> vertices, std::span<const Corners> triangles)
      : vertices_(vertices), triangles_(triangles) {}

  bool intersect(std::uint32_t first, std::uint32_t second) const {
    Corners s = triangles_[first], t = triangles_[second];
    switch (move_shared_to_front(s, t)) {
      case 0:
        return intersect_disjoint(s, t);
      case 1:
        return intersect_at_vertex(s, t);
      case 2:
        return is_folded(s, t);
      default:
        return true;  // the same triangle twice
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
                                                       std::span<const Corners> triangles) {
  if (triangles.empty()) return std::nullopt;
  const TriangleTree tree(vertices, triangles);
  const PairTest test(vertices, triangles);
  std::vector<std::uint32_t> candidates;
  for (std::uint32_t t = 0; t < triangles.size(); ++t) {
    candidates.clear();
    tree.overlapping(tree.box(t), t, candidates);
    std::sort(candidates.begin(), candidates.end());
    for (const std::uint32_t other : candidates)
      if (test.intersect(t, other)) return IntersectingPair{t, other};
  }
  return std::nullopt;
}

}  // namespace locvol
