#include "engine/ingest/surface_topology.h"

#include <utility>

namespace locvol {

// A counting sort by the edge's smaller vertex.
EdgeTable::EdgeTable(std::size_t num_vertices, std::span<const TriangleCorners> triangles)
    : begin_(num_vertices + 1), uses_(3 * triangles.size()) {
  const auto edge = [&](std::uint32_t h) -> std::pair<std::uint32_t, std::uint32_t> {
    return std::minmax({origin(triangles, h), target(triangles, h)});
  };
  for (std::uint32_t h = 0; h < uses_.size(); ++h) ++begin_[edge(h).first];
  std::uint32_t sum = 0;
  for (std::uint32_t& b : begin_) b = (sum += b);
  for (auto h = static_cast<std::uint32_t>(uses_.size()); h-- > 0;) {
    const auto [v, w] = edge(h);
    uses_[--begin_[v]] = {w, h};
  }
}

Mates paired_edges(std::size_t num_vertices, std::span<const TriangleCorners> triangles) {
  Mates mates(3 * triangles.size(), kNoHalfEdge);
  EdgeTable(num_vertices, triangles).for_each_edge([&](std::span<const std::uint32_t> uses) {
    if (uses.size() != 2) return;
    mates[uses[0]] = uses[1];
    mates[uses[1]] = uses[0];
  });
  return mates;
}

Mates paired_edges(std::size_t num_vertices, std::span<const TriangleCorners> triangles,
                   std::span<const std::uint32_t> body_of) {
  Mates mates(3 * triangles.size(), kNoHalfEdge);
  std::vector<std::uint32_t> scratch;
  EdgeTable(num_vertices, triangles).for_each_edge([&](std::span<const std::uint32_t> uses) {
    const auto body = [&](std::uint32_t h) { return body_of[h / 3]; };
    for_each_body_at(uses, body, scratch, [&](std::span<const std::uint32_t> own) {
      if (own.size() != 2) return;
      mates[own[0]] = own[1];
      mates[own[1]] = own[0];
    });
  });
  return mates;
}

Components find_components(std::span<const TriangleCorners> triangles,
                           std::span<const std::uint32_t> mates) {
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
        const std::uint32_t mate = mates[h], other = mate / 3;
        if (mate == kNoHalfEdge) continue;
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
                    std::span<std::uint32_t> mates) {
  // Corners 1 and 2 change places: the half-edge between them stays, the other two change places.
  const auto renumbered = [&](std::uint32_t h) {
    return is_turned[h / 3] ? h / 3 * 3 + (2 - h % 3) : h;
  };
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    if (!is_turned[t]) continue;
    std::swap(triangles[t][1], triangles[t][2]);
    std::swap(mates[3 * t], mates[3 * t + 2]);
  }
  for (std::uint32_t& mate : mates)
    if (mate != kNoHalfEdge) mate = renumbered(mate);
}

std::uint32_t fan_around(std::span<const TriangleCorners> triangles,
                         std::span<const std::uint32_t> mates, std::uint32_t h) {
  std::uint32_t count = 0;
  return for_each_in_fan(triangles, mates, h, [&](std::uint32_t) { ++count; }) ? count : 0;
}

}  // namespace locvol
