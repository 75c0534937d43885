#include "refine/leaf.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <utility>

#include "refine/cover_leaf.h"
#include "refine/delaunay.h"

namespace locvol {

Criteria Criteria::of_cover(double size, double radius_edge_bound, double spacing_floor,
                            double min_dihedral, double growth) {
  constexpr double kSlack = 1.01;
  return {.size = size,
          .radius_edge_bound = radius_edge_bound,
          .reach = reach_factor(growth, kReach) * size,
          .min_dihedral = min_dihedral,
          .spacing_floor = spacing_floor * size,
          .cover_radius = kSlack * sample_radius(growth == 0) * size};
}

Criteria Criteria::of_paper(double size, double radius_edge_bound, double spacing_floor,
                            double min_dihedral) {
  return {.size = size,
          .radius_edge_bound = radius_edge_bound,
          .reach = std::numeric_limits<double>::infinity(),
          .min_dihedral = min_dihedral,
          .spacing_floor = spacing_floor * size};
}

void CellList::name_vertices(std::vector<VertexRef> names) {
  std::vector<std::uint32_t> place(vertices.size());
  std::uint32_t next = 0;
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    while (next < names.size() && names[next] < vertices[v]) ++next;
    place[v] = next;
  }
  for (auto& cell : cells)
    for (std::uint32_t& v : cell) v = place[v];
  vertices = std::move(names);
}

void CellList::drop_unused_vertices() {
  std::vector<bool> is_used(vertices.size());
  for (const auto& cell : cells)
    for (const std::uint32_t v : cell) is_used[v] = true;
  std::vector<VertexRef> used;
  for (std::size_t v = 0; v < is_used.size(); ++v)
    if (is_used[v]) used.push_back(vertices[v]);
  name_vertices(std::move(used));
}

namespace {

using NumberedCell = std::array<std::uint32_t, 4>;  // indices into a list of vertices

// As lists have them: see CellList. REQUIRES: all are in `vertices`
NumberedCell numbered(const std::array<VertexRef, 4>& name,
                      const std::vector<VertexRef>& vertices) {
  NumberedCell cell;
  for (std::size_t k = 0; k < 4; ++k)
    cell[k] =
        static_cast<std::uint32_t>(std::ranges::lower_bound(vertices, name[k]) - vertices.begin());
  sort_oriented(cell);
  return cell;
}

[[noreturn]] void throw_not_so(const std::array<VertexRef, 4>& name, const char* what) {
  throw RefineError(
      fmt::format("the cell {} that another leaf changed is {}", fmt::join(name, ", "), what));
}

}  // namespace

void apply(const CellChanges& changes, CellList& list) {
  std::vector<VertexRef> vertices;
  std::ranges::set_union(list.vertices, distinct_vertices(changes.made),
                         std::back_inserter(vertices));
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

  list.name_vertices(vertices);
  std::vector<NumberedCell> kept, cells;
  std::ranges::set_difference(list.cells, gone, std::back_inserter(kept));
  std::ranges::set_union(kept, made, std::back_inserter(cells));
  if (changes.is_strict &&
      (kept.size() + gone.size() != list.cells.size() || cells.size() != kept.size() + made.size()))
    throw_not_so((changes.gone.empty() ? changes.made : changes.gone).front(),
                 "or one with it, not as was known");

  list.cells = std::move(cells);
  list.drop_unused_vertices();
}

}  // namespace locvol
