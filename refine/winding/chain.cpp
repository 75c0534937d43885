#include "refine/winding/chain.h"

#include <algorithm>
#include <bit>
#include <map>
#include <numeric>
#include <unordered_map>
#include <utility>

#include "octree/disjoint_sets.h"
#include "octree/mix.h"
#include "refine/cure/near_points.h"
#include "refine/domain/cut_triangle.h"
#include "refine/domain/exact_predicates.h"
#include "refine/domain/self_intersection.h"
#include "refine/domain/triangle_tree.h"

namespace locvol {
namespace {

using Face = std::array<std::uint32_t, 3>;

struct HashOfPoint {
  std::size_t operator()(const Point& p) const {
    return mix(mix(mix(std::bit_cast<std::uint64_t>(p.x)) ^ std::bit_cast<std::uint64_t>(p.y)) ^
               std::bit_cast<std::uint64_t>(p.z));
  }
};

// Gives equal points one number.
class PointNumbers {
 public:
  explicit PointNumbers(std::vector<Point>& points) : points_(points) {
    for (std::uint32_t v = 0; v < points.size(); ++v) numbers_.emplace(points[v], v);
  }
  std::uint32_t of(const Point& p) {
    const auto [place, is_new] = numbers_.emplace(p, static_cast<std::uint32_t>(points_.size()));
    if (is_new) points_.push_back(p);
    return place->second;
  }

 private:
  std::vector<Point>& points_;
  std::unordered_map<Point, std::uint32_t, HashOfPoint> numbers_;
};

// Is b an odd permutation of a? REQUIRES: they have the same corners
bool is_turned(const Face& a, const Face& b) {
  const auto place = static_cast<std::size_t>(std::ranges::find(b, a[0]) - b.begin());
  return b[(place + 1) % 3] != a[1];
}

}  // namespace

Point Chain::normal_of(const ChainTriangle& t) const {
  const auto [a, b, c] = points_of(t);
  return cross(b - a, c - a);
}

double Chain::area() const {
  double area = 0;
  for (const ChainTriangle& t : triangles) area += 0.5 * norm(normal_of(t));
  return area;
}

std::vector<Face> Chain::corners() const {
  std::vector<Face> corners;
  corners.reserve(triangles.size());
  for (const ChainTriangle& t : triangles) corners.push_back(t.corners);
  return corners;
}

void unite_equal(Chain& chain) {
  std::vector<std::pair<Face, std::uint32_t>> sorted;
  sorted.reserve(chain.triangles.size());
  for (std::uint32_t t = 0; t < chain.triangles.size(); ++t) {
    Face key = chain.triangles[t].corners;
    std::ranges::sort(key);
    sorted.emplace_back(key, t);
  }
  std::ranges::sort(sorted);
  for (std::size_t begin = 0, end = 0; begin < sorted.size(); begin = end) {
    ChainTriangle& first = chain.triangles[sorted[begin].second];
    while (++end < sorted.size() && sorted[end].first == sorted[begin].first) {
      ChainTriangle& other = chain.triangles[sorted[end].second];
      first.times += is_turned(first.corners, other.corners) ? -other.times : other.times;
      other.times = 0;
    }
  }
  std::erase_if(chain.triangles, [](const ChainTriangle& t) { return t.times == 0; });
}

void append(const Chain& other, Chain& chain) {
  PointNumbers numbers(chain.vertices);
  for (ChainTriangle t : other.triangles) {
    for (std::uint32_t& v : t.corners) v = numbers.of(other.vertices[v]);
    chain.triangles.push_back(t);
  }
}

std::vector<ChainEdge> edges_of(const Chain& chain) {
  std::vector<ChainEdge> edges;
  edges.reserve(3 * chain.triangles.size());
  for (std::uint32_t t = 0; t < chain.triangles.size(); ++t)
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t from = chain.triangles[t].corners[k],
                          to = chain.triangles[t].corners[(k + 1) % 3];
      edges.push_back({std::min(from, to), std::max(from, to), t, from < to});
    }
  std::ranges::sort(edges);
  return edges;
}

std::vector<OpenEdge> open_edges(const Chain& chain) {
  std::vector<OpenEdge> open;
  for_each_edge(edges_of(chain), [&](std::span<const ChainEdge> uses) {
    std::int32_t sum = 0;
    for (const ChainEdge& use : uses) {
      const std::int32_t times = chain.triangles[use.triangle].times;
      sum += use.is_upward ? times : -times;
    }
    if (sum == 0) return;
    const ChainTriangle& of = chain.triangles[uses[0].triangle];
    OpenEdge edge{uses[0].low, uses[0].high, sum, of.group, 0};
    for (const std::uint32_t v : of.corners)
      if (v != edge.from && v != edge.to) edge.apex = v;
    if (sum < 0) {
      std::swap(edge.from, edge.to);
      edge.times = -sum;
    }
    open.push_back(edge);
  });
  return open;
}

std::set<std::pair<std::uint32_t, std::uint32_t>> edges_between(
    const Chain& chain, const std::vector<bool>& is_marked) {
  std::set<std::pair<std::uint32_t, std::uint32_t>> edges;
  for (const ChainTriangle& t : chain.triangles)
    for (std::size_t k = 0; k < 3; ++k)
      if (const std::uint32_t a = t.corners[k], b = t.corners[(k + 1) % 3];
          is_marked[a] && is_marked[b])
        edges.insert(std::minmax(a, b));
  return edges;
}

std::vector<std::vector<std::uint32_t>> loops_of(std::span<const OpenEdge> edges,
                                                 std::size_t num_vertices) {
  // By their ends' origins, each as often as it is there.
  std::vector<std::uint32_t> next(num_vertices + 1), listed;
  for (const OpenEdge& e : edges) next[e.from + 1] += static_cast<std::uint32_t>(e.times);
  std::partial_sum(next.begin(), next.end(), next.begin());
  const std::vector<std::uint32_t> first = next;
  listed.resize(first.back());
  for (std::uint32_t i = 0; i < edges.size(); ++i)
    for (std::int32_t n = 0; n < edges[i].times; ++n) listed[next[edges[i].from]++] = i;
  next = first;
  constexpr std::uint32_t kNowhere = 0;  // else the place in the walk, from 1 on
  std::vector<std::uint32_t> place(num_vertices);
  std::vector<std::vector<std::uint32_t>> loops;
  for (std::uint32_t start = 0; start < num_vertices; ++start)
    while (next[start] < first[start + 1]) {
      std::vector<std::uint32_t> walk;
      std::uint32_t at = start;
      place[at] = 1;
      do {
        // The edges of a chain's border lead on from each of its vertices as often as to it.
        walk.push_back(listed[next[at]++]);
        at = edges[walk.back()].to;
        if (place[at] == kNowhere) {
          place[at] = static_cast<std::uint32_t>(walk.size() + 1);
          continue;
        }
        const std::size_t begin = place[at] - 1;
        loops.emplace_back(walk.begin() + static_cast<std::ptrdiff_t>(begin), walk.end());
        for (std::size_t i = begin + 1; i < walk.size(); ++i) place[edges[walk[i]].from] = kNowhere;
        walk.resize(begin);
      } while (!walk.empty());
      place[start] = kNowhere;
    }
  return loops;
}

namespace {

using ChainWay = std::pair<std::uint32_t, std::uint32_t>;  // the smaller vertex first

bool has_vertex_twice(const ChainTriangle& t) {
  const auto& [a, b, c] = t.corners;
  return a == b || b == c || c == a;
}

// Leads edges through the vertices that are near them, each edge through one. Returns whether there
// were any.
bool lead_edges(Chain& chain, double distance) {
  std::map<ChainWay, std::uint32_t> through;
  for (const ChainTriangle& t : chain.triangles) {
    if (height_of(chain.points_of(t)) >= distance) continue;
    std::size_t longest = 0;
    double length = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const double its =
          squared_distance(chain.vertices[t.corners[k]], chain.vertices[t.corners[(k + 1) % 3]]);
      if (its > length) {
        length = its;
        longest = k;
      }
    }
    const std::uint32_t a = t.corners[longest], b = t.corners[(longest + 1) % 3],
                        m = t.corners[(longest + 2) % 3];
    through.emplace(std::minmax(a, b), m);
  }
  if (through.empty()) return false;
  std::vector<ChainTriangle> triangles;
  for (const ChainTriangle& t : chain.triangles) {
    std::vector<ChainTriangle> pieces{t};
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = t.corners[k], b = t.corners[(k + 1) % 3];
      const auto found = through.find(std::minmax(a, b));
      if (found == through.end()) continue;
      const std::uint32_t m = found->second;
      std::vector<ChainTriangle> next;
      for (const ChainTriangle& piece : pieces) {
        std::size_t l = 0;
        while (l < 3 && !(piece.corners[l] == a && piece.corners[(l + 1) % 3] == b)) ++l;
        if (l == 3) {
          next.push_back(piece);
          continue;
        }
        const std::uint32_t x = piece.corners[(l + 2) % 3];
        ChainTriangle first = piece, second = piece;
        first.corners = {a, m, x};
        second.corners = {m, b, x};
        next.push_back(first);
        next.push_back(second);
      }
      pieces = std::move(next);
    }
    for (const ChainTriangle& piece : pieces)
      if (!has_vertex_twice(piece)) triangles.push_back(piece);
  }
  chain.triangles = std::move(triangles);
  return true;
}

}  // namespace

void snap(Chain& chain, double distance) {
  constexpr int kMostPasses = 20;
  DisjointSets vertices(chain.vertices.size());
  unite_near(chain.vertices, distance, vertices);
  for (ChainTriangle& t : chain.triangles)
    for (std::uint32_t& v : t.corners) v = static_cast<std::uint32_t>(vertices.find(v));
  std::erase_if(chain.triangles, has_vertex_twice);
  for (int pass = 0; pass < kMostPasses && lead_edges(chain, distance); ++pass) unite_equal(chain);
}

std::size_t cut_along_each_other(Chain& chain, const StopToken* stop) {
  const std::size_t num_flat = std::erase_if(chain.triangles, [&](const ChainTriangle& t) {
    const auto [a, b, c] = chain.points_of(t);
    return are_collinear(a, b, c);
  });
  const std::vector<Face> corners = chain.corners();
  std::vector<std::pair<std::uint32_t, std::uint32_t>> pairs;  // each of them both ways
  {
    const TriangleTree tree(chain.vertices, corners);
    for_each_intersection(
        chain.vertices, corners, tree, [](std::uint32_t, std::uint32_t) { return true; },
        [&](std::uint32_t s, std::uint32_t t) {
          pairs.emplace_back(s, t);
          pairs.emplace_back(t, s);
        },
        stop);
  }
  if (pairs.empty()) return num_flat;
  std::ranges::sort(pairs);
  std::size_t num_cut = num_flat;
  StopPoll poll(stop);
  PointNumbers numbers(chain.vertices);
  std::vector<ChainTriangle> pieces;
  std::vector<std::array<Point, 3>> others;
  auto pair = pairs.begin();
  for (std::uint32_t t = 0; t < corners.size(); ++t) {
    const ChainTriangle& triangle = chain.triangles[t];
    others.clear();
    for (; pair != pairs.end() && pair->first == t; ++pair)
      others.push_back(chain.points_of(chain.triangles[pair->second]));
    if (others.empty()) {
      pieces.push_back(triangle);
      continue;
    }
    poll();
    const TrianglePieces cut = cut_triangle(chain.points_of(triangle), others);
    num_cut += cut.corners.size() != 1 || cut.num_collapsed > 0;
    for (const auto& [a, b, c] : cut.corners)
      pieces.push_back(
          {{numbers.of(a), numbers.of(b), numbers.of(c)}, triangle.times, triangle.group});
  }
  chain.triangles = std::move(pieces);
  return num_cut;
}

}  // namespace locvol
