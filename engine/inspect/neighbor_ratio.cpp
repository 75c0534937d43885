#include "engine/inspect/neighbor_ratio.h"

#include <algorithm>

#include "engine/output/leaf_window.h"
#include "engine/shared/leaf_facets.h"

namespace locvol {
namespace {

constexpr std::size_t kOpenBytes = std::size_t{8} << 20;

double ratio_of(double a, double b) { return a < b ? b / a : a / b; }

}  // namespace

LeafNeighbors leaf_neighbors(const LeafCells& cells, std::span<const double> radii) {
  std::vector<ListedFacet> facets;
  facets.reserve(4 * cells.cells.size());
  for (std::uint32_t cell = 0; cell < cells.cells.size(); ++cell)
    for (std::uint32_t across = 0; across < 4; ++across)
      facets.push_back(listed_facet(cells.cells[cell], cell, across));
  LeafNeighbors result;
  for_each_facet(facets, cells.vertices.size(), [&](std::span<const ListedFacet> same) {
    const double radius = radii[same.front().side.cell];
    if (same.size() > 1) {
      result.most = std::max(result.most, ratio_of(radius, radii[same.back().side.cell]));
      return;
    }
    const auto& [a, b, c] = same.front().vertices;
    result.open.push_back({{cells.vertices[a], cells.vertices[b], cells.vertices[c]}, radius});
  });
  return result;
}

void NeighborRatio::add(const LeafNeighbors& leaf) {
  open_.append(leaf.open);
  most_ = std::max(most_, leaf.most);
}

LeafList<OpenFacet> NeighborRatio::list(std::size_t leaf) const {
  const auto told = told_.find(leaf);
  return told == told_.end() ? open_.list(leaf) : LeafList<OpenFacet>{told->second};
}

double NeighborRatio::ratio(const std::function<std::vector<std::size_t>(std::size_t leaf)>& near,
                            const StopToken* stop) const {
  double most = most_;
  LeafWindow<LeafList<OpenFacet>> lists(kOpenBytes, [&](std::size_t leaf) { return list(leaf); });
  for (std::size_t leaf = 0; leaf < open_.num_leaves(); ++leaf) {
    throw_if_stopped(stop);
    if (!has_open(leaf)) continue;
    const auto here = lists.get(leaf);
    for (const std::size_t other : near(leaf)) {
      if (other <= leaf || !has_open(other)) continue;
      const auto theirs = lists.get(other);
      auto place = theirs->values.begin();
      for (const OpenFacet& facet : here->values) {
        place = std::ranges::lower_bound(place, theirs->values.end(), facet.vertices, {},
                                         &OpenFacet::vertices);
        if (place == theirs->values.end()) break;
        if (place->vertices == facet.vertices)
          most = std::max(most, ratio_of(facet.radius, place->radius));
      }
    }
  }
  return most;
}

}  // namespace locvol
