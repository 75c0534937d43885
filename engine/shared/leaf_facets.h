// The facets of the cells that a leaf lists, each found once.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace locvol {

// Of a positively oriented cell, across from each vertex: counterclockwise from outside.
inline constexpr std::array<std::array<std::uint8_t, 3>, 4> kFacets{
    {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}}};

struct ListedFacet {
  std::array<std::uint32_t, 3> vertices{};  // places in the leaf's list, ascending
  struct Side {
    std::uint32_t cell = 0, across = 0;  // from which of its vertices
  } side;
};

inline ListedFacet listed_facet(const std::array<std::uint32_t, 4>& vertices, std::uint32_t cell,
                                std::uint32_t across) {
  const auto& [a, b, c] = kFacets[across];
  ListedFacet facet{{vertices[a], vertices[b], vertices[c]}, {cell, across}};
  std::ranges::sort(facet.vertices);
  return facet;
}

// Calls visit(facets) for those with the same vertices: one or two, of one mesh. They are sorted by
// the smallest vertex first, in linear time: then only a few dozen at a time are left to sort.
template <class Visit>
void for_each_facet(std::span<const ListedFacet> facets, std::size_t num_vertices,
                    const Visit& visit) {
  std::vector<std::uint32_t> ends(num_vertices + 1);
  for (const ListedFacet& facet : facets) ++ends[facet.vertices[0] + 1];
  for (std::size_t i = 1; i < ends.size(); ++i) ends[i] += ends[i - 1];
  const std::vector<std::uint32_t> starts = ends;
  std::vector<ListedFacet> sorted(facets.size());
  for (const ListedFacet& facet : facets) sorted[ends[facet.vertices[0]]++] = facet;

  const auto others = [](const ListedFacet& f) {
    return std::uint64_t{f.vertices[1]} << 32 | f.vertices[2];
  };
  for (std::size_t v = 0; v < num_vertices; ++v) {
    const auto at_vertex = std::span(sorted).subspan(starts[v], starts[v + 1] - starts[v]);
    std::ranges::sort(at_vertex, {}, others);
    for (auto first = at_vertex.begin(); first != at_vertex.end();) {
      const auto last = std::find_if(first, at_vertex.end(), [&](const ListedFacet& f) {
        return others(f) != others(*first);
      });
      visit(std::span<const ListedFacet>(first, last));
      first = last;
    }
  }
}

}  // namespace locvol
