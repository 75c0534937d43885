#include "refine/winding/unfold_patch.h"

#include <algorithm>
#include <array>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "octree/geometry.h"
#include "refine/cure/cure_surface.h"

namespace locvol {
namespace {

using Face = std::array<std::uint32_t, 3>;

// Cosines of angles between outward normals: the smaller, the more they are folded.
constexpr double kFolded = -0.70710678118654752;  // 135 degrees
constexpr double kUnfolded = 0;                   // 90 degrees

bool is_patch(const ChainTriangle& t) { return (t.group & kOverHole) != 0; }

// Turns edges of which none is near another, as those of one look at the chain have to be.
class EdgeTurns {
 public:
  explicit EdgeTurns(Chain& chain) : chain_(chain), is_changed_(chain.triangles.size()) {
    std::vector<bool> is_of_patch(chain.vertices.size());
    for (const ChainTriangle& t : chain.triangles)
      if (is_patch(t))
        for (const std::uint32_t v : t.corners) is_of_patch[v] = true;
    for (std::uint32_t t = 0; t < chain.triangles.size(); ++t) {
      const Face& f = chain.triangles[t].corners;
      for (std::size_t k = 0; k < 3; ++k)
        if (is_of_patch[f[k]] && is_of_patch[f[(k + 1) % 3]])
          at_edge_[std::minmax(f[k], f[(k + 1) % 3])].push_back(t);
    }
  }

  std::size_t run() {
    std::size_t num_turned = 0;
    for (const auto& [edge, triangles] : at_edge_)
      if (triangles.size() == 2) num_turned += turn(triangles[0], triangles[1]);
    return num_turned;
  }

 private:
  // Two triangles, with the corner of each that the other does not have first; seen from the front
  // they turn left.
  struct Pair {
    Face first{}, second{};
  };

  bool turn(std::uint32_t s, std::uint32_t t) {
    ChainTriangle &first = chain_.triangles[s], &second = chain_.triangles[t];
    if (!is_patch(first) || !is_patch(second) || is_changed_[s] || is_changed_[t] ||
        first.times != 1 || second.times != 1)
      return false;
    const std::optional<Pair> pair = pair_of(first.corners, second.corners);
    if (!pair) return false;
    const auto [x, a, b] = pair->first;
    const std::uint32_t y = pair->second[0];
    if (x == y || at_edge_.contains(std::minmax(x, y))) return false;
    const Face beside_x{x, a, y}, beside_y{x, y, b};
    // The neighbors at x a, b x, a y and y b.
    std::array<std::uint32_t, 4> around{};
    const std::array<std::pair<std::uint32_t, std::uint32_t>, 4> edges{
        std::minmax(x, a), std::minmax(b, x), std::minmax(a, y), std::minmax(y, b)};
    for (std::size_t k = 0; k < 4; ++k) {
      const std::optional<std::uint32_t> other = across(edges[k], s, t);
      if (!other || is_changed_[*other]) return false;
      around[k] = *other;
    }
    std::array<Point, 4> normals;
    std::ranges::transform(around, normals.begin(),
                           [&](std::uint32_t n) { return normal(chain_.triangles[n].corners); });
    const double before =
        sharpest(normal(pair->first), normal(pair->second), normals, {0, 0, 1, 1});
    const double after = sharpest(normal(beside_x), normal(beside_y), normals, {0, 1, 0, 1});
    if (before > kFolded || after < kUnfolded) return false;
    first.corners = beside_x;
    second.corners = beside_y;
    is_changed_[s] = is_changed_[t] = true;
    for (const std::uint32_t n : around) is_changed_[n] = true;
    return true;
  }

  // Nothing: they do not have their edge both ways.
  static std::optional<Pair> pair_of(const Face& f, const Face& g) {
    for (std::size_t k = 0; k < 3; ++k)
      for (std::size_t l = 0; l < 3; ++l) {
        const std::uint32_t a = f[(k + 1) % 3], b = f[(k + 2) % 3];
        if (g[(l + 1) % 3] == b && g[(l + 2) % 3] == a) return Pair{{f[k], a, b}, {g[l], b, a}};
      }
    return std::nullopt;
  }

  std::optional<std::uint32_t> across(const std::pair<std::uint32_t, std::uint32_t>& edge,
                                      std::uint32_t s, std::uint32_t t) const {
    const std::vector<std::uint32_t>& triangles = at_edge_.at(edge);
    if (triangles.size() != 2) return std::nullopt;
    return triangles[0] == s || triangles[0] == t ? triangles[1] : triangles[0];
  }

  // The cosine of the largest angle between the two, and between each and those beside it.
  // `beside`: which of the two is at each of the four.
  static double sharpest(const Point& first, const Point& second,
                         const std::array<Point, 4>& normals, const std::array<int, 4>& beside) {
    double cosine = dot(first, second);
    for (std::size_t k = 0; k < 4; ++k)
      cosine = std::min(cosine, dot(normals[k], beside[k] == 0 ? first : second));
    return cosine;
  }

  // Of length 1; of what has no area 0.
  Point normal(const Face& f) const {
    const Point& a = chain_.vertices[f[0]];
    const Point n = cross(chain_.vertices[f[1]] - a, chain_.vertices[f[2]] - a);
    const double length = norm(n);
    return length > 0 ? 1 / length * n : Point{};
  }

  Chain& chain_;
  std::vector<bool> is_changed_;  // a triangle, or one beside it
  // Triangles at edges, of all between two vertices of the patch.
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::vector<std::uint32_t>> at_edge_;
};

}  // namespace

std::size_t unfold_patch(Chain& chain) {
  constexpr int kMostTurns = 10;  // of one edge after another at a place
  std::size_t num_turned = 0;
  for (int n = 0; n < kMostTurns; ++n) {
    const std::size_t num = EdgeTurns(chain).run();
    num_turned += num;
    if (num == 0) break;
  }
  return num_turned;
}

}  // namespace locvol
