#include "refine/crease_segments.h"

#include <algorithm>
#include <utility>

#include "refine/crease_graph.h"

namespace locvol {
namespace {

std::vector<Point> way_to(const CreaseGraph& graph, CreaseGraph::Index point,
                          const CreaseGraph::Neighbor& neighbor) {
  std::vector<Point> way = {graph.point(point)};
  graph.for_each_part(neighbor.heading, neighbor.along,
                      [&](const Point&, const Point& end, double) { way.push_back(end); });
  return way;
}

}  // namespace

std::vector<CreaseSegment> crease_segments(DomainPiece piece, std::span<const Point> points,
                                           double size) {
  const LeafDomain domain(std::move(piece));
  CreaseGraph graph(domain);
  std::vector<std::uint32_t> place_of;  // of the graph's points
  for (std::uint32_t i = 0; i < points.size(); ++i)
    if (graph.add(points[i], kOffCrease * size)) place_of.push_back(i);
  std::vector<CreaseSegment> segments;
  std::vector<CreaseGraph::Neighbor> neighbors;
  for (CreaseGraph::Index i = 0; i < graph.num_points(); ++i) {
    graph.neighbors(i, neighbors);
    for (const CreaseGraph::Neighbor& neighbor : neighbors) {
      const auto& [other, along, heading] = neighbor;
      if (other == CreaseGraph::kNone || place_of[other] <= place_of[i]) continue;
      segments.push_back({{place_of[i], place_of[other]},
                          along,
                          graph.edges()[heading.from.edge].crease,
                          way_to(graph, i, neighbor)});
    }
  }
  std::ranges::sort(segments);
  const auto longer = std::ranges::unique(segments, {}, &CreaseSegment::points);
  segments.erase(longer.begin(), longer.end());
  return segments;
}

}  // namespace locvol
