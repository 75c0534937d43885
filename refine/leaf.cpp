#include "refine/leaf.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <utility>

#include "refine/delaunay.h"

#include "refine/cover_leaf.h"

namespace locvol {

Criteria Criteria::of_cover(double size, double radius_edge_bound, double spacing_floor) {
  constexpr double kSlack = 1.01;
  return {.size = size,
          .radius_edge_bound = radius_edge_bound,
          .reach = kReach * size,
          .spacing_floor = spacing_floor * size,
          .cover_radius = kSlack * kSampleRadius * size};
}

Criteria Criteria::of_paper(double size, double radius_edge_bound, double spacing_floor) {
  return {.size = size,
          .radius_edge_bound = radius_edge_bound,
          .reach = std::numeric_limits<double>::infinity(),
          .spacing_floor = spacing_floor * size};
}

namespace {

using NumberedCell = std::array<std::uint32_t, 4>;  // indices into a list of vertices

// Of names: the sorted ones, once each.
std::vector<VertexRef> vertices_of(const std::vector<std::array<VertexRef, 4>>& cells) {
  std::vector<VertexRef> vertices;
  for (const auto& cell : cells) vertices.insert(vertices.end(), cell.begin(), cell.end());
  std::ranges::sort(vertices);
  const auto repeated = std::ranges::unique(vertices);
  vertices.erase(repeated.begin(), repeated.end());
  return vertices;
}

// As lists have them: see CellList. REQUIRES: all are in `vertices`
NumberedCell numbered(const std::array<VertexRef, 4>& name,
                      const std::vector<VertexRef>& vertices) {
  NumberedCell cell;
  for (std::size_t k = 0; k < 4; ++k)
    cell[k] = static_cast<std::uint32_t>(std::ranges::lower_bound(vertices, name[k]) -
                                         vertices.begin());
  if (sort_oddly(cell)) std::swap(cell[2], cell[3]);
  return cell;
}

[[noreturn]] void throw_not_so(const std::array<VertexRef, 4>& name, const char* what) {
  throw RefineError(fmt::format("the cell {} that another leaf changed is {}",
                                fmt::join(name, ", "), what));
}

}  // namespace

void apply(const CellChanges& changes, CellList& list) {
  std::vector<VertexRef> vertices;
  std::ranges::set_union(list.vertices, vertices_of(changes.made), std::back_inserter(vertices));
  std::vector<NumberedCell> gone, made;
  for (const auto& name : changes.gone) {
    const bool is_named = std::ranges::all_of(
        name, [&](VertexRef v) { return std::ranges::binary_search(vertices, v); });
    if (is_named)
      gone.push_back(numbered(name, vertices));
    else if (changes.is_strict)
      throw_not_so(name, "not listed");
  }
  for (const auto& name : changes.made) made.push_back(numbered(name, vertices));
  std::ranges::sort(gone);
  std::ranges::sort(made);

  std::vector<std::uint32_t> place;  // of the list's vertices
  place.reserve(list.vertices.size());
  for (std::size_t n = 0; const VertexRef v : list.vertices) {
    while (vertices[n] != v) ++n;
    place.push_back(static_cast<std::uint32_t>(n));
  }
  for (NumberedCell& cell : list.cells)
    for (std::uint32_t& v : cell) v = place[v];
  std::vector<NumberedCell> kept, cells;
  std::ranges::set_difference(list.cells, gone, std::back_inserter(kept));
  std::ranges::set_union(kept, made, std::back_inserter(cells));
  if (changes.is_strict && (kept.size() + gone.size() != list.cells.size() ||
                            cells.size() != kept.size() + made.size()))
    throw_not_so((changes.gone.empty() ? changes.made : changes.gone).front(),
                 "or one with it, not as was known");

  std::vector<bool> is_used(vertices.size());
  for (const NumberedCell& cell : cells)
    for (const std::uint32_t v : cell) is_used[v] = true;
  list.vertices.clear();
  place.resize(vertices.size());
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    if (!is_used[v]) continue;
    place[v] = static_cast<std::uint32_t>(list.vertices.size());
    list.vertices.push_back(vertices[v]);
  }
  for (NumberedCell& cell : cells)
    for (std::uint32_t& v : cell) v = place[v];
  list.cells = std::move(cells);
}

}  // namespace locvol
