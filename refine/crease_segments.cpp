#include "refine/crease_segments.h"

#include <algorithm>
#include <utility>

#include "octree/sort_and_unite.h"
#include "refine/crease_graph.h"

namespace locvol {

std::vector<CreaseSegment> crease_segments(DomainPiece piece, std::span<const Point> points,
                                           double size) {
  constexpr double kTolerance = 1e-6;  // as refinement has it
  const LeafDomain domain(std::move(piece));
  CreaseGraph graph(domain);
  std::vector<std::uint32_t> place_of;  // of the graph's points
  for (std::uint32_t i = 0; i < points.size(); ++i)
    if (graph.add(points[i], kTolerance * size)) place_of.push_back(i);
  std::vector<CreaseSegment> segments;
  std::vector<CreaseGraph::Neighbor> neighbors;
  for (CreaseGraph::Index i = 0; i < graph.num_points(); ++i) {
    graph.neighbors(i, neighbors);
    for (const auto& [other, along, heading] : neighbors) {
      if (other == CreaseGraph::kNone || place_of[other] <= place_of[i]) continue;
      segments.push_back(
          {{place_of[i], place_of[other]}, graph.edges()[heading.from.edge].crease, along});
    }
  }
  std::ranges::sort(segments);
  sort_and_unite(segments, &CreaseSegment::points);
  return segments;
}

}  // namespace locvol
