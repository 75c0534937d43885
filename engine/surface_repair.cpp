#include "engine/surface_repair.h"

#include <algorithm>
#include <array>
#include <utility>

#include "refine/exact_predicates.h"

namespace locvol {
namespace {

constexpr std::uint32_t kUnused = 0xffffffff;

bool is_collapsed(const TriangleCorners& t) { return t[0] == t[1] || t[1] == t[2] || t[2] == t[0]; }

bool is_collinear(const TriangleSoup& soup, std::uint32_t t) {
  const auto& [a, b, c] = soup.triangles[t];
  return are_collinear(soup.vertices[a], soup.vertices[b], soup.vertices[c]);
}

std::vector<TriangleCorners> without(const std::vector<bool>& is_dropped,
                                     std::span<const TriangleCorners> triangles) {
  std::vector<TriangleCorners> kept;
  for (std::size_t t = 0; t < triangles.size(); ++t)
    if (!is_dropped[t]) kept.push_back(triangles[t]);
  return kept;
}

// Triangles with the same vertices, two or more, in order.
std::vector<std::vector<std::uint32_t>> groups_of_copies(
    std::span<const TriangleCorners> triangles) {
  std::vector<std::pair<TriangleCorners, std::uint32_t>> sorted;
  sorted.reserve(triangles.size());
  for (std::uint32_t t = 0; t < triangles.size(); ++t) {
    TriangleCorners key = triangles[t];
    std::sort(key.begin(), key.end());
    sorted.emplace_back(key, t);
  }
  std::sort(sorted.begin(), sorted.end());
  std::vector<std::vector<std::uint32_t>> groups;
  for (std::size_t i = 0; i < sorted.size();) {
    std::size_t end = i + 1;
    while (end < sorted.size() && sorted[end].first == sorted[i].first) ++end;
    if (end - i > 1) {
      groups.emplace_back();
      for (; i < end; ++i) groups.back().push_back(sorted[i].second);
    }
    i = end;
  }
  return groups;
}

class CollinearFlipper {
 public:
  CollinearFlipper(TriangleSoup& soup, EdgePairing& pairing) : soup_(soup), pairing_(pairing) {}

  FlipResult run(std::vector<std::uint32_t> collinear) {
    // Each flip into a neighbor with an area ends one collinear triangle, and each between two
    // collinear ones shortens an edge, so this ends; the bound is against pathological chains.
    const std::uint64_t max_flips = 100 * collinear.size() + 1000;
    while (!collinear.empty()) {
      std::vector<std::uint32_t> later;
      const std::uint64_t flips_before = result_.num_flips;
      for (const std::uint32_t t : collinear) {
        if (!is_collinear(soup_, t)) continue;  // a flip of its neighbor has helped it
        const std::uint32_t beyond = pairing_.mates[longest_edge(t)] / 3;
        if (result_.num_flips < max_flips && flip(t)) {
          for (const std::uint32_t touched : {t, beyond})
            if (is_collinear(soup_, touched)) later.push_back(touched);
        } else {
          later.push_back(t);
        }
      }
      if (result_.num_flips == flips_before) {
        if (!later.empty()) result_.remaining = later.front();
        break;
      }
      std::sort(later.begin(), later.end());
      later.erase(std::unique(later.begin(), later.end()), later.end());
      collinear = std::move(later);
    }
    return result_;
  }

 private:
  const Point& position(std::uint32_t v) const { return soup_.vertices[v]; }

  // Along a line, lexicographic order is the order along the line.
  std::uint32_t longest_edge(std::uint32_t t) const {
    const auto& [a, b, c] = soup_.triangles[t];
    const auto is_between = [&](std::uint32_t v, std::uint32_t u, std::uint32_t w) {
      return std::min(position(u), position(w)) < position(v) &&
             position(v) < std::max(position(u), position(w));
    };
    return is_between(c, a, b) ? 3 * t : is_between(a, b, c) ? 3 * t + 1 : 3 * t + 2;
  }

  // Two collinear triangles are flipped only at an edge that is the longest of both.
  bool flip(std::uint32_t t) {
    const std::uint32_t ac = longest_edge(t), ca = pairing_.mates[ac], n = ca / 3;
    if (is_collinear(soup_, n) && longest_edge(n) != ca) return false;
    const std::uint32_t cb = next_half_edge(ac), ba = previous_half_edge(ac);
    const std::uint32_t ad = next_half_edge(ca), dc = previous_half_edge(ca);
    const std::uint32_t b = origin(soup_.triangles, ba), d = origin(soup_.triangles, dc);
    if (b == d || are_joined(ba, d)) return false;
    const std::uint32_t a = origin(soup_.triangles, ac), c = origin(soup_.triangles, cb);
    const std::array<std::uint32_t, 4> outer{pairing_.mates[ba], pairing_.mates[ad],
                                             pairing_.mates[dc], pairing_.mates[cb]};
    soup_.triangles[t] = {b, a, d};
    soup_.triangles[n] = {d, c, b};
    pair(3 * t, outer[0]);
    pair(3 * t + 1, outer[1]);
    pair(3 * n, outer[2]);
    pair(3 * n + 1, outer[3]);
    pair(3 * t + 2, 3 * n + 2);
    ++result_.num_flips;
    return true;
  }

  void pair(std::uint32_t g, std::uint32_t h) {
    pairing_.mates[g] = h;
    pairing_.mates[h] = g;
  }

  // Does an edge from the origin of half-edge h, in the fan of triangles around it, end at d?
  bool are_joined(std::uint32_t h, std::uint32_t d) const {
    std::uint32_t g = h;
    do {
      if (target(soup_.triangles, g) == d) return true;
      g = pairing_.mates[previous_half_edge(g)];
    } while (g != h);
    return false;
  }

  TriangleSoup& soup_;
  EdgePairing& pairing_;
  FlipResult result_;
};

}  // namespace

std::uint64_t drop_collapsed_triangles(TriangleSoup& soup) {
  return std::erase_if(soup.triangles, is_collapsed);
}

std::uint64_t drop_repeated_triangles(TriangleSoup& soup) {
  const auto groups = groups_of_copies(soup.triangles);
  if (groups.empty()) return 0;
  std::vector<bool> is_dropped(soup.triangles.size());
  for (const auto& copies : groups)
    for (std::size_t i = 1; i < copies.size(); ++i) is_dropped[copies[i]] = true;

  // Judge each group in the surface without any copies.
  const EdgePairing pairing = pair_edges(soup.vertices.size(), without(is_dropped, soup.triangles));
  std::vector<std::uint32_t> number_without(soup.triangles.size());
  for (std::uint32_t t = 0, kept = 0; t < number_without.size(); ++t) {
    number_without[t] = kept;
    kept += is_dropped[t] ? 0u : 1u;
  }
  std::uint64_t num_dropped = 0;
  for (const auto& copies : groups) {
    const auto mates = pairing.mates.begin() + std::ptrdiff_t{3} * number_without[copies[0]];
    if (std::find(mates, mates + 3, kNoHalfEdge) == mates + 3)
      num_dropped += copies.size() - 1;
    else
      for (const std::uint32_t t : copies) is_dropped[t] = false;
  }
  if (num_dropped > 0) soup.triangles = without(is_dropped, soup.triangles);
  return num_dropped;
}

std::uint64_t drop_unused_vertices(TriangleSoup& soup) {
  std::vector<std::uint32_t> renumbered(soup.vertices.size(), kUnused);
  for (const TriangleCorners& t : soup.triangles)
    for (const std::uint32_t v : t) renumbered[v] = 0;
  std::uint32_t num_used = 0;
  for (std::size_t v = 0; v < renumbered.size(); ++v) {
    if (renumbered[v] == kUnused) continue;
    soup.vertices[num_used] = soup.vertices[v];
    renumbered[v] = num_used++;
  }
  const std::uint64_t num_dropped = soup.vertices.size() - num_used;
  soup.vertices.resize(num_used);
  if (num_dropped > 0)
    for (TriangleCorners& t : soup.triangles)
      for (std::uint32_t& v : t) v = renumbered[v];
  return num_dropped;
}

std::vector<std::uint32_t> find_collinear_triangles(const TriangleSoup& soup) {
  std::vector<std::uint32_t> collinear;
  for (std::uint32_t t = 0; t < soup.triangles.size(); ++t)
    if (is_collinear(soup, t)) collinear.push_back(t);
  return collinear;
}

FlipResult flip_collinear_triangles(TriangleSoup& soup, EdgePairing& pairing,
                                    std::vector<std::uint32_t> collinear) {
  return CollinearFlipper(soup, pairing).run(std::move(collinear));
}

}  // namespace locvol
