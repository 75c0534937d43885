#include "refine/cure/cure_surface.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/orient_polygon_soup.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/alpha_wrap_3.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <numeric>
#include <set>
#include <string>
#include <utility>

#include "octree/disjoint_sets.h"
#include "octree/sort_and_unite.h"
#include "refine/cure/fill_loop.h"
#include "refine/cure/near_points.h"

namespace locvol {
namespace {

namespace PMP = CGAL::Polygon_mesh_processing;
using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Mesh = CGAL::Surface_mesh<Kernel::Point_3>;
using Face = std::array<std::uint32_t, 3>;

Kernel::Point_3 to_cgal(const Point& p) { return {p.x, p.y, p.z}; }
Point from_cgal(const Kernel::Point_3& p) { return {p.x(), p.y(), p.z()}; }

double area_of(const LooseSurface& s, const Face& t) {
  return 0.5 *
         norm(cross(s.vertices[t[1]] - s.vertices[t[0]], s.vertices[t[2]] - s.vertices[t[0]]));
}

// ---- Triangles that go

// Keeps those that `stays` says, in their order.
template <class Stays>
void keep(LooseSurface& s, const Stays& stays) {
  std::size_t num = 0;
  for (std::size_t t = 0; t < s.triangles.size(); ++t) {
    if (!stays(t)) continue;
    s.triangles[num] = s.triangles[t];
    if (!s.groups.empty()) s.groups[num] = s.groups[t];
    ++num;
  }
  s.triangles.resize(num);
  if (!s.groups.empty()) s.groups.resize(num);
}

// All but the first of those with the same vertices, and those with a vertex twice.
std::uint64_t drop_doubled(LooseSurface& s) {
  std::vector<std::pair<Face, std::uint32_t>> sorted;
  sorted.reserve(s.triangles.size());
  std::vector<bool> goes(s.triangles.size());
  for (std::uint32_t t = 0; t < s.triangles.size(); ++t) {
    Face key = s.triangles[t];
    std::ranges::sort(key);
    if (key[0] == key[1] || key[1] == key[2])
      goes[t] = true;
    else
      sorted.emplace_back(key, t);
  }
  std::ranges::sort(sorted);
  std::uint64_t num = 0;
  for (std::size_t i = 1; i < sorted.size(); ++i)
    if (sorted[i].first == sorted[i - 1].first) {
      goes[sorted[i].second] = true;
      ++num;
    }
  keep(s, [&](std::size_t t) { return !goes[t]; });
  return num;
}

// An edge and a triangle that has it.
struct EdgeUse {
  std::uint32_t low, high, triangle;
  friend auto operator<=>(const EdgeUse&, const EdgeUse&) = default;
};

std::vector<EdgeUse> edge_uses(const LooseSurface& s) {
  std::vector<EdgeUse> uses;
  uses.reserve(3 * s.triangles.size());
  for (std::uint32_t t = 0; t < s.triangles.size(); ++t)
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = s.triangles[t][k], b = s.triangles[t][(k + 1) % 3];
      uses.push_back({std::min(a, b), std::max(a, b), t});
    }
  std::ranges::sort(uses);
  return uses;
}

// Visits each edge with the triangles that have it.
template <class Visit>
void for_each_edge(const std::vector<EdgeUse>& uses, const Visit& visit) {
  for (std::size_t begin = 0, end = 0; begin < uses.size(); begin = end) {
    while (end < uses.size() && uses[end].low == uses[begin].low &&
           uses[end].high == uses[begin].high)
      ++end;
    visit(std::span(uses).subspan(begin, end - begin));
  }
}

// Those with an open edge and one of three triangles or more, until there are none.
std::uint64_t drop_fins(LooseSurface& s, double& dropped_area) {
  std::uint64_t num = 0;
  for (;;) {
    std::vector<bool> is_open(s.triangles.size()), is_overused(s.triangles.size());
    bool has_overused = false;
    for_each_edge(edge_uses(s), [&](std::span<const EdgeUse> uses) {
      for (const EdgeUse& use : uses) {
        if (uses.size() == 1) is_open[use.triangle] = true;
        if (uses.size() > 2) is_overused[use.triangle] = true;
      }
      has_overused |= uses.size() > 2;
    });
    const auto is_fin = [&](std::size_t t) { return is_open[t] && is_overused[t]; };
    std::uint64_t num_now = 0;
    for (std::size_t t = 0; has_overused && t < s.triangles.size(); ++t)
      if (is_fin(t)) {
        ++num_now;
        dropped_area += area_of(s, s.triangles[t]);
      }
    if (num_now == 0) return num;
    num += num_now;
    keep(s, [&](std::size_t t) { return !is_fin(t); });
  }
}

// ---- Points that become one

// Joins points at open edges to the lexicographically smallest one of all that hang together by
// steps below `distance`.
void weld(LooseSurface& s, const RepairLaw& law, RepairChanges& changes) {
  constexpr double kOfShortest = 0.1;
  double distance = law.weld;
  std::vector<std::uint32_t> open;
  for_each_edge(edge_uses(s), [&](std::span<const EdgeUse> uses) {
    if (uses.size() > 1) return;
    open.insert(open.end(), {uses[0].low, uses[0].high});
    if (!law.is_weld_given)
      distance = std::min(distance,
                          kOfShortest * norm(s.vertices[uses[0].high] - s.vertices[uses[0].low]));
  });
  if (!(distance > 0)) return;
  sort_and_unite(open);
  const std::vector<std::uint32_t> becomes =
      joined_near(s.vertices, open, distance, [](std::uint32_t, std::uint32_t) { return true; });
  for (const std::uint32_t v : open) {
    if (becomes[v] == v) continue;
    ++changes.num_joined;
    changes.largest_move =
        std::max(changes.largest_move, norm(s.vertices[becomes[v]] - s.vertices[v]));
  }
  if (changes.num_joined == 0) return;
  for (Face& t : s.triangles)
    for (std::uint32_t& v : t) v = becomes[v];
}

// Components of triangles that have vertices in common.
std::uint64_t num_components(const LooseSurface& s) {
  DisjointSets groups(s.vertices.size());
  std::vector<bool> is_used(s.vertices.size());
  for (const Face& t : s.triangles) {
    groups.unite(t[0], t[1]);
    groups.unite(t[1], t[2]);
    for (const std::uint32_t v : t) is_used[v] = true;
  }
  std::uint64_t num = 0;
  for (std::uint32_t v = 0; v < is_used.size(); ++v) num += is_used[v] && groups.find(v) == v;
  return num;
}

// ---- The mesh

// Open pieces so small, and with so long a border, that they bound nothing: what is left where
// triangles around them are lost. A closed curve of length L bounds at least no area of L²/4π.
void drop_loose(LooseSurface& s, RepairChanges& changes) {
  constexpr std::size_t kFew = 10;
  DisjointSets pieces(s.triangles.size());
  const std::vector<EdgeUse> uses = edge_uses(s);
  for_each_edge(uses, [&](std::span<const EdgeUse> edge) {
    for (const EdgeUse& use : edge) pieces.unite(use.triangle, edge[0].triangle);
  });
  struct Piece {
    std::size_t num = 0;
    double area = 0, border = 0;
  };
  std::map<std::size_t, Piece> found;
  for (std::uint32_t t = 0; t < s.triangles.size(); ++t) {
    Piece& piece = found[pieces.find(t)];
    ++piece.num;
    piece.area += area_of(s, s.triangles[t]);
  }
  for_each_edge(uses, [&](std::span<const EdgeUse> edge) {
    if (edge.size() == 1)
      found[pieces.find(edge[0].triangle)].border +=
          norm(s.vertices[edge[0].high] - s.vertices[edge[0].low]);
  });
  std::vector<bool> goes(s.triangles.size());
  for (std::uint32_t t = 0; t < s.triangles.size(); ++t) {
    const Piece& piece = found[pieces.find(t)];
    if (found.size() == 1 || piece.num >= kFew || piece.border == 0 ||
        piece.border * piece.border < 4 * std::numbers::pi * piece.area)
      continue;
    goes[t] = true;
    ++changes.num_loose;
    changes.dropped_area += area_of(s, s.triangles[t]);
  }
  keep(s, [&](std::size_t t) { return !goes[t]; });
}

// Neighbors one orientation. CGAL doubles vertices where that cannot be, in an edge of more than
// two triangles or a vertex of several fans; here these stay one.
void orient(LooseSurface& s, RepairChanges& changes) {
  std::vector<Kernel::Point_3> points;
  points.reserve(s.vertices.size());
  std::map<Kernel::Point_3, std::uint32_t> numbers;
  for (const Point& p : s.vertices) points.push_back(to_cgal(p));
  const std::vector<Face> before = s.triangles;
  PMP::orient_polygon_soup(points, s.triangles);
  if (points.size() > s.vertices.size()) {
    for (std::uint32_t v = 0; v < s.vertices.size(); ++v) numbers.emplace(points[v], v);
    for (Face& face : s.triangles)
      for (std::uint32_t& v : face)
        if (v >= s.vertices.size()) v = numbers.at(points[v]);
  }
  for (std::size_t t = 0; t < before.size(); ++t) {
    const auto& [a, b, c] = before[t];
    const Face& now = s.triangles[t];
    changes.num_turned += now != before[t] && now != Face{b, c, a} && now != Face{c, a, b};
  }
}

// ---- Holes

struct BorderEdge {  // as the triangle of a filling has it
  std::uint32_t from, to, triangle;
  friend auto operator<=>(const BorderEdge&, const BorderEdge&) = default;
};

std::vector<BorderEdge> border_edges(const LooseSurface& s) {
  std::vector<BorderEdge> edges;
  for_each_edge(edge_uses(s), [&](std::span<const EdgeUse> uses) {
    if (uses.size() != 1) return;
    const Face& t = s.triangles[uses[0].triangle];
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = t[k], b = t[(k + 1) % 3];
      if (std::min(a, b) == uses[0].low && std::max(a, b) == uses[0].high)
        edges.push_back({b, a, uses[0].triangle});
    }
  });
  std::ranges::sort(edges);
  return edges;
}

using Loop = std::vector<BorderEdge>;

// Those without a vertex twice: where holes meet in one, they part there.
std::vector<Loop> loops_of(const LooseSurface& s) {
  const std::vector<BorderEdge> edges = border_edges(s);
  std::vector<std::uint32_t> next(s.vertices.size() + 1), place(s.vertices.size());
  for (const BorderEdge& e : edges) ++next[e.from + 1];
  std::partial_sum(next.begin(), next.end(), next.begin());
  const std::vector<std::uint32_t> first = next;
  constexpr std::uint32_t kNowhere = 0;  // else the place in the walk, from 1 on
  std::vector<Loop> loops;
  for (std::uint32_t start = 0; start + 1 < first.size(); ++start)
    while (next[start] < first[start + 1]) {
      Loop walk;
      std::uint32_t at = start;
      place[at] = 1;
      do {
        if (next[at] == first[at + 1])
          throw CureError(fmt::format("its open edges at ({}, {}, {}) make no loop",
                                      s.vertices[at].x, s.vertices[at].y, s.vertices[at].z));
        walk.push_back(edges[next[at]++]);
        at = walk.back().to;
        if (place[at] == kNowhere) {
          place[at] = static_cast<std::uint32_t>(walk.size() + 1);
          continue;
        }
        const std::size_t begin = place[at] - 1;
        loops.emplace_back(walk.begin() + static_cast<std::ptrdiff_t>(begin), walk.end());
        for (std::size_t i = begin + 1; i < walk.size(); ++i) place[walk[i].from] = kNowhere;
        walk.resize(begin);
      } while (!walk.empty());
      place[start] = kNowhere;
    }
  return loops;
}

using Edge = std::pair<std::uint32_t, std::uint32_t>;  // the smaller first

class HoleFiller {
 public:
  HoleFiller(LooseSurface& s, const RepairLaw& law, RepairChanges& changes)
      : s_(s), law_(law), changes_(changes) {
    for (const EdgeUse& use : edge_uses(s)) edges_.emplace_back(use.low, use.high);
    edges_.erase(std::ranges::unique(edges_).begin(), edges_.end());
  }

  void fill(const Loop& loop) {
    ++changes_.num_holes;
    changes_.largest_hole = std::max<std::uint64_t>(changes_.largest_hole, loop.size());
    const auto refuse = [&](const std::string& why) {
      const Point& p = s_.vertices[loop[0].from];
      throw CureError(
          fmt::format("its hole of {} edges at ({}, {}, {}) {}", loop.size(), p.x, p.y, p.z, why));
    };
    if (loop.size() > law_.most_hole_edges)
      refuse(fmt::format("has more than {}", law_.most_hole_edges));
    if (loop.size() < 3) refuse("has no room for a triangle");
    std::vector<Face> filling = triangles_of(loop);
    if (filling.empty() || has_edge_twice(loop, filling)) filling = fan_of(loop);
    // Each gets the group of a neighbor, from the rim inwards.
    const std::size_t first = s_.triangles.size();
    s_.triangles.insert(s_.triangles.end(), filling.begin(), filling.end());
    changes_.num_filling += filling.size();
    for (const Face& t : filling)
      for (std::size_t k = 0; k < 3; ++k) new_edges_.insert(edge(t[k], t[(k + 1) % 3]));
    if (!s_.groups.empty()) give_groups(loop, first);
  }

 private:
  static Edge edge(std::uint32_t a, std::uint32_t b) { return {std::min(a, b), std::max(a, b)}; }

  std::vector<Face> triangles_of(const Loop& loop) const {
    std::vector<Point> beyond;
    for (const BorderEdge& e : loop)
      for (const std::uint32_t v : s_.triangles[e.triangle])
        if (v != e.from && v != e.to) beyond.push_back(s_.vertices[v]);
    std::vector<Face> filling = triangles_in_loop(points_of(loop), beyond);
    for (Face& t : filling)
      for (std::uint32_t& v : t) v = loop[v].from;
    return filling;
  }
  std::vector<Point> points_of(const Loop& loop) const {
    std::vector<Point> points;
    for (const BorderEdge& e : loop) points.push_back(s_.vertices[e.from]);
    return points;
  }

  // Is an edge across the hole there already?
  bool has_edge_twice(const Loop& loop, const std::vector<Face>& filling) const {
    std::vector<Edge> rim;
    for (const BorderEdge& e : loop) rim.push_back(edge(e.from, e.to));
    std::ranges::sort(rim);
    for (const Face& t : filling)
      for (std::size_t k = 0; k < 3; ++k) {
        const Edge e = edge(t[k], t[(k + 1) % 3]);
        if (!std::ranges::binary_search(rim, e) &&
            (std::ranges::binary_search(edges_, e) || new_edges_.contains(e)))
          return true;
      }
    return false;
  }

  // Around a new vertex in the middle of the edges.
  std::vector<Face> fan_of(const Loop& loop) {
    const auto center = static_cast<std::uint32_t>(s_.vertices.size());
    s_.vertices.push_back(center_of_loop(points_of(loop)));
    std::vector<Face> fan;
    for (const BorderEdge& e : loop) fan.push_back({e.from, e.to, center});
    return fan;
  }

  void give_groups(const Loop& loop, std::size_t first) {
    std::map<Edge, SheetId> known;
    for (const BorderEdge& e : loop) known.emplace(edge(e.from, e.to), s_.groups[e.triangle]);
    s_.groups.resize(s_.triangles.size(), 0);
    for (bool has_changed = true; has_changed;) {
      has_changed = false;
      for (std::size_t t = first; t < s_.triangles.size(); ++t) {
        const auto& [a, b, c] = s_.triangles[t];
        for (const Edge& e : {edge(a, b), edge(b, c), edge(c, a)}) {
          const auto found = known.find(e);
          if (s_.groups[t] != 0 || found == known.end()) continue;
          s_.groups[t] = found->second;
          has_changed = true;
        }
        if (s_.groups[t] == 0) continue;
        for (const Edge& e : {edge(a, b), edge(b, c), edge(c, a)}) known.emplace(e, s_.groups[t]);
      }
    }
  }

  LooseSurface& s_;
  const RepairLaw& law_;
  RepairChanges& changes_;
  std::vector<Edge> edges_;  // of the surface with its holes
  std::set<Edge> new_edges_;
};

void turn_outwards(LooseSurface& s) {
  double volume = 0;
  const Point& o = s.vertices[s.triangles[0][0]];
  for (const auto& [a, b, c] : s.triangles)
    volume += dot(s.vertices[a] - o, cross(s.vertices[b] - o, s.vertices[c] - o));
  if (volume < 0)
    for (Face& t : s.triangles) std::swap(t[1], t[2]);
}

LooseSurface loose(const Mesh& mesh) {
  LooseSurface s;
  std::vector<std::uint32_t> numbers(mesh.num_vertices());
  for (const Mesh::Vertex_index v : mesh.vertices()) {
    numbers[v] = static_cast<std::uint32_t>(s.vertices.size());
    s.vertices.push_back(from_cgal(mesh.point(v)));
  }
  for (const Mesh::Face_index f : mesh.faces()) {
    Face face{};
    std::size_t k = 0;
    for (const Mesh::Vertex_index v : CGAL::vertices_around_face(mesh.halfedge(f), mesh))
      face[k++] = numbers[v];
    s.triangles.push_back(face);
  }
  return s;
}

}  // namespace

LooseSurface repair_surface(LooseSurface s, const RepairLaw& law, RepairChanges& changes) {
  double area = 0;
  for (const Face& t : s.triangles) area += area_of(s, t);
  changes.num_doubled = drop_doubled(s);
  weld(s, law, changes);
  if (changes.num_joined > 0) changes.num_doubled += drop_doubled(s);
  changes.num_fins = drop_fins(s, changes.dropped_area);
  drop_loose(s, changes);
  changes.dropped_area = area > 0 ? changes.dropped_area / area : 0;
  if (s.triangles.empty()) throw CureError("nothing of it is left");
  if (changes.dropped_area > law.most_dropped)
    throw CureError(
        fmt::format("{:.3g}% of its area are loose pieces and fins, more than the {}% that may go",
                    100 * changes.dropped_area, 100 * law.most_dropped));
  const std::uint64_t components = num_components(s);
  orient(s, changes);
  const std::vector<Loop> loops = loops_of(s);
  HoleFiller filler(s, law, changes);
  for (const Loop& loop : loops) filler.fill(loop);
  turn_outwards(s);
  if (const std::uint64_t now = num_components(s); now != components)
    throw CureError(fmt::format("it would have {} components instead of {}", now, components));
  return s;
}

LooseSurface wrap_surface(std::span<const Point> vertices,
                          std::span<const std::array<std::uint32_t, 3>> triangles, double alpha,
                          double offset) {
  std::vector<Kernel::Point_3> points;
  points.reserve(vertices.size());
  for (const Point& p : vertices) points.push_back(to_cgal(p));
  std::vector<std::array<std::size_t, 3>> faces;
  faces.reserve(triangles.size());
  for (const Face& t : triangles) faces.push_back({t[0], t[1], t[2]});
  Mesh wrapped;
  CGAL::alpha_wrap_3(points, faces, alpha, offset, wrapped);
  wrapped.collect_garbage();
  return loose(wrapped);
}

}  // namespace locvol
