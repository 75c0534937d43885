#include "refine/winding/inside_surface.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <span>
#include <utility>
#include <vector>

#include "octree/disjoint_sets.h"
#include "octree/sort_and_unite.h"
#include "refine/cure/near_points.h"
#include "refine/domain/cut_triangle.h"
#include "refine/domain/exact_predicates.h"
#include "refine/winding/chain.h"
#include "refine/winding/doubt.h"
#include "refine/winding/level_patch.h"
#include "refine/winding/winding_number.h"

namespace locvol {
namespace {

// Of a triangle, one beyond an edge that they alone have.
struct PatchNeighbor {
  std::uint32_t of = 0, other = 0;
  bool is_turned = false;  // against it
  friend auto operator<=>(const PatchNeighbor&, const PatchNeighbor&) = default;
};

// Those that are closer than the gap, and than a tenth of the open edges at both.
void join_open_points(Chain& chain, double gap, WindingChanges& changes) {
  if (!(gap > 0)) return;
  std::vector<std::uint32_t> open;
  std::vector<double> reach(chain.vertices.size(), gap);
  for_each_edge(edges_of(chain), [&](std::span<const ChainEdge> uses) {
    if (uses.size() > 1) return;
    for (const std::uint32_t v : {uses[0].low, uses[0].high}) {
      open.push_back(v);
      reach[v] = std::min(reach[v], kOfShortestOpen * norm(chain.vertices[uses[0].high] -
                                                           chain.vertices[uses[0].low]));
    }
  });
  sort_and_unite(open);
  const std::vector<std::uint32_t> becomes =
      joined_near(chain.vertices, open, gap, [&](std::uint32_t u, std::uint32_t v) {
        return norm(chain.vertices[u] - chain.vertices[v]) < std::min(reach[u], reach[v]);
      });
  for (const std::uint32_t v : open) {
    if (becomes[v] == v) continue;
    ++changes.num_joined;
    changes.largest_move =
        std::max(changes.largest_move, norm(chain.vertices[becomes[v]] - chain.vertices[v]));
  }
  for (ChainTriangle& t : chain.triangles)
    for (std::uint32_t& v : t.corners) v = becomes[v];
  std::erase_if(chain.triangles, [](const ChainTriangle& t) {
    const auto& [a, b, c] = t.corners;
    return a == b || b == c || c == a;
  });
}

// Triangles that hang together by edges of two get one orientation: that of most of their area.
std::uint64_t orient_patches(Chain& chain) {
  const std::size_t num = chain.triangles.size();
  std::vector<PatchNeighbor> neighbors;
  for_each_edge(edges_of(chain), [&](std::span<const ChainEdge> uses) {
    if (uses.size() != 2) return;
    const bool is_turned = uses[0].is_upward == uses[1].is_upward;
    neighbors.push_back({uses[0].triangle, uses[1].triangle, is_turned});
    neighbors.push_back({uses[1].triangle, uses[0].triangle, is_turned});
  });
  std::ranges::sort(neighbors);
  std::vector<std::uint8_t> turned(num);
  std::vector<bool> is_met(num);
  std::uint64_t num_turned = 0;
  std::vector<std::uint32_t> patch;
  for (std::uint32_t start = 0; start < num; ++start) {
    if (is_met[start]) continue;
    is_met[start] = true;
    patch.assign({start});
    double area = 0;  // of those that stay, less that of the others
    for (std::size_t n = 0; n < patch.size(); ++n) {
      const std::uint32_t t = patch[n];
      const double its = norm(chain.normal_of(chain.triangles[t]));
      area += turned[t] != 0 ? -its : its;
      const auto first = std::ranges::lower_bound(neighbors, t, {}, &PatchNeighbor::of);
      for (auto next = first; next != neighbors.end() && next->of == t; ++next) {
        if (is_met[next->other]) continue;
        is_met[next->other] = true;
        turned[next->other] = turned[t] ^ static_cast<std::uint8_t>(next->is_turned);
        patch.push_back(next->other);
      }
    }
    for (const std::uint32_t t : patch)
      if ((turned[t] != 0) != (area < 0)) {
        ++num_turned;
        std::swap(chain.triangles[t].corners[1], chain.triangles[t].corners[2]);
      }
  }
  return num_turned;
}

// Turns all, if most of it faces inwards.
void turn_outwards(Chain& chain, WindingChanges& changes) {
  if (chain.triangles.empty()) return;
  Point center;
  double area = 0, volume = 0;
  for (const ChainTriangle& t : chain.triangles) {
    const auto [a, b, c] = chain.points_of(t);
    const double its = norm(chain.normal_of(t));
    center = center + (its / 3) * (a + b + c);
    area += its;
  }
  center = (1 / area) * center;
  for (const ChainTriangle& t : chain.triangles) {
    const auto [a, b, c] = chain.points_of(t);
    volume += dot(a - center, cross(b - center, c - center));
  }
  if (volume >= 0) return;
  for (ChainTriangle& t : chain.triangles) std::swap(t.corners[1], t.corners[2]);
  changes.num_turned = chain.triangles.size() - changes.num_turned;
}

// Which triangles are told by the same one. Where the chain is closed, all those that hang together
// by edges of two: the number is the same along them. Else those lower than rounding are told by a
// neighbor.
DisjointSets told_together(const Chain& chain, bool is_closed, double least_height) {
  DisjointSets sets(chain.triangles.size());
  const auto is_needle = [&](std::uint32_t t) {
    return height_of(chain.points_of(chain.triangles[t])) < least_height;
  };
  for_each_edge(edges_of(chain), [&](std::span<const ChainEdge> uses) {
    if (uses.size() != 2 || uses[0].is_upward == uses[1].is_upward) return;
    const std::uint32_t s = uses[0].triangle, t = uses[1].triangle;
    if (chain.triangles[s].times != chain.triangles[t].times) return;
    if (is_closed || is_needle(s) || is_needle(t)) sets.unite(s, t);
  });
  return sets;
}

// How sets of triangles are kept: 1 as they are, -1 turned, 0 not. Where the chain is closed, what
// is kept is to be closed, too. Where it is not, the label of a set that is hardly higher than
// rounding is wrong: then such sets change at open edges, as long as that leaves fewer of these.
void close_labels(const Chain& chain, DisjointSets& sets, const auto& may_change,
                  std::vector<std::int8_t>& kept) {
  constexpr int kMostPasses = 20;
  struct Side {
    std::uint32_t set = 0;
    int way = 0;  // the sum of its triangles' ways along the edge
  };
  std::vector<std::vector<Side>> sides;  // of edges where sets meet
  std::map<std::uint32_t, std::vector<std::uint32_t>> edges_of_set;
  for_each_edge(edges_of(chain), [&](std::span<const ChainEdge> uses) {
    std::vector<Side> own;
    for (const ChainEdge& use : uses) {
      const auto set = static_cast<std::uint32_t>(sets.find(use.triangle));
      auto side = std::ranges::find(own, set, &Side::set);
      if (side == own.end()) side = own.insert(own.end(), {set, 0});
      side->way += use.is_upward ? 1 : -1;
    }
    std::erase_if(own, [](const Side& side) { return side.way == 0; });
    if (own.empty()) return;
    for (const Side& side : own)
      edges_of_set[side.set].push_back(static_cast<std::uint32_t>(sides.size()));
    sides.push_back(std::move(own));
  });
  const auto open_at = [&](std::uint32_t edge) {
    int sum = 0;
    for (const Side& side : sides[edge]) sum += kept[side.set] * side.way;
    return std::abs(sum);
  };
  for (int pass = 0; pass < kMostPasses; ++pass) {
    bool has_changed = false;
    for (std::uint32_t edge = 0; edge < sides.size(); ++edge) {
      if (open_at(edge) == 0) continue;
      for (const Side& side : sides[edge]) {
        if (!may_change(side.set)) continue;
        const auto open_around = [&] {
          int sum = 0;
          for (const std::uint32_t e : edges_of_set.at(side.set)) sum += open_at(e);
          return sum;
        };
        std::int8_t best = kept[side.set];
        int least = open_around();
        for (const std::int8_t other : {std::int8_t{0}, std::int8_t{1}, std::int8_t{-1}}) {
          kept[side.set] = other;
          if (const int its = open_around(); its < least) {
            least = its;
            best = other;
            has_changed = true;
          }
        }
        kept[side.set] = best;
      }
    }
    if (!has_changed) return;
  }
}

// Keeps triangles where the label changes, once, with what is inside behind them. `near`: what
// rounding may part
void keep_where_label_changes(Chain& chain, const WindingNumber& number, double near,
                              const StopToken* stop) {
  const bool is_closed = number.open().empty();
  DisjointSets sets = told_together(chain, is_closed, near);
  struct Teller {
    double height = -1;
    std::size_t triangle = 0;
  };
  std::vector<Teller> tellers(chain.triangles.size());  // by set: the triangle that is highest
  for (std::size_t t = 0; t < tellers.size(); ++t) {
    Teller& its = tellers[sets.find(t)];
    if (const double height = height_of(chain.points_of(chain.triangles[t])); height > its.height)
      its = {height, t};
  }
  StopPoll poll(stop);
  std::vector<std::int8_t> kept(chain.triangles.size());
  for (std::size_t t = 0; t < kept.size(); ++t) {
    if (sets.find(t) != t) continue;
    poll();
    const BesideNumbers beside = number.beside(tellers[t].triangle);
    const bool is_behind = beside.behind > kLeastInside, is_before = beside.before > kLeastInside;
    kept[t] = static_cast<std::int8_t>(is_behind - is_before);
  }
  constexpr double kHardly = 1e5;
  const auto may_change = [&](std::uint32_t set) { return tellers[set].height < kHardly * near; };
  if (is_closed) close_labels(chain, sets, may_change, kept);
  for (std::size_t t = 0; t < kept.size(); ++t) {
    ChainTriangle& its = chain.triangles[t];
    const int as = kept[sets.find(t)];
    its.times = std::abs(as);
    if (as < 0) std::swap(its.corners[1], its.corners[2]);
  }
  std::erase_if(chain.triangles, [](const ChainTriangle& t) { return t.times == 0; });
}

// Drops parts that close around nothing: what is left where triangles lie nearly on each other.
void drop_flat_parts(Chain& chain) {
  constexpr double kFlat = 1e-6;  // of what is as thick as wide
  DisjointSets parts(chain.triangles.size());
  for_each_edge(edges_of(chain), [&](std::span<const ChainEdge> uses) {
    for (const ChainEdge& use : uses) parts.unite(use.triangle, uses[0].triangle);
  });
  struct Sums {
    Point origin;
    double area = 0, volume = 0;
  };
  std::map<std::size_t, Sums> sums;
  for (std::size_t t = 0; t < chain.triangles.size(); ++t) {
    const auto [a, b, c] = chain.points_of(chain.triangles[t]);
    Sums& its = sums.try_emplace(parts.find(t), Sums{a}).first->second;
    its.area += 0.5 * norm(cross(b - a, c - a));
    its.volume += dot(a - its.origin, cross(b - its.origin, c - its.origin)) / 6;
  }
  for (std::size_t t = 0; t < chain.triangles.size(); ++t) {
    const Sums& its = sums.at(parts.find(t));
    if (std::abs(its.volume) < kFlat * its.area * std::sqrt(its.area)) chain.triangles[t].times = 0;
  }
  std::erase_if(chain.triangles, [](const ChainTriangle& t) { return t.times == 0; });
}

WindingDoubt doubt_of(const Chain& chain, const WindingNumber& number, const StopToken* stop) {
  if (number.open().empty()) return {};
  Box box = Box::around(chain.points_of(chain.triangles[0])[0]);
  for (const ChainTriangle& t : chain.triangles)
    for (const Point& p : chain.points_of(t)) box = box.joined(p);
  const std::vector<Point> places = places_of_doubt(box);
  constexpr double kSurely = 0.75;
  std::size_t num = 0, num_inside = 0;
  StopPoll poll(stop);
  for (const Point& p : places) {
    poll();
    const double its = number.roughly_at(p);
    num += is_in_doubt(its);
    num_inside += its > kSurely;
  }
  const auto all = static_cast<double>(places.size());
  return {.share = static_cast<double>(num) / all, .inside = static_cast<double>(num_inside) / all};
}

// Without what has no area.
Chain chain_of(const LooseSurface& surface) {
  Chain chain{surface.vertices, {}};
  for (std::size_t t = 0; t < surface.triangles.size(); ++t) {
    const auto& [a, b, c] = surface.triangles[t];
    if (a == b || b == c || c == a ||
        are_collinear(surface.vertices[a], surface.vertices[b], surface.vertices[c]))
      continue;
    chain.triangles.push_back(
        {surface.triangles[t], 1, surface.groups.empty() ? SheetId{1} : surface.groups[t]});
  }
  return chain;
}

}  // namespace

WindingDoubt winding_doubt(const LooseSurface& surface, const StopToken* stop) {
  Chain chain = chain_of(surface);
  WindingChanges turned;
  orient_patches(chain);
  turn_outwards(chain, turned);
  unite_equal(chain);
  if (chain.triangles.empty()) return {.is_nothing = true};
  throw_if_stopped(stop);
  return doubt_of(chain, WindingNumber(chain), stop);
}

double snapping_distance(const Box& box) {
  constexpr double kNear = 1e-10;  // of the largest coordinate: what rounding may part
  return kNear * std::max(max_norm(box.min), max_norm(box.max));
}

LooseSurface winding_surface(const LooseSurface& surface, double spacing, double gap,
                             WindingChanges& changes, const StopToken* stop) {
  constexpr int kMostRounds = 4;  // what rounding does to cuts is cut again
  Chain chain = chain_of(surface);
  join_open_points(chain, gap, changes);
  changes.num_turned = orient_patches(chain);
  turn_outwards(chain, changes);
  const double all_area = chain.area();
  Box box = Box::around({});
  for (const Point& p : chain.vertices) box = box.joined(p);
  const double near = snapping_distance(box);
  changes.is_level = !chain.triangles.empty() && is_mostly_islands(chain, spacing);
  if (changes.is_level) {
    const WindingNumber number(chain);
    changes.doubt = doubt_of(chain, number, stop).share;
    chain = level_surface(chain, number, spacing, stop);
  }
  std::size_t num_closed = 0;
  for (int round = 0; round < kMostRounds; ++round) {
    snap(chain, near);
    const std::size_t num_cut = cut_along_each_other(chain, stop);
    if (round == 0) changes.num_cut = num_cut;
    if (num_cut > 0) snap(chain, near);
    unite_equal(chain);
    std::size_t num_open = 0;
    {
      const WindingNumber number(chain);
      throw_if_stopped(stop);
      if (round == 0 && !changes.is_level && !chain.triangles.empty())
        changes.doubt = doubt_of(chain, number, stop).share;
      keep_where_label_changes(chain, number, near, stop);
      if (chain.triangles.empty()) break;
      if (round == 0 && !changes.is_level)
        changes.left_out_area = std::max(0.0, 1 - chain.area() / all_area);
      num_open = open_edges(chain).size();
      if (num_open > 0) {
        const PatchCounts counts =
            round == 0 ? close_by_level(chain, spacing, stop) : close_by_loops(chain);
        if (round == 0) {
          changes.num_holes = counts.num_holes;
          changes.largest_hole = counts.largest_hole;
          changes.closing_area = counts.area / chain.area();
        }
      }
    }
    if (round == 0) num_closed = chain.triangles.size();
    // What does not close falls to dust.
    if (num_open == 0 || chain.triangles.size() > 2 * num_closed + 1000) break;
  }
  snap(chain, near);
  unite_equal(chain);
  drop_flat_parts(chain);
  LooseSurface result;
  std::vector<std::uint32_t> numbers(chain.vertices.size());
  std::vector<bool> is_used(chain.vertices.size());
  for (const ChainTriangle& t : chain.triangles)
    for (const std::uint32_t v : t.corners) is_used[v] = true;
  for (std::uint32_t v = 0; v < numbers.size(); ++v) {
    numbers[v] = static_cast<std::uint32_t>(result.vertices.size());
    if (is_used[v]) result.vertices.push_back(chain.vertices[v]);
  }
  for (const ChainTriangle& t : chain.triangles) {
    auto [a, b, c] = t.corners;
    if (t.times < 0) std::swap(b, c);
    result.triangles.push_back({numbers[a], numbers[b], numbers[c]});
    result.groups.push_back(t.group);
  }
  return result;
}

}  // namespace locvol
