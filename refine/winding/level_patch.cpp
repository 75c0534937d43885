#include "refine/winding/level_patch.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <iterator>
#include <limits>
#include <map>
#include <numbers>
#include <optional>
#include <queue>
#include <set>
#include <unordered_map>
#include <utility>

#include "octree/disjoint_sets.h"
#include "octree/sort_and_unite.h"
#include "refine/cure/cure_surface.h"
#include "refine/cure/fill_loop.h"
#include "refine/domain/box_tree.h"
#include "refine/domain/closest_point.h"
#include "refine/domain/crossing.h"
#include "refine/domain/cut_triangle.h"
#include "refine/domain/leaf_domain.h"
#include "refine/winding/rim_ears.h"
#include "refine/winding/unfold_patch.h"

namespace locvol {
namespace {

using Face = std::array<std::uint32_t, 3>;
using Edge = std::pair<std::uint32_t, std::uint32_t>;  // the smaller first

Edge edge_of(std::uint32_t a, std::uint32_t b) { return {std::min(a, b), std::max(a, b)}; }

double extent_of(std::span<const Point> points) {
  Box box = Box::around(points[0]);
  for (const Point& p : points) box = box.joined(p);
  return max_norm(box.max - box.min);
}

// Halves open edges that are longer than the spacing, with their triangles.
void halve_open_edges(Chain& chain, double spacing) {
  for (;;) {
    const std::vector<OpenEdge> open = open_edges(chain);
    std::map<Edge, std::uint32_t> middles;
    for (const OpenEdge& e : open) {
      const Point &p = chain.vertices[e.from], &q = chain.vertices[e.to];
      if (norm(q - p) <= spacing) continue;
      const Point middle = 0.5 * (p + q);
      if (middle == p || middle == q) continue;
      middles.emplace(edge_of(e.from, e.to), static_cast<std::uint32_t>(chain.vertices.size()));
      chain.vertices.push_back(middle);
    }
    if (middles.empty()) return;
    std::vector<ChainTriangle> triangles;
    std::vector<ChainTriangle> waiting;
    for (const ChainTriangle& t : chain.triangles) {
      waiting.assign({t});
      while (!waiting.empty()) {
        const ChainTriangle piece = waiting.back();
        waiting.pop_back();
        // At its longest edge that is halved.
        std::optional<std::size_t> longest;
        double length = 0;
        for (std::size_t k = 0; k < 3; ++k) {
          const std::uint32_t a = piece.corners[k], b = piece.corners[(k + 1) % 3];
          const double its = squared_distance(chain.vertices[a], chain.vertices[b]);
          if (its > length && middles.contains(edge_of(a, b))) {
            length = its;
            longest = k;
          }
        }
        if (!longest) {
          triangles.push_back(piece);
          continue;
        }
        const std::size_t k = *longest;
        const std::uint32_t a = piece.corners[k], b = piece.corners[(k + 1) % 3],
                            c = piece.corners[(k + 2) % 3], m = middles.at(edge_of(a, b));
        ChainTriangle first = piece, second = piece;
        first.corners = {a, m, c};
        second.corners = {m, b, c};
        waiting.push_back(second);
        waiting.push_back(first);
      }
    }
    chain.triangles = std::move(triangles);
  }
}

// Gives triangles at open edges the vertices that lie on these, where both are of one loop: between
// them there is nothing to fill.
class EdgeSplitter {
 public:
  // `is_open`: by vertex, is it on an open edge?
  EdgeSplitter(Chain& chain, std::vector<bool> is_open)
      : chain_(chain), is_open_(std::move(is_open)) {}

  // `loop`: its vertices, on the way that what fills it would have. False: it is no such loop.
  bool split(const std::vector<std::uint32_t>& loop) {
    constexpr double kFlat = 1e-7;  // of its longest edge
    const std::size_t num = loop.size();
    const auto at = [&](std::size_t i) -> const Point& { return chain_.vertices[loop[i % num]]; };
    std::size_t longest = 0;
    for (std::size_t i = 1; i < num; ++i)
      if (squared_distance(at(i), at(i + 1)) > squared_distance(at(longest), at(longest + 1)))
        longest = i;
    const Point &p = at(longest), &q = at(longest + 1);
    const double least = kFlat * norm(q - p);
    for (std::size_t i = 0; i < num; ++i)
      if (squared_distance(closest_on_segment(p, q, at(i)), at(i)) > least * least) return false;
    // The triangle has the edge the other way.
    const std::uint32_t from = loop[(longest + 1) % num], to = loop[longest];
    if (of_edge_.empty())
      for (std::uint32_t t = 0; t < chain_.triangles.size(); ++t) add(t);
    const auto found = of_edge_.find({from, to});
    if (found == of_edge_.end() || found->second.empty()) return false;
    const std::uint32_t t = found->second.back();
    const ChainTriangle before = chain_.triangles[t];
    if (std::abs(before.times) != 1) return false;
    std::uint32_t apex = 0;
    for (const std::uint32_t v : before.corners)
      if (v != from && v != to) apex = v;
    if (std::ranges::find(loop, apex) != loop.end()) return false;
    remove(t);
    for (std::size_t i = 1; i < num; ++i) {
      const std::uint32_t a = loop[(longest + i) % num], b = loop[(longest + i + 1) % num];
      ChainTriangle piece = before;
      piece.corners = before.times > 0 ? Face{a, b, apex} : Face{b, a, apex};
      std::uint32_t place = t;
      if (i > 1) {
        place = static_cast<std::uint32_t>(chain_.triangles.size());
        chain_.triangles.push_back(piece);
      }
      chain_.triangles[place] = piece;
      add(place);
    }
    return true;
  }

 private:
  // visit(edge) for its edges between such vertices, on the way that it counts them.
  void for_each_way(const ChainTriangle& t, const auto& visit) const {
    const auto is_open = [&](std::uint32_t v) { return v < is_open_.size() && is_open_[v]; };
    for (std::size_t k = 0; k < 3; ++k) {
      Edge way = {t.corners[k], t.corners[(k + 1) % 3]};
      if (t.times < 0) std::swap(way.first, way.second);
      if (is_open(way.first) && is_open(way.second)) visit(way);
    }
  }
  void add(std::uint32_t t) {
    for_each_way(chain_.triangles[t], [&](const Edge& way) { of_edge_[way].push_back(t); });
  }
  void remove(std::uint32_t t) {
    for_each_way(chain_.triangles[t], [&](const Edge& way) { std::erase(of_edge_.at(way), t); });
  }

  Chain& chain_;
  std::vector<bool> is_open_;
  std::map<Edge, std::vector<std::uint32_t>> of_edge_;
};

// Turns diagonals so that no triangle is much lower than rounding can tell, but those whose longest
// edge is the loop's: these come last. Returns how many there are.
std::size_t turn_needles(std::span<const Point> points, std::vector<Face>& filling) {
  constexpr double kFlat = 1e-7;  // of its longest edge
  const auto corners = [&](const Face& t) {
    return std::array{points[t[0]], points[t[1]], points[t[2]]};
  };
  const auto longest_of = [&](const Face& t) {
    std::size_t longest = 0;
    const auto length = [&](std::size_t k) {
      return squared_distance(points[t[k]], points[t[(k + 1) % 3]]);
    };
    for (const std::size_t k : {1, 2})
      if (length(k) > length(longest)) longest = k;
    return longest;
  };
  const auto is_needle = [&](const Face& t) {
    const std::size_t k = longest_of(t);
    return height_of(corners(t)) < kFlat * norm(points[t[k]] - points[t[(k + 1) % 3]]);
  };
  for (std::size_t turn = 0; turn < 4 * filling.size(); ++turn) {
    bool has_turned = false;
    for (Face& t : filling) {
      if (!is_needle(t)) continue;
      const std::size_t k = longest_of(t);
      const std::uint32_t a = t[k], b = t[(k + 1) % 3], m = t[(k + 2) % 3];
      for (Face& other : filling)
        for (std::size_t l = 0; l < 3 && !has_turned; ++l) {
          if (other[l] != b || other[(l + 1) % 3] != a) continue;
          const std::uint32_t x = other[(l + 2) % 3];
          t = {m, a, x};
          other = {x, b, m};
          has_turned = true;
        }
      if (has_turned) break;
    }
    if (!has_turned) break;
  }
  const auto needles = std::ranges::stable_partition(filling, std::not_fn(is_needle));
  return needles.size();
}

// Does a loop lie in a plane, but for rounding?
bool is_flat(std::span<const Point> loop) {
  constexpr double kFlat = 1e-6;  // of its extent
  Point normal;
  for (std::size_t i = 0; i < loop.size(); ++i)
    normal = normal + cross(loop[i] - loop[0], loop[(i + 1) % loop.size()] - loop[0]);
  const double most = kFlat * extent_of(loop) * norm(normal);
  return std::ranges::all_of(
      loop, [&](const Point& p) { return std::abs(dot(p - loop[0], normal)) <= most; });
}

// Fills loops, but for those whose filling is_left(points, filling); triangles have the groups of
// the edges that they begin at, over loops from `wide` on with kOverHole. Where an edge across a
// loop is there already, four triangles would share it: that loop gets a vertex in its middle.
template <class IsLeft>
void fill_loops(Chain& chain, std::span<const OpenEdge> open, double wide, const IsLeft& is_left) {
  std::vector<OpenEdge> back(open.begin(), open.end());
  for (OpenEdge& e : back) std::swap(e.from, e.to);
  std::vector<bool> is_open(chain.vertices.size());
  for (const OpenEdge& e : open) is_open[e.from] = is_open[e.to] = true;
  std::set<Edge> there = edges_between(chain, is_open);
  EdgeSplitter splitter(chain, std::move(is_open));
  for (const std::vector<std::uint32_t>& loop : loops_of(back, chain.vertices.size())) {
    std::vector<std::uint32_t> corners;
    for (const std::uint32_t i : loop) corners.push_back(back[i].from);
    if (splitter.split(corners)) continue;
    std::vector<Point> points, beyond;
    for (const std::uint32_t i : loop) {
      points.push_back(chain.vertices[back[i].from]);
      beyond.push_back(chain.vertices[back[i].apex]);
    }
    const auto num = static_cast<std::uint32_t>(loop.size());
    const auto is_across = [&](std::uint32_t a, std::uint32_t b) {
      return (a + 1) % num != b && (b + 1) % num != a;
    };
    const auto edge_at = [&](std::uint32_t a, std::uint32_t b) {
      return edge_of(back[loop[a]].from, back[loop[b]].from);
    };
    std::vector<Face> filling = triangles_in_loop(points, beyond);
    if (is_left(points, filling)) continue;
    const SheetId over_hole = extent_of(points) >= wide && !is_flat(points) ? kOverHole : 0;
    std::size_t num_needles = turn_needles(points, filling);
    const bool is_fan = filling.empty() || std::ranges::any_of(filling, [&](const Face& t) {
                          for (std::size_t k = 0; k < 3; ++k) {
                            const std::uint32_t a = t[k], b = t[(k + 1) % 3];
                            if (is_across(a, b) && there.contains(edge_at(a, b))) return true;
                          }
                          return false;
                        });
    if (is_fan) {
      filling.clear();
      for (std::uint32_t i = 0; i < num; ++i) filling.push_back({i, (i + 1) % num, num});
      chain.vertices.push_back(center_of_loop(points));
      num_needles = 0;
    }
    for (std::size_t n = 0; n < filling.size(); ++n) {
      const Face& t = filling[n];
      if (n + num_needles >= filling.size() &&
          splitter.split({corners[t[0]], corners[t[1]], corners[t[2]]}))
        continue;
      ChainTriangle triangle{{}, 1, back[loop[t[0]]].group | over_hole};
      for (std::size_t k = 0; k < 3; ++k)
        triangle.corners[k] = t[k] < num ? back[loop[t[k]]].from
                                         : static_cast<std::uint32_t>(chain.vertices.size() - 1);
      for (std::size_t k = 0; k < 3; ++k)
        there.insert(edge_of(triangle.corners[k], triangle.corners[(k + 1) % 3]));
      chain.triangles.push_back(triangle);
    }
  }
}

void fill_all_loops(Chain& chain) {
  constexpr double kNone = std::numeric_limits<double>::infinity();
  fill_loops(chain, open_edges(chain), kNone,
             [](std::span<const Point>, std::span<const Face>) { return false; });
}

// ---- The level set on a grid

// A node of the grid.
struct Node {
  std::int32_t i = 0, j = 0, k = 0;
  friend auto operator<=>(const Node&, const Node&) = default;
};
struct HashOfNode {
  std::size_t operator()(const Node& n) const {
    return (static_cast<std::size_t>(static_cast<std::uint32_t>(n.i)) * 73856093U) ^
           (static_cast<std::size_t>(static_cast<std::uint32_t>(n.j)) * 19349663U) ^
           (static_cast<std::size_t>(static_cast<std::uint32_t>(n.k)) * 83492791U);
  }
};

class LevelPatch {
 public:
  enum class Precision { kFine, kRough };  // the latter to some hundredths of the spacing

  LevelPatch(Chain& kept, const WindingNumber& number, double spacing, Precision precision,
             const StopToken* stop)
      : kept_(kept), number_(number), spacing_(spacing), precision_(precision), poll_(stop) {
    for (std::uint32_t t = 0; t < kept.triangles.size(); ++t)
      triangles_.push_back({.id = t, .corners = kept.points_of(kept.triangles[t])});
    tree_.emplace_back(kept.vertices, kept.corners());
  }

  // Around these places. `rim`: vertices of the chain on which the patch ends
  void build(std::span<const std::uint32_t> rim, std::span<const Point> around) {
    std::vector<Box> boxes;
    for (const std::uint32_t v : rim) boxes.push_back(Box::around(kept_.vertices[v]));
    rim_.assign(rim.begin(), rim.end());
    rim_tree_ = BoxTree(std::move(boxes));
    for (const Point& p : around) {
      const auto at = [&](double x, double aside) {
        return static_cast<std::int32_t>(std::floor(x / spacing_ - aside));
      };
      ask_around({at(p.x, kAside.x), at(p.y, kAside.y), at(p.z, kAside.z)});
    }
    while (!waiting_.empty()) {
      const Node cell = waiting_.front();
      waiting_.pop();
      poll_();
      take_cell(cell);
    }
    place_groups();
    kept_.triangles.insert(kept_.triangles.end(), patch_.begin(), patch_.end());
  }

 private:
  // Where the label changes between two nodes.
  struct Change {
    std::uint32_t vertex = 0;  // of the chain
    bool is_level = false;     // else at the triangles that are kept
  };
  // The level's points around a node.
  struct Group {
    std::uint32_t vertex = 0;  // of the chain
    Point sum = {};
    int num = 0;
  };

  // Beside the planes that parts made by machines have.
  Point place(const Node& n) const {
    return spacing_ * Point{n.i + kAside.x, n.j + kAside.y, n.k + kAside.z};
  }
  double number_at(const Point& p) const {
    return precision_ == Precision::kFine ? number_.at(p) : number_.roughly_at(p);
  }
  bool is_inside(const Point& p) const { return number_at(p) > kLeastInside; }
  bool is_inside(const Node& n) {
    const auto [known, is_new] = inside_.emplace(n, false);
    if (is_new) known->second = is_inside(place(n));
    return known->second;
  }

  void ask_around(const Node& cell) {
    for (std::int32_t di = -1; di <= 1; ++di)
      for (std::int32_t dj = -1; dj <= 1; ++dj)
        for (std::int32_t dk = -1; dk <= 1; ++dk) {
          const Node other{cell.i + di, cell.j + dj, cell.k + dk};
          if (asked_.insert(other).second) waiting_.push(other);
        }
  }

  // Six tetrahedra around the diagonal (Kuhn); alike in all cells.
  void take_cell(const Node& cell) {
    std::array<Node, 8> corners;
    int num_inside = 0;
    for (int c = 0; c < 8; ++c) {
      corners[std::size_t(c)] = {cell.i + (c & 1), cell.j + (c >> 1 & 1), cell.k + (c >> 2 & 1)};
      num_inside += is_inside(corners[std::size_t(c)]);
    }
    if (num_inside == 0 || num_inside == 8) return;
    static constexpr std::array<std::array<std::size_t, 4>, 6> kTetrahedra{
        {{0, 1, 3, 7},
         {0, 2, 6, 7},
         {0, 4, 5, 7},  // even
         {0, 3, 2, 7},
         {0, 6, 4, 7},
         {0, 5, 1, 7}}};  // odd, turned
    bool has_level = false;
    for (const auto& tetrahedron : kTetrahedra) {
      std::array<Node, 4> nodes;
      for (std::size_t n = 0; n < 4; ++n) nodes[n] = corners[tetrahedron[n]];
      has_level |= take_tetrahedron(nodes);
    }
    if (has_level) ask_around(cell);
  }

  // Returns whether the level passes through. REQUIRES: positively oriented
  bool take_tetrahedron(const std::array<Node, 4>& nodes) {
    std::array<bool, 4> in{};
    int num = 0;
    for (std::size_t n = 0; n < 4; ++n) num += in[n] = is_inside(nodes[n]);
    if (num == 0 || num == 4) return false;
    // Even orders of the corners, with those inside, or the one outside, in front.
    static constexpr std::array<std::array<std::size_t, 4>, 12> kOrders{{{0, 1, 2, 3},
                                                                         {1, 0, 3, 2},
                                                                         {2, 3, 0, 1},
                                                                         {3, 2, 1, 0},
                                                                         {0, 2, 3, 1},
                                                                         {1, 3, 2, 0},
                                                                         {2, 0, 1, 3},
                                                                         {3, 1, 0, 2},
                                                                         {0, 3, 1, 2},
                                                                         {1, 2, 0, 3},
                                                                         {2, 1, 3, 0},
                                                                         {3, 0, 2, 1}}};
    const bool front = num != 3;
    const auto fits = [&](const std::array<std::size_t, 4>& o) {
      return num == 2
                 ? in[o[0]] && in[o[1]]
                 : in[o[0]] == front && in[o[1]] != front && in[o[2]] != front && in[o[3]] != front;
    };
    const auto& o = *std::ranges::find_if(kOrders, fits);
    const auto cut = [&](std::size_t a, std::size_t b) {
      return change_between(nodes[o[a]], nodes[o[b]]);
    };
    if (num == 2) {
      const Change p = cut(0, 3), q = cut(1, 3), r = cut(1, 2), s = cut(0, 2);
      const bool one = add(p, q, r), other = add(p, r, s);
      return one || other;
    }
    const Change p = cut(0, 1), q = cut(0, 2), r = cut(0, 3);
    return front ? add(p, q, r) : add(p, r, q);
  }

  bool add(const Change& p, const Change& q, const Change& r) {
    if (!p.is_level && !q.is_level && !r.is_level) return false;
    patch_.push_back({{p.vertex, q.vertex, r.vertex}, 1, 0});
    return true;
  }

  const Change& change_between(Node a, Node b) {
    if (b < a) std::swap(a, b);
    const auto [known, is_new] = changes_.try_emplace({a, b});
    if (is_new) known->second = found_between(a, b, is_inside(a));
    return known->second;
  }

  // REQUIRES: they are on two sides of the surface
  Change found_between(const Node& a, const Node& b, bool is_p_inside) {
    const Point p = place(a), q = place(b);
    struct Hit {
      double t = 0;
      bool enters = false;
    };
    std::vector<Hit> hits;
    const double margin = 1e-9 * spacing_;
    tree_[0].for_each_along(TriangleTree::Stretch(p, q - p, 0, 1), margin, [&](std::uint32_t t) {
      const Triangle& triangle = triangles_[t];
      if (!segment_crosses(p, q, triangle)) return;
      const Point n = normal_of(triangle.corners), at = triangle.corners[0];
      const double from = dot(at - p, n), to = dot(at - q, n);
      hits.push_back(
          {from == to ? 0.5 : std::clamp(from / (from - to), 0.0, 1.0), dot(q - p, n) < 0});
    });
    std::ranges::sort(hits, {}, [](const Hit& h) { return std::pair(h.t, h.enters); });
    const auto at = [&](double t) { return t < 0.5 ? p + t * (q - p) : q + (1 - t) * (p - q); };
    bool is_in = is_p_inside;
    double last = 0;
    for (const Hit& hit : hits) {
      if (hit.enters == is_in) return level_at(a, b, level_between(at(last), at(hit.t), is_in));
      is_in = hit.enters;
      last = hit.t;
    }
    if (is_in == is_p_inside) return level_at(a, b, level_between(at(last), q, is_in));
    return {nearest_on_rim(at(hits.front().t)), false};
  }

  // Where the number passes 1/2, to a thousandth of the way, or roughly: by false position, whose
  // older end counts half (Dowell, Jarratt: the Illinois algorithm, 1971).
  Point level_between(const Point& p, const Point& q, bool is_p_inside) {
    const int most_steps = precision_ == Precision::kFine ? 12 : 5;
    const double least = precision_ == Precision::kFine ? 1e-3 : 0.03;
    // At the ends triangles may be: what counts there is the side.
    double low = 0, high = 1, at_low = is_p_inside ? 0.5 : -0.5, at_high = -at_low, t = 0.5;
    const Point d = q - p;
    int last = 0;
    for (int n = 0; n < most_steps && high - low > least; ++n) {
      const double its = std::clamp(number_at(p + t * d) - 0.5, -0.5, 0.5);
      const bool is_low = (its > 0) == is_p_inside;
      if (is_low) {
        low = t;
        at_low = its;
        if (last == 1) at_high /= 2;
      } else {
        high = t;
        at_high = its;
        if (last == -1) at_low /= 2;
      }
      last = is_low ? 1 : -1;
      const double next = at_low == at_high ? 0.5 : at_low / (at_low - at_high);
      t = low + std::clamp(next, 0.05, 0.95) * (high - low);
      if (std::abs(its) < least) break;
    }
    return p + t * d;
  }

  // Points nearest to one node become one, in their middle: else there are slivers where the level
  // passes near nodes (Treece, Prager, Gee: Regularised marching tetrahedra, 1999).
  Change level_at(const Node& a, const Node& b, const Point& p) {
    const Node& node = squared_distance(p, place(a)) <= squared_distance(p, place(b)) ? a : b;
    const auto [known, is_new] =
        groups_.try_emplace(node, Group{static_cast<std::uint32_t>(kept_.vertices.size())});
    if (is_new) kept_.vertices.push_back({});
    known->second.sum = known->second.sum + p;
    ++known->second.num;
    return {known->second.vertex, true};
  }

  // Of those beside the rim, the vertex there takes the place.
  void place_groups() {
    constexpr double kBeside = 0.35;  // of the spacing
    std::map<std::uint32_t, std::uint32_t> becomes;
    for (const auto& [node, group] : groups_) {
      const Point p = (1.0 / group.num) * group.sum;
      kept_.vertices[group.vertex] = p;
      if (rim_.empty()) continue;
      const std::uint32_t rim = nearest_on_rim(p);
      if (norm(kept_.vertices[rim] - p) < kBeside * spacing_) becomes.emplace(group.vertex, rim);
    }
    for (ChainTriangle& t : patch_)
      for (std::uint32_t& v : t.corners)
        if (const auto found = becomes.find(v); found != becomes.end()) v = found->second;
    std::erase_if(patch_, [](const ChainTriangle& t) {
      const auto& [a, b, c] = t.corners;
      return a == b || b == c || c == a;
    });
  }

  std::uint32_t nearest_on_rim(const Point& p) const {
    std::uint32_t nearest = 0;
    double squared = std::numeric_limits<double>::infinity();
    rim_tree_.for_each_within(p, squared, [&](std::uint32_t n) {
      const double its = squared_distance(kept_.vertices[rim_[n]], p);
      if (its < squared) {
        squared = its;
        nearest = n;
      }
    });
    return rim_[nearest];
  }

  static constexpr Point kAside{0.3819, 0.2360, 0.4721};

  Chain& kept_;
  const WindingNumber& number_;
  double spacing_;
  Precision precision_;
  StopPoll poll_;
  std::vector<Triangle> triangles_;
  std::vector<TriangleTree> tree_;  // one
  std::vector<std::uint32_t> rim_;  // none: there are no triangles
  BoxTree rim_tree_;
  std::unordered_map<Node, bool, HashOfNode> inside_;
  std::set<Node> asked_;
  std::queue<Node> waiting_;
  std::map<std::pair<Node, Node>, Change> changes_;
  std::map<Node, Group> groups_;
  std::vector<ChainTriangle> patch_;
};

// From place `first` on, those of neighbors; `otherwise`: of those that have none.
void give_groups(Chain& chain, std::size_t first, SheetId otherwise) {
  const auto edges_of = [](const Face& t) {
    return std::array{edge_of(t[0], t[1]), edge_of(t[1], t[2]), edge_of(t[2], t[0])};
  };
  std::map<Edge, std::vector<std::size_t>> of_edge;  // triangles of the patch
  for (std::size_t t = first; t < chain.triangles.size(); ++t)
    for (const Edge& e : edges_of(chain.triangles[t].corners)) of_edge[e].push_back(t);
  std::queue<std::size_t> next;
  const auto give = [&](std::size_t t, SheetId group) {
    if (t < first || chain.triangles[t].group != 0) return;
    chain.triangles[t].group = group;
    next.push(t);
  };
  for (std::size_t t = 0; t < chain.triangles.size(); ++t) {
    const SheetId group = chain.triangles[t].group;
    if (group == 0) continue;
    for (const Edge& e : edges_of(chain.triangles[t].corners))
      if (const auto found = of_edge.find(e); found != of_edge.end())
        for (const std::size_t other : found->second) give(other, group);
  }
  for (; !next.empty(); next.pop())
    for (const Edge& e : edges_of(chain.triangles[next.front()].corners))
      for (const std::size_t other : of_edge[e]) give(other, chain.triangles[next.front()].group);
  for (std::size_t t = first; t < chain.triangles.size(); ++t)
    if (chain.triangles[t].group == 0) chain.triangles[t].group = otherwise;
}

std::vector<bool> islands_of(const Chain& chain, double most, std::size_t few) {
  DisjointSets pieces(chain.triangles.size());
  const std::vector<ChainEdge> edges = edges_of(chain);
  for_each_edge(edges, [&](std::span<const ChainEdge> uses) {
    for (const ChainEdge& use : uses) pieces.unite(use.triangle, uses[0].triangle);
  });
  std::map<std::size_t, ChainPiece> found;
  for (std::size_t t = 0; t < chain.triangles.size(); ++t) {
    const std::array<Point, 3> corners = chain.points_of(chain.triangles[t]);
    ChainPiece& piece =
        found.try_emplace(pieces.find(t), ChainPiece{Box::around(corners[0])}).first->second;
    for (const Point& p : corners) piece.box = piece.box.joined(p);
    ++piece.num;
    piece.area += 0.5 * norm(chain.normal_of(chain.triangles[t]));
  }
  for_each_edge(edges, [&](std::span<const ChainEdge> uses) {
    if (uses.size() == 1)
      found.at(pieces.find(uses[0].triangle)).border +=
          norm(chain.vertices[uses[0].high] - chain.vertices[uses[0].low]);
  });
  std::vector<bool> islands(chain.triangles.size());
  for (std::size_t t = 0; t < islands.size(); ++t)
    islands[t] = found.at(pieces.find(t)).is_island(most, few);
  return islands;
}

// Of what ears have left of holes: a level has no room in them, and would stand in folds there.
// Their width is twice their area over the length of their rim.
void fill_narrow_holes(Chain& kept, double spacing) {
  constexpr double kNarrow = 2;  // spacings
  const std::vector<OpenEdge> open = open_edges(kept);
  fill_loops(kept, open, kWide * spacing,
             [&](std::span<const Point> points, std::span<const Face> filling) {
               double area = 0, length = 0;
               for (const auto& [a, b, c] : filling)
                 area += 0.5 * norm(cross(points[b] - points[a], points[c] - points[a]));
               for (std::size_t i = 0; i < points.size(); ++i)
                 length += norm(points[(i + 1) % points.size()] - points[i]);
               return filling.empty() || 2 * area > kNarrow * spacing * length;
             });
}

void add_area(const Chain& chain, std::size_t first, PatchCounts& counts) {
  for (std::size_t t = first; t < chain.triangles.size(); ++t)
    counts.area += 0.5 * norm(chain.normal_of(chain.triangles[t]));
}

}  // namespace

bool ChainPiece::is_island(double most, std::size_t few) const {
  return border > 0 && (num < few || max_norm(box.max - box.min) < most) &&
         border * border >= 4 * std::numbers::pi * area;
}

bool is_near_level(double number) {
  constexpr double kNear = 0.2;
  return std::abs(number - 0.5) < kNear;
}

PatchCounts counts_of_holes(const Chain& chain, std::span<const OpenEdge> open) {
  PatchCounts counts;
  for (const std::vector<std::uint32_t>& loop : loops_of(open, chain.vertices.size())) {
    ++counts.num_holes;
    counts.largest_hole = std::max(counts.largest_hole, std::uint64_t{loop.size()});
  }
  return counts;
}

bool fill_holes(Chain& kept, std::span<const OpenEdge> open, double spacing,
                const std::function<double(const Point&)>& number) {
  constexpr std::size_t kMostWideEdges = 300;  // of a wide hole that is filled
  bool has_left = false;
  fill_loops(kept, open, kWide * spacing,
             [&](std::span<const Point> points, std::span<const Face> filling) {
               const bool is_left =
                   extent_of(points) >= kWide * spacing &&
                   (points.size() > kMostWideEdges || filling.empty() ||
                    !std::ranges::all_of(filling, [&](const Face& t) {
                      return is_near_level(
                          number((1.0 / 3) * (points[t[0]] + points[t[1]] + points[t[2]])));
                    }));
               has_left |= is_left;
               return is_left;
             });
  return has_left;
}

PatchCounts close_by_loops(Chain& chain) {
  PatchCounts counts = counts_of_holes(chain, open_edges(chain));
  const std::size_t first = chain.triangles.size();
  fill_all_loops(chain);
  add_area(chain, first, counts);
  return counts;
}

PatchCounts close_by_level(Chain& kept, double spacing, const StopToken* stop) {
  PatchCounts counts = counts_of_holes(kept, open_edges(kept));
  std::erase_if(kept.triangles,
                [&, islands = islands_of(kept, kWide * spacing, 0),
                 t = std::size_t{0}](const ChainTriangle&) mutable { return islands[t++]; });
  const SheetId group = kept.triangles.empty() ? 0 : kept.triangles.front().group;
  const std::size_t first_filling = kept.triangles.size();
  const bool has_left = [&] {
    const WindingNumber number(kept);
    return fill_holes(kept, number.open(), spacing, [&](const Point& p) { return number.at(p); });
  }();
  if (has_left) {
    close_notches(kept);
    fill_narrow_holes(kept, spacing);
  }
  add_area(kept, first_filling, counts);
  halve_open_edges(kept, spacing);
  const std::size_t first = kept.triangles.size();
  std::vector<std::uint32_t> rim;
  for (const OpenEdge& e : open_edges(kept)) rim.insert(rim.end(), {e.from, e.to});
  if (rim.empty()) return counts;
  sort_and_unite(rim);
  std::vector<Point> around;
  for (const std::uint32_t v : rim) around.push_back(kept.vertices[v]);
  LevelPatch(kept, WindingNumber(kept), spacing, LevelPatch::Precision::kFine, stop)
      .build(rim, around);
  fill_all_loops(kept);
  give_groups(kept, first, group);
  for (std::size_t t = first; t < kept.triangles.size(); ++t) kept.triangles[t].group |= kOverHole;
  unfold_patch(kept);
  add_area(kept, first, counts);
  return counts;
}

bool is_mostly_islands(const Chain& chain, double spacing) {
  const std::vector<bool> islands = islands_of(chain, kWide * spacing, kFewOnIsland);
  double area = 0;
  for (std::size_t t = 0; t < islands.size(); ++t)
    if (islands[t]) area += 0.5 * norm(chain.normal_of(chain.triangles[t]));
  return area > kMostIslands * chain.area();
}

Chain level_surface(const Chain& chain, const WindingNumber& number, double spacing,
                    const StopToken* stop) {
  Chain level;
  std::vector<Point> around;
  for (const OpenEdge& e : number.open()) around.push_back(chain.vertices[e.from]);
  LevelPatch(level, number, spacing, LevelPatch::Precision::kRough, stop).build({}, around);
  give_groups(level, 0, chain.triangles.front().group);
  return level;
}

}  // namespace locvol
