#include "refine/winding/rim_ears.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numbers>
#include <queue>
#include <set>
#include <tuple>
#include <utility>
#include <vector>

#include "octree/geometry.h"
#include "refine/cure/cure_surface.h"

namespace locvol {
namespace {

constexpr double kNotch = 150 * std::numbers::pi / 180;
constexpr double kTurn = 0.5;  // the cosine between an ear and the surface at its corners

// The rim of what is open: at each of its vertices the edge that comes and the one that goes.
// Vertices with more than these are none of it.
class Rim {
 public:
  explicit Rim(Chain& chain) : chain_(chain), corners_(chain.vertices.size()) {
    std::vector<bool> is_open(corners_.size());
    for (const OpenEdge& e : open_edges(chain)) {
      add(corners_[e.from].num_after, corners_[e.from].after, e.to, e.times);
      add(corners_[e.to].num_before, corners_[e.to].before, e.from, e.times);
      corners_[e.from].group = e.group;
      is_open[e.from] = is_open[e.to] = true;
    }
    edges_ = edges_between(chain, is_open);
    for (const ChainTriangle& t : chain.triangles) {
      const Point normal = static_cast<double>(t.times) * chain.normal_of(t);
      for (const std::uint32_t v : t.corners) corners_[v].normal = corners_[v].normal + normal;
    }
    for (std::uint32_t v = 0; v < corners_.size(); ++v) note(v);
  }

  std::size_t close() {
    std::size_t num = 0;
    while (!notches_.empty()) {
      const auto [angle, b, a, c] = notches_.top();
      notches_.pop();
      if (!is_simple(b) || corners_[b].before != a || corners_[b].after != c) continue;
      num += close(a, b, c);
    }
    return num;
  }

 private:
  struct Corner {
    std::uint32_t before = 0, after = 0;
    std::int32_t num_before = 0, num_after = 0;  // edges
    SheetId group = 0;                           // of the edge that goes
    Point normal;                                // of what is around, of any length
  };

  static void add(std::int32_t& num, std::uint32_t& place, std::uint32_t v, std::int32_t times) {
    num += times;
    place = v;
  }
  bool is_simple(std::uint32_t v) const {
    return corners_[v].num_before == 1 && corners_[v].num_after == 1;
  }

  // On the side of the hole, which lies to the right of the edges.
  double angle_at(std::uint32_t v) const {
    const Corner& corner = corners_[v];
    const Point normal = (1 / norm(corner.normal)) * corner.normal;
    const auto direction = [&](std::uint32_t to) {
      const Point way = chain_.vertices[to] - chain_.vertices[v];
      return way - dot(way, normal) * normal;
    };
    const Point after = direction(corner.after), before = direction(corner.before);
    const double inside = std::atan2(dot(cross(after, before), normal), dot(after, before));
    return inside > 0 ? 2 * std::numbers::pi - inside : -inside;
  }

  void note(std::uint32_t v) {
    if (!is_simple(v) || !(norm(corners_[v].normal) > 0)) return;
    const double angle = angle_at(v);
    if (angle < kNotch) notches_.push({angle, v, corners_[v].before, corners_[v].after});
  }

  bool close(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    if (!is_simple(a) || !is_simple(c) || edges_.contains(std::minmax(a, c))) return false;
    const ChainTriangle ear{{c, b, a}, 1, corners_[b].group | kOverHole};
    const Point normal = chain_.normal_of(ear);
    const double size = norm(normal);
    for (const std::uint32_t v : ear.corners)
      if (!(dot(normal, corners_[v].normal) > kTurn * size * norm(corners_[v].normal)))
        return false;
    chain_.triangles.push_back(ear);
    edges_.insert(std::minmax(a, c));
    corners_[b].num_before = corners_[b].num_after = 0;
    corners_[a].after = c;
    corners_[c].before = a;
    for (const std::uint32_t v : {a, c}) {
      corners_[v].normal = corners_[v].normal + normal;
      note(v);
    }
    return true;
  }

  // The sharpest first; of equals, that of the smallest vertex.
  using Notch = std::tuple<double, std::uint32_t, std::uint32_t, std::uint32_t>;

  Chain& chain_;
  std::vector<Corner> corners_;
  std::set<std::pair<std::uint32_t, std::uint32_t>> edges_;  // between vertices of the rim
  std::priority_queue<Notch, std::vector<Notch>, std::greater<>> notches_;
};

}  // namespace

std::size_t close_notches(Chain& chain) { return Rim(chain).close(); }

}  // namespace locvol
