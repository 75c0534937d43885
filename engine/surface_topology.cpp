#include "engine/surface_topology.h"

#include <algorithm>
#include <utility>

namespace locvol {
namespace {

// One half-edge as its edge's smaller vertex lists it.
struct EdgeUse {
  std::uint32_t larger_vertex = 0, half_edge = 0;
  friend auto operator<=>(const EdgeUse&, const EdgeUse&) = default;
};

class EdgePairer {
 public:
  EdgePairer(std::size_t num_vertices, std::span<const TriangleCorners> triangles)
      : triangles_(triangles), begin_(num_vertices + 1), uses_(3 * triangles.size()) {
    pairing_.mates.assign(3 * triangles.size(), kNoHalfEdge);
  }

  EdgePairing run() {
    list_uses();
    for (std::size_t v = 0; v + 1 < begin_.size(); ++v) {
      const std::span uses(uses_.data() + begin_[v], begin_[v + 1] - begin_[v]);
      std::sort(uses.begin(), uses.end());
      pair_uses(uses);
    }
    return std::move(pairing_);
  }

 private:
  std::pair<std::uint32_t, std::uint32_t> edge(std::uint32_t h) const {
    return std::minmax({origin(triangles_, h), target(triangles_, h)});
  }

  // Counting sort by the edge's smaller vertex.
  void list_uses() {
    for (std::uint32_t h = 0; h < uses_.size(); ++h) ++begin_[edge(h).first];
    std::uint32_t sum = 0;
    for (std::uint32_t& b : begin_) b = (sum += b);
    for (auto h = static_cast<std::uint32_t>(uses_.size()); h-- > 0;) {
      const auto [v, w] = edge(h);
      uses_[--begin_[v]] = {w, h};
    }
  }

  void pair_uses(std::span<const EdgeUse> uses) {
    for (std::size_t i = 0; i < uses.size();) {
      std::size_t end = i + 1;
      while (end < uses.size() && uses[end].larger_vertex == uses[i].larger_vertex) ++end;
      const std::uint32_t h = uses[i].half_edge;
      if (end - i == 1) {
        ++pairing_.num_border_edges;
        pairing_.first_border = std::min(pairing_.first_border, h);
      } else if (end - i == 2) {
        pairing_.mates[h] = uses[i + 1].half_edge;
        pairing_.mates[uses[i + 1].half_edge] = h;
      } else {
        ++pairing_.num_overused_edges;
        pairing_.first_overused = std::min(pairing_.first_overused, h);
      }
      i = end;
    }
  }

  std::span<const TriangleCorners> triangles_;
  std::vector<std::uint32_t> begin_;  // of each vertex's uses
  std::vector<EdgeUse> uses_;
  EdgePairing pairing_;
};

}  // namespace

EdgePairing pair_edges(std::size_t num_vertices, std::span<const TriangleCorners> triangles) {
  return EdgePairer(num_vertices, triangles).run();
}

Components find_components(std::span<const TriangleCorners> triangles, const EdgePairing& pairing) {
  constexpr std::uint32_t kNone = 0xffffffff;
  Components components{std::vector<std::uint32_t>(triangles.size(), kNone), 0,
                        std::vector<bool>(triangles.size()), kNoHalfEdge};
  std::vector<std::uint32_t> waiting;
  for (std::uint32_t seed = 0; seed < triangles.size(); ++seed) {
    if (components.of_triangle[seed] != kNone) continue;
    components.of_triangle[seed] = components.count;
    waiting.push_back(seed);
    while (!waiting.empty()) {
      const std::uint32_t t = waiting.back();
      waiting.pop_back();
      for (std::uint32_t h = 3 * t; h < 3 * t + 3; ++h) {
        const std::uint32_t mate = pairing.mates[h], other = mate / 3;
        // Neighbors agree if they run along their edge in opposite directions.
        const bool agrees = origin(triangles, h) == target(triangles, mate);
        const bool is_turned = components.is_turned[t] == agrees;
        if (components.of_triangle[other] == kNone) {
          components.of_triangle[other] = components.count;
          components.is_turned[other] = is_turned;
          waiting.push_back(other);
        } else if (components.is_turned[other] != is_turned) {
          components.conflict = std::min(components.conflict, h);
        }
      }
    }
    ++components.count;
  }
  return components;
}

void turn_triangles(const std::vector<bool>& is_turned, std::span<TriangleCorners> triangles,
                    EdgePairing& pairing) {
  // Corners 1 and 2 change places: the half-edge between them stays, the other two change places.
  const auto renumbered = [&](std::uint32_t h) {
    return is_turned[h / 3] ? h / 3 * 3 + (2 - h % 3) : h;
  };
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    if (!is_turned[t]) continue;
    std::swap(triangles[t][1], triangles[t][2]);
    std::swap(pairing.mates[3 * t], pairing.mates[3 * t + 2]);
  }
  for (std::uint32_t& mate : pairing.mates)
    if (mate != kNoHalfEdge) mate = renumbered(mate);
}

PinchedVertices find_pinched_vertices(std::size_t num_vertices,
                                      std::span<const TriangleCorners> triangles,
                                      const EdgePairing& pairing) {
  std::vector<std::uint32_t> num_triangles(num_vertices), outgoing(num_vertices, kNoHalfEdge);
  for (std::uint32_t h = 0; h < 3 * triangles.size(); ++h) {
    ++num_triangles[origin(triangles, h)];
    outgoing[origin(triangles, h)] = h;
  }
  PinchedVertices pinched;
  for (std::uint32_t v = 0; v < num_vertices; ++v) {
    if (outgoing[v] == kNoHalfEdge) continue;
    std::uint32_t fan = 0, h = outgoing[v];
    do {
      ++fan;
      h = pairing.mates[previous_half_edge(h)];
    } while (h != outgoing[v]);
    if (fan == num_triangles[v]) continue;
    if (pinched.count++ == 0) pinched.first = v;
  }
  return pinched;
}

}  // namespace locvol
