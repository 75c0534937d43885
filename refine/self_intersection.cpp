#include "refine/self_intersection.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Intersections_3/Segment_3_Triangle_3.h>
#include <CGAL/Intersections_3/Triangle_3_Triangle_3.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
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

// A tree without pointers: node i of level l has the children kFanOut·i … of level l - 1; level 0
// holds the triangles, with the part of their boxes in the region. CGAL's box_self_intersection_d()
// takes 1.4 times as long with 20,000 triangles, twice with 321,000.
class TriangleTree {
 public:
  TriangleTree(std::span<const Point> vertices, std::span<const Corners> triangles,
               const Box& region)
      : levels_(1) {
    std::vector<Node> nodes;
    nodes.reserve(triangles.size());
    for (std::uint32_t t = 0; t < triangles.size(); ++t) {
      const auto& [a, b, c] = triangles[t];
      const Box box = Box::around(vertices[a]).joined(vertices[b]).joined(vertices[c]);
      nodes.push_back({box.common(region), t});
    }
    sort_along_curve(nodes);
    build_levels();
  }

  // visit(s, t) for every two triangles whose boxes overlap, once, in either order; not for pairs
  // without a number up to `limit`, which visits may lower.
  template <class Visit>
  void for_each_pair(const std::uint32_t& limit, const Visit& visit) const {
    const std::size_t top = levels_.size() - 1;
    pairs_within(top, 0, levels_[top].size(), limit, visit);
  }

 private:
  static constexpr std::size_t kFanOut = 4;
  struct Node {
    Box box;
    std::uint32_t triangle = 0;  // the smallest below
  };

  void sort_along_curve(const std::vector<Node>& nodes) {
    Box all = nodes[0].box;
    for (const Node& node : nodes) all = all.joined(node.box);
    std::vector<std::pair<std::uint64_t, std::uint32_t>> keys(nodes.size());
    for (std::uint32_t t = 0; t < nodes.size(); ++t) {
      const Point c = nodes[t].box.center();
      keys[t] = {spread_bits(c.x, all.min.x, all.max.x - all.min.x) |
                     spread_bits(c.y, all.min.y, all.max.y - all.min.y) << 1 |
                     spread_bits(c.z, all.min.z, all.max.z - all.min.z) << 2,
                 t};
    }
    std::sort(keys.begin(), keys.end());
    levels_[0].reserve(keys.size());
    for (const auto& [key, t] : keys) levels_[0].push_back(nodes[t]);
  }

  void build_levels() {
    while (levels_.back().size() > kFanOut) {
      const std::vector<Node>& below = levels_.back();
      std::vector<Node> next;
      next.reserve(below.size() / kFanOut + 1);
      for (std::size_t begin = 0; begin < below.size(); begin += kFanOut) {
        const std::size_t end = std::min(begin + kFanOut, below.size());
        Node node = below[begin];
        for (std::size_t i = begin + 1; i < end; ++i)
          node = {node.box.joined(below[i].box), std::min(node.triangle, below[i].triangle)};
        next.push_back(node);
      }
      levels_.push_back(std::move(next));
    }
  }

  // Among the nodes begin … end - 1 of a level.
  template <class Visit>
  void pairs_within(std::size_t level, std::size_t begin, std::size_t end,
                    const std::uint32_t& limit, const Visit& visit) const {
    for (std::size_t i = begin; i < end; ++i) {
      if (level > 0) pairs_within(level - 1, kFanOut * i, end_of_children(level, i), limit, visit);
      for (std::size_t j = i + 1; j < end; ++j) pairs_of(level, i, j, limit, visit);
    }
  }

  template <class Visit>
  void pairs_of(std::size_t level, std::size_t i, std::size_t j, const std::uint32_t& limit,
                const Visit& visit) const {
    const Node &a = levels_[level][i], &b = levels_[level][j];
    if (!a.box.overlaps(b.box) || std::min(a.triangle, b.triangle) > limit) return;
    if (level == 0) return visit(a.triangle, b.triangle);
    const std::size_t end_a = end_of_children(level, i), end_b = end_of_children(level, j);
    for (std::size_t k = kFanOut * i; k < end_a; ++k) {
      if (!levels_[level - 1][k].box.overlaps(b.box)) continue;
      for (std::size_t l = kFanOut * j; l < end_b; ++l) pairs_of(level - 1, k, l, limit, visit);
    }
  }

  std::size_t end_of_children(std::size_t level, std::size_t i) const {
    return std::min(kFanOut * (i + 1), levels_[level - 1].size());
  }

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
                                                       std::span<const Corners> triangles,
                                                       const Box& region, const StopToken* stop) {
  if (triangles.empty()) return std::nullopt;
  const TriangleTree tree(vertices, triangles, region);
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

}  // namespace locvol
