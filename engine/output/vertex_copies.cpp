#include "engine/output/vertex_copies.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>

#include "octree/sort_and_unite.h"

namespace locvol {
namespace {

// The copies that some items name; each item's vertices are then places among these.
// `vertices_of(item)`: a list of places, to be changed; `body_of(i)`: of the item
template <class Items, class VerticesOf, class BodyOf>
std::vector<BodyId> name_copies(std::vector<std::uint64_t>& ids, Items& items,
                                const VerticesOf& vertices_of, const BodyOf& body_of) {
  std::vector<VertexCopy> copies;
  for (std::size_t i = 0; i < items.size(); ++i)
    for (const std::uint32_t v : vertices_of(items[i])) copies.push_back({ids[v], body_of(i)});
  sort_and_unite(copies);
  for (std::size_t i = 0; i < items.size(); ++i)
    for (std::uint32_t& v : vertices_of(items[i])) {
      const auto copy = std::ranges::lower_bound(copies, VertexCopy{ids[v], body_of(i)});
      v = static_cast<std::uint32_t>(copy - copies.begin());
    }
  ids.clear();
  std::vector<BodyId> bodies;
  for (const auto& [id, body] : copies) {
    ids.push_back(id);
    bodies.push_back(body);
  }
  return bodies;
}

}  // namespace

CellsOfCopies with_copies(LeafCells cells) {
  CellsOfCopies result{std::move(cells), {}};
  LeafCells& of_copies = result.cells;
  result.bodies = name_copies(
      of_copies.vertices, of_copies.cells, [](auto& cell) -> auto& { return cell; },
      [&](std::size_t cell) { return of_copies.body_of(cell); });
  return result;
}

FacetsOfCopies with_copies(const LeafFacets& facets, const SheetSides& sides) {
  FacetsOfCopies result{{facets.vertices, {}}, {}};
  std::vector<MeshFacet>& all = result.facets.facets;
  for (const MeshFacet& facet : facets.facets) {
    all.push_back(facet);
    const auto& [behind, before, sheet] = facet.labels;
    if (before == kNoBody) continue;
    const auto& [a, b, c] = facet.vertices;
    all.push_back({{a, c, b}, {before, behind, sides.other_side(sheet)}});
  }
  result.bodies = name_copies(
      result.facets.vertices, all, [](MeshFacet & facet) -> auto& { return facet.vertices; },
      [&](std::size_t facet) { return all[facet].labels.behind; });
  return result;
}

SheetSides::SheetSides(const SurfaceSheets& sheets) : sheets_(sheets) {
  for (std::size_t s = 0; s < sheets.sheets.size(); ++s) {
    const SheetFacts& sheet = sheets.sheets[s];
    const auto& [behind, before] = sheet.bodies;
    other_side_.push_back(static_cast<SheetId>(s + 1));
    if (before == kNoBody || behind > sheets.bodies.size()) continue;
    const auto side = [&](BodyId body) {
      SheetFacts facts = sheet;
      facts.name += " of " + sheets.bodies[body - 1].name;
      facts.bodies = {body, kNoBody};
      return facts;
    };
    sheets_.sheets.push_back(side(before));
    sheets_.sheets[s] = side(behind);
    other_side_.back() = static_cast<SheetId>(sheets_.sheets.size());
  }
}

SheetId SheetSides::other_side(SheetId sheet) const {
  return sheet == 0 || sheet > other_side_.size() ? sheet : other_side_[sheet - 1];
}

}  // namespace locvol
