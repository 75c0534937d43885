#include "refine/leaf.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <utility>

#include "octree/sort_and_unite.h"
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

template <class List>
void name_vertices(List& list, std::vector<VertexRef> names) {
  std::vector<std::uint32_t> place(list.vertices.size());
  std::uint32_t next = 0;
  for (std::size_t v = 0; v < list.vertices.size(); ++v) {
    while (next < names.size() && names[next] < list.vertices[v]) ++next;
    place[v] = next;
  }
  for (auto& item : items_of(list))
    for (std::uint32_t& v : vertices_in(item)) v = place[v];
  list.vertices = std::move(names);
}

template <class List>
void drop_unused_vertices(List& list) {
  std::vector<bool> is_used(list.vertices.size());
  for (const auto& item : items_of(list))
    for (const std::uint32_t v : vertices_in(item)) is_used[v] = true;
  std::vector<VertexRef> used;
  for (std::size_t v = 0; v < is_used.size(); ++v)
    if (is_used[v]) used.push_back(list.vertices[v]);
  name_vertices(list, std::move(used));
}

namespace {

std::uint32_t place_of(VertexRef name, const std::vector<VertexRef>& vertices) {
  return static_cast<std::uint32_t>(std::ranges::lower_bound(vertices, name) - vertices.begin());
}

// As lists have them. REQUIRES: all vertices are in `vertices`
MeshCell numbered(const NamedCell& name, const std::vector<VertexRef>& vertices) {
  MeshCell cell{.vertices = {}, .body = name.body};
  for (std::size_t k = 0; k < cell.vertices.size(); ++k)
    cell.vertices[k] = place_of(name.vertices[k], vertices);
  sort_oriented(cell.vertices);
  return cell;
}
MeshFacet numbered(const NamedFacet& name, const std::vector<VertexRef>& vertices) {
  const auto& [a, b, c] = name.vertices;
  return {smallest_first(
              std::array{place_of(a, vertices), place_of(b, vertices), place_of(c, vertices)}),
          name.labels};
}

[[noreturn]] void throw_not_so(const auto& name, const char* what) {
  throw RefineError(fmt::format("the cell or facet {} that another leaf changed is {}",
                                fmt::join(vertices_in(name), ", "), what));
}

template <class Name>
std::vector<VertexRef> distinct_vertices_of(const std::vector<Name>& names) {
  std::vector<VertexRef> vertices;
  for (const Name& name : names)
    vertices.insert(vertices.end(), vertices_in(name).begin(), vertices_in(name).end());
  sort_and_unite(vertices);
  return vertices;
}

}  // namespace

template <class List>
void apply(const Changes<List>& changes, List& list) {
  using Item = typename List::Item;
  std::vector<VertexRef> vertices;
  std::ranges::set_union(list.vertices, distinct_vertices_of(changes.made),
                         std::back_inserter(vertices));
  std::vector<Item> gone, made;
  for (const auto& name : changes.gone) {
    const bool is_named = std::ranges::all_of(
        vertices_in(name), [&](VertexRef v) { return std::ranges::binary_search(vertices, v); });
    if (is_named)
      gone.push_back(numbered(name, vertices));
    else if (changes.is_strict)
      throw_not_so(name, "not listed");
  }
  for (const auto& name : changes.made) made.push_back(numbered(name, vertices));
  std::ranges::sort(gone);
  std::ranges::sort(made);

  name_vertices(list, vertices);
  auto& items = items_of(list);
  std::vector<Item> kept, all;
  std::ranges::set_difference(items, gone, std::back_inserter(kept));
  std::ranges::set_union(kept, made, std::back_inserter(all));
  if (changes.is_strict &&
      (kept.size() + gone.size() != items.size() || all.size() != kept.size() + made.size()))
    throw_not_so((changes.gone.empty() ? changes.made : changes.gone).front(),
                 "or one with it, not as was known");

  items = std::move(all);
  drop_unused_vertices(list);
}

template void name_vertices(CellList&, std::vector<VertexRef>);
template void name_vertices(FacetList&, std::vector<VertexRef>);
template void drop_unused_vertices(CellList&);
template void drop_unused_vertices(FacetList&);
template void apply(const Changes<CellList>&, CellList&);
template void apply(const Changes<FacetList>&, FacetList&);

}  // namespace locvol
