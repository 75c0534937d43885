#include "refine/vertex_link.h"

#include <algorithm>
#include <map>

namespace locvol {

std::optional<LinkPath> path_of(std::span<const LinkEdge> edges) {
  std::map<Delaunay::Vertex, int> degrees;
  for (const auto& [a, b] : edges) ++degrees[a], ++degrees[b];
  LinkPath path{};
  std::size_t num_ends = 0;
  for (const auto& [v, degree] : degrees) {
    if (degree > 2) return std::nullopt;
    if (degree == 2)
      path.between.push_back(v);
    else if (num_ends < 2)
      path.ends[num_ends++] = v;
    else
      return std::nullopt;
  }
  // With two ends and no vertex of three edges, what is not on the path between them is cycles.
  if (num_ends != 2) return std::nullopt;
  std::size_t length = 0;
  for (Delaunay::Vertex at = path.ends[0], from = at; length < edges.size(); ++length) {
    const auto next = std::ranges::find_if(edges, [&](const LinkEdge& e) {
      return (e.a == at && e.b != from) || (e.b == at && e.a != from);
    });
    if (next == edges.end()) break;
    from = std::exchange(at, next->a == at ? next->b : next->a);
  }
  return length == edges.size() ? std::optional(path) : std::nullopt;
}

}  // namespace locvol
