#include "refine/mend_boundary.h"

#include <algorithm>
#include <cstddef>
#include <functional>
#include <optional>
#include <set>
#include <tuple>
#include <utility>

#include "octree/disjoint_sets.h"

namespace locvol {
namespace {

using Vertex = std::uint32_t;
using CellIndex = std::uint32_t;

// Of places in disjoint sets, the set whose places weigh most, or least; of several the first.
// REQUIRES: there is one, and weights are positive
std::size_t extreme_of(DisjointSets& sets, const auto& weight, const auto& is_better) {
  std::vector<std::size_t> sums(sets.num_members());
  for (std::size_t i = 0; i < sums.size(); ++i) sums[sets.find(i)] += weight(i);
  std::size_t best = 0;
  for (std::size_t i = 0; i < sums.size(); ++i)
    if (sums[i] > 0 && is_better(sums[i], sums[best])) best = i;
  return best;
}

class Mending {
 public:
  explicit Mending(const MendInput& input)
      : cells_(input.cells),
        bodies_(input.bodies),
        is_on_surface_(input.is_on_surface),
        is_kept_(input.is_kept),
        num_own_(input.num_own),
        is_left_out_(input.cells.size()) {
    first_.resize(num_own_ + 1);
    for_each_corner([&](Vertex v, CellIndex) { ++first_[v + 1]; });
    std::partial_sum(first_.begin(), first_.end(), first_.begin());
    at_.resize(first_.back());
    std::vector<std::size_t> next(first_.begin(), first_.end() - 1);
    for_each_corner([&](Vertex v, CellIndex c) { at_[next[v]++] = c; });
  }

  std::vector<CellIndex> run() {
    for (Vertex v = 0; v < num_own_; ++v) mend(v);
    while (!waiting_.empty()) mend(waiting_.extract(waiting_.begin()).value());
    std::vector<CellIndex> left_out;
    for (CellIndex c = 0; c < cells_.size(); ++c)
      if (is_left_out_[c]) left_out.push_back(c);
    return left_out;
  }

 private:
  // A facet at the vertex, by its other two corners, and the place in star_ of its cell.
  struct LinkEdge {
    Vertex a, b;  // a < b
    std::size_t place;
    auto ends() const { return std::pair(a, b); }
  };

  void for_each_corner(const auto& visit) const {
    for (CellIndex c = 0; c < cells_.size(); ++c)
      for (const Vertex v : cells_[c])
        if (v < num_own_) visit(v, c);
  }

  void mend(Vertex v) {
    std::set<BodyId> bodies;
    for (std::size_t n = first_[v]; n < first_[v + 1]; ++n) bodies.insert(body_of(at_[n]));
    for (const BodyId body : bodies)
      while (leave_out_some_at(v, body)) {
      }
  }
  BodyId body_of(CellIndex c) const { return bodies_.empty() ? kOnlyBody : bodies_[c]; }

  // Looks at the star of v in the body; false: there is nothing to mend.
  bool leave_out_some_at(Vertex v, BodyId body) {
    find_link(v, body);
    find_parts();
    if (boundary_.empty()) return false;
    const auto weight = [&](std::size_t place) { return weight_of(star_[place]); };
    const std::size_t largest = extreme_of(parts_, weight, std::ranges::greater());
    const auto is_off = [&](std::size_t place) { return parts_.find(place) != largest; };
    if (leave_out(is_off)) return true;
    if (const auto end = end_of_bad_edge()) {
      find_fans(*end);
      star_.swap(fan_);
      const std::size_t smallest = extreme_of(parts_, weight, std::ranges::less());
      return leave_out([&](std::size_t place) { return parts_.find(place) == smallest; });
    }
    if (has_one_cycle()) return false;
    return leave_out([](std::size_t) { return true; });
  }

  std::size_t weight_of(CellIndex c) const {
    constexpr std::size_t kOfVolume = 1 << 16;
    if (is_kept(c)) return kOfVolume;
    return std::ranges::all_of(cells_[c], [&](Vertex v) { return is_on_surface_[v]; }) ? 1
                                                                                       : kOfVolume;
  }

  bool is_kept(CellIndex c) const { return !is_kept_.empty() && is_kept_[c]; }

  // Those in star_ at whose places it holds; false if there are none.
  bool leave_out(const auto& is_to_go) {
    bool has_some = false;
    for (std::size_t place = 0; place < star_.size(); ++place) {
      if (!is_to_go(place) || is_kept(star_[place])) continue;
      has_some = is_left_out_[star_[place]] = true;
      for (const Vertex v : cells_[star_[place]])
        if (v < num_own_) waiting_.insert(v);
    }
    return has_some;
  }

  void find_link(Vertex v, BodyId body) {
    star_.clear();
    link_.clear();
    for (std::size_t n = first_[v]; n < first_[v + 1]; ++n)
      if (!is_left_out_[at_[n]] && body_of(at_[n]) == body) star_.push_back(at_[n]);
    for (std::size_t place = 0; place < star_.size(); ++place) {
      std::array<Vertex, 3> others{};
      std::ranges::copy_if(cells_[star_[place]], others.begin(), [&](Vertex w) { return w != v; });
      std::ranges::sort(others);
      const auto& [a, b, c] = others;
      link_.insert(link_.end(), {{a, b, place}, {a, c, place}, {b, c, place}});
    }
    std::ranges::sort(link_, {}, [](const LinkEdge& e) { return std::tuple(e.a, e.b, e.place); });
  }

  // Cells that share a facet are of one part; facets of one cell are the boundary's.
  void find_parts() {
    parts_.reset(star_.size());
    boundary_.clear();
    for (std::size_t n = 0; n < link_.size(); ++n) {
      if (n + 1 < link_.size() && link_[n].ends() == link_[n + 1].ends()) {
        parts_.unite(link_[n].place, link_[n + 1].place);
        ++n;
      } else {
        boundary_.push_back(link_[n]);
      }
    }
  }

  // Of an edge at the vertex with more than two boundary facets.
  std::optional<Vertex> end_of_bad_edge() {
    ends_.clear();
    for (const LinkEdge& e : boundary_) ends_.insert(ends_.end(), {e.a, e.b});
    std::ranges::sort(ends_);
    for (std::size_t n = 2; n < ends_.size(); ++n)
      if (ends_[n] == ends_[n - 2]) return ends_[n];
    return std::nullopt;
  }

  // The cells at the edge to w, in fan_; and which of these share a facet at it.
  void find_fans(Vertex w) {
    fan_.clear();
    std::vector<std::size_t> place_in_fan(star_.size());
    for (std::size_t place = 0; place < star_.size(); ++place)
      if (std::ranges::count(cells_[star_[place]], w) > 0) {
        place_in_fan[place] = fan_.size();
        fan_.push_back(star_[place]);
      }
    parts_.reset(fan_.size());
    for (std::size_t n = 1; n < link_.size(); ++n)
      if (link_[n].ends() == link_[n - 1].ends() && (link_[n].a == w || link_[n].b == w))
        parts_.unite(place_in_fan[link_[n].place], place_in_fan[link_[n - 1].place]);
  }

  // Of boundary facets, each of whose edges at the vertex two share.
  bool has_one_cycle() {
    const auto repeated = std::ranges::unique(ends_);
    ends_.erase(repeated.begin(), repeated.end());
    const auto place = [&](Vertex v) {
      return static_cast<std::size_t>(std::ranges::lower_bound(ends_, v) - ends_.begin());
    };
    parts_.reset(ends_.size());
    for (const LinkEdge& e : boundary_) parts_.unite(place(e.a), place(e.b));
    for (std::size_t n = 0; n < ends_.size(); ++n)
      if (parts_.find(n) != 0) return false;
    return true;
  }

  const std::vector<std::array<Vertex, 4>>& cells_;
  const std::vector<BodyId>& bodies_;
  const std::vector<bool>& is_on_surface_;
  const std::vector<bool>& is_kept_;
  const Vertex num_own_;
  std::vector<bool> is_left_out_;
  std::vector<std::size_t> first_;  // of an own vertex, in at_
  std::vector<CellIndex> at_;
  std::set<Vertex> waiting_;

  // Of the vertex at hand.
  std::vector<CellIndex> star_, fan_;
  std::vector<LinkEdge> link_, boundary_;
  std::vector<Vertex> ends_;
  DisjointSets parts_;
};

}  // namespace

std::vector<std::uint32_t> mend_boundary(const MendInput& input) { return Mending(input).run(); }

}  // namespace locvol
