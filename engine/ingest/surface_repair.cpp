#include "engine/ingest/surface_repair.h"

#include <algorithm>
#include <array>
#include <numeric>
#include <utility>

#include "octree/sort_and_unite.h"
#include "refine/domain/exact_predicates.h"

namespace locvol {
namespace {

class CollinearFlipper {
 public:
  CollinearFlipper(TriangleSoup& soup, const std::vector<bool>& is_whole)
      : soup_(soup),
        is_whole_(is_whole),
        mates_(paired_edges(soup.vertices.size(), soup.triangles)) {
    result_.taken_from.resize(soup.triangles.size());
    std::iota(result_.taken_from.begin(), result_.taken_from.end(), std::uint32_t{0});
    turn_triangles(find_components(soup_.triangles, mates_).is_turned, soup_.triangles, mates_);
  }

  FlipResult run(std::vector<std::uint32_t> collinear) {
    // Each flip into a neighbor with an area ends one collinear triangle, and each between two
    // collinear ones shortens an edge, so this ends; the bound is against pathological chains.
    const std::uint64_t max_flips = 100 * collinear.size() + 1000;
    while (!collinear.empty()) {
      std::vector<std::uint32_t> later;
      const std::uint64_t flips_before = num_flips_;
      for (const std::uint32_t t : collinear) {
        if (!is_collinear(t)) continue;  // a flip of its neighbor has helped it
        if (num_flips_ < max_flips && flip(t)) {
          for (const std::uint32_t touched : last_flip_)
            if (is_collinear(touched)) later.push_back(touched);
        } else {
          later.push_back(t);
        }
      }
      if (num_flips_ == flips_before) {
        if (!later.empty()) result_.remaining = later.front();
        break;
      }
      sort_and_unite(later);
      collinear = std::move(later);
    }
    sort_and_unite(result_.changed);
    sort_and_unite(result_.beyond);
    return std::move(result_);
  }

 private:
  const Point& position(std::uint32_t v) const { return soup_.vertices[v]; }
  bool is_collinear(std::uint32_t t) const {
    const auto& [a, b, c] = soup_.triangles[t];
    return are_collinear(position(a), position(b), position(c));
  }

  // Along a line, lexicographic order is the order along the line.
  std::uint32_t longest_edge(std::uint32_t t) const {
    const auto& [a, b, c] = soup_.triangles[t];
    const auto is_between = [&](std::uint32_t v, std::uint32_t u, std::uint32_t w) {
      return std::min(position(u), position(w)) < position(v) &&
             position(v) < std::max(position(u), position(w));
    };
    return is_between(c, a, b) ? 3 * t : is_between(a, b, c) ? 3 * t + 1 : 3 * t + 2;
  }

  // Is all known that a flip of t depends on? An edge has its two triangles if one end is whole.
  bool is_surrounded(std::uint32_t t) {
    bool is_known = true;
    for (const std::uint32_t v : soup_.triangles[t]) {
      if (is_whole_[v]) continue;
      result_.beyond.push_back(v);
      is_known = false;
    }
    return is_known;
  }

  // Two collinear triangles are flipped only at an edge that is the longest of both.
  bool flip(std::uint32_t t) {
    if (!is_surrounded(t)) return false;
    const std::uint32_t ac = longest_edge(t), ca = mates_[ac], n = ca / 3;
    if (is_collinear(n) && longest_edge(n) != ca) return false;
    const std::uint32_t cb = next_half_edge(ac), ba = previous_half_edge(ac);
    const std::uint32_t ad = next_half_edge(ca), dc = previous_half_edge(ca);
    const std::uint32_t b = origin(soup_.triangles, ba), d = origin(soup_.triangles, dc);
    if (b == d || are_joined(ba, d)) return false;
    const std::uint32_t a = origin(soup_.triangles, ac), c = origin(soup_.triangles, cb);
    const std::array<std::uint32_t, 4> outer{mates_[ba], mates_[ad], mates_[dc], mates_[cb]};
    soup_.triangles[t] = {b, a, d};
    soup_.triangles[n] = {d, c, b};
    pair(3 * t, outer[0]);
    pair(3 * t + 1, outer[1]);
    pair(3 * n, outer[2]);
    pair(3 * n + 1, outer[3]);
    pair(3 * t + 2, 3 * n + 2);
    ++num_flips_;
    result_.taken_from[t] = result_.taken_from[n];  // t had no area
    last_flip_ = {t, n};
    result_.changed.insert(result_.changed.end(), {t, n});
    return true;
  }

  void pair(std::uint32_t g, std::uint32_t h) {
    mates_[g] = h;
    mates_[h] = g;
  }

  // Does an edge from the origin of half-edge h, in the fan of triangles around it, end at d?
  bool are_joined(std::uint32_t h, std::uint32_t d) const {
    std::uint32_t g = h;
    do {
      if (target(soup_.triangles, g) == d) return true;
      g = mates_[previous_half_edge(g)];
    } while (g != h);
    return false;
  }

  TriangleSoup& soup_;
  const std::vector<bool>& is_whole_;
  Mates mates_;
  std::uint64_t num_flips_ = 0;
  std::array<std::uint32_t, 2> last_flip_{};
  FlipResult result_;
};

}  // namespace

FlipResult flip_collinear_triangles(TriangleSoup& soup, const std::vector<bool>& is_whole,
                                    std::vector<std::uint32_t> collinear) {
  return CollinearFlipper(soup, is_whole).run(std::move(collinear));
}

}  // namespace locvol
