#include "engine/output/boundary_surface.h"

#include <algorithm>
#include <cassert>
#include <iterator>
#include <string>
#include <utility>

#include "engine/shared/encode_in_order.h"
#include "engine/shared/leaf_facets.h"
#include "engine/shared/leaf_name.h"
#include "octree/sort_and_unite.h"

namespace locvol {
namespace {

constexpr std::size_t kOpenFacetBytes = std::size_t{8} << 20, kVertexBytes = std::size_t{4} << 20;
constexpr std::uint64_t kItemsAtOnce = std::uint64_t{1} << 14;

// Tells of most numbers that are not among some that they are not, at the price of a bit.
class MarkedNumbers {
 public:
  explicit MarkedNumbers(const std::vector<std::int64_t>& numbers) : marks_(kNumMarks) {
    for (const std::int64_t number : numbers)
      if (number >= 0) marks_[static_cast<std::uint64_t>(number) % kNumMarks] = true;
  }
  bool may_have(std::uint64_t number) const { return marks_[number % kNumMarks]; }

 private:
  static constexpr std::uint64_t kNumMarks = std::uint64_t{1} << 16;
  std::vector<bool> marks_;
};

// A vertex on a sheet as one number, in order of vertices first. A mesh has fewer vertices than
// 2^48, and fewer sheets than 2^16.
constexpr int kSheetBits = 16;
std::uint64_t on_sheet(std::uint64_t vertex, SheetId sheet) { return vertex << kSheetBits | sheet; }
std::uint64_t vertex_in(std::uint64_t on_sheet) { return on_sheet >> kSheetBits; }
SheetId sheet_in(std::uint64_t on_sheet) {
  return static_cast<SheetId>(on_sheet & ((std::uint64_t{1} << kSheetBits) - 1));
}

}  // namespace

BoundarySurface::BoundarySurface(const Reader& reader, const VertexNumbering& numbering,
                                 VertexPositions& positions, const std::filesystem::path& output,
                                 PageRelease& pages, Workers& workers, const StopToken* stop,
                                 Exchange& exchange)
    : reader_(&reader),
      numbering_(&numbering),
      positions_(&positions),
      output_(output),
      pages_(&pages),
      stop_(stop),
      exchange_(exchange),
      num_sheets_(static_cast<SheetId>(std::max<std::size_t>(
          1, numbering.sides() != nullptr ? numbering.sides()->sheets().sheets.size()
                                          : reader.sheets().sheets.size()))),
      facets_(output) {
  find_facets(workers);
}

std::vector<BoundarySurface::ListedFacet> BoundarySurface::load_facets(std::size_t leaf,
                                                                       NumberWindow& numbers) {
  const auto [listed, number] = numbers.facets(leaf);
  pages_->count(sizeof(listed.facets[0]) * listed.facets.size());
  std::vector<ListedFacet> facets;
  facets.reserve(listed.facets.size());
  for (const auto& [vertices, labels] : listed.facets) {
    for (const std::uint32_t v : vertices)
      if (number[v] < 0)
        throw CorruptRecord(leaf_name(numbering_->leaves()[leaf]) + ": a facet has the point " +
                                std::to_string(listed.vertices[v]) + ", which is not of the mesh",
                            numbering_->leaves()[leaf]);
    std::array<std::uint64_t, 3> corners;
    std::ranges::transform(vertices, corners.begin(),
                           [&](std::uint32_t v) { return static_cast<std::uint64_t>(number[v]); });
    facets.push_back({smallest_first(corners), labels});
  }
  std::ranges::sort(facets, {}, &ListedFacet::key);
  return facets;
}

std::vector<std::uint64_t> BoundarySurface::flat(std::span<const ListedFacet> facets) {
  std::vector<std::uint64_t> values;
  for (const auto& [vertices, labels] : facets)
    values.insert(values.end(), {vertices[0], vertices[1], vertices[2], labels.behind,
                                 labels.before, labels.sheet});
  return values;
}

std::vector<BoundarySurface::ListedFacet> BoundarySurface::facets_in(
    std::span<const std::uint64_t> values) {
  std::vector<ListedFacet> facets;
  for (; values.size() >= 6; values = values.subspan(6))
    facets.push_back({{values[0], values[1], values[2]},
                      {static_cast<BodyId>(values[3]), static_cast<BodyId>(values[4]),
                       static_cast<SheetId>(values[5])}});
  return facets;
}

// In the order of the cells. Most have no three vertices on the boundary.
std::vector<BoundaryFacet> BoundarySurface::facets_of_cells(const CellsAndFacets& near) {
  std::vector<std::uint64_t> on_boundary;
  for (const ListedFacet& facet : near.facets)
    on_boundary.insert(on_boundary.end(), facet.vertices.begin(), facet.vertices.end());
  sort_and_unite(on_boundary);
  std::vector<bool> is_on_boundary(near.numbers.size());
  for (std::size_t v = 0; v < near.numbers.size(); ++v)
    is_on_boundary[v] =
        near.numbers[v] >= 0 &&
        std::ranges::binary_search(on_boundary, static_cast<std::uint64_t>(near.numbers[v]));
  std::vector<BoundaryFacet> found;
  for (std::uint32_t c = 0; c < near.cells.size(); ++c) {
    const auto& cell = near.cells[c];
    if (std::ranges::count_if(cell, [&](std::uint32_t v) { return is_on_boundary[v]; }) < 3)
      continue;
    for (std::uint32_t across = 0; across < 4; ++across) {
      const auto& corners = kFacets[across];
      if (!std::ranges::all_of(corners, [&](auto k) { return is_on_boundary[cell[k]]; })) continue;
      ListedFacet facet{};
      for (std::size_t k = 0; k < 3; ++k)
        facet.vertices[k] = static_cast<std::uint64_t>(near.numbers[cell[corners[k]]]);
      facet.vertices = smallest_first(facet.vertices);
      const auto listed = std::ranges::lower_bound(near.facets, facet.key(), {}, &ListedFacet::key);
      if (listed != near.facets.end() && listed->vertices == facet.vertices)
        found.push_back({facet.vertices, near.first_cell + c, across, listed->labels});
    }
  }
  return found;
}

void BoundarySurface::take_listed_facets() {
  NumberWindow numbers(*reader_, *numbering_);
  for (std::size_t leaf = numbering_->first_own(); leaf < numbering_->end_own(); ++leaf) {
    throw_if_stopped(stop_);
    std::uint64_t next = numbering_->first_cell(leaf);
    std::vector<BoundaryFacet> facets;
    for (const auto& [vertices, labels] : load_facets(leaf, numbers))
      facets.push_back({vertices, next++, 0, labels});
    facets_.append(facets);
  }
  num_facets_ = sum(exchange_, facets_.size());
}

void BoundarySurface::find_facets(Workers& workers) {
  if (numbering_->is_surface_only()) return take_listed_facets();
  const std::size_t first_own = numbering_->first_own(), end_own = numbering_->end_own();
  // Of own leaves, and then of those beside them, each by key.
  LeafLists<ListedFacet> listed(output_);
  NumberWindow numbers(*reader_, *numbering_);
  for (std::size_t leaf = first_own; leaf < end_own; ++leaf) {
    throw_if_stopped(stop_);
    listed.append(load_facets(leaf, numbers));
  }
  const std::uint64_t num_listed = listed.size();
  std::map<std::size_t, std::size_t> beside;  // places of their lists
  numbering_->tell_ranks_beside(
      *reader_, exchange_, kCellReach,
      [&](std::size_t leaf) { return flat(listed.list(leaf - first_own).values); },
      [&](std::size_t leaf, const std::vector<std::uint64_t>& values) {
        beside[leaf] = listed.num_leaves();
        listed.append(facets_in(values));
      });

  LeafWindow<LeafList<ListedFacet>> lists(kOpenFacetBytes,
                                          [&](std::size_t list) { return listed.list(list); });
  std::size_t next = first_own;
  encode_in_order(
      workers,
      [&]() -> std::optional<CellsAndFacets> {
        if (next == end_own) return std::nullopt;
        throw_if_stopped(stop_);
        const std::size_t leaf = next++;
        std::vector<std::size_t> near;  // lists that are not empty
        for (const std::size_t other : numbering_->near(leaf, kCellReach))
          if (const auto list = place_of_list(other, beside); list && listed.length(*list) > 0)
            near.push_back(*list);
        CellsAndFacets result{numbering_->first_cell(leaf), {}, {}, {}};
        if (near.empty()) return result;
        NumberWindow::Cells cells = numbers.cells(leaf);
        result.numbers = std::move(cells.numbers);
        result.cells = std::move(cells.cells.cells);
        pages_->count(sizeof(result.cells[0]) * result.cells.size());
        const MarkedNumbers vertices(result.numbers);
        for (const std::size_t list : near)
          std::ranges::copy_if(
              lists.get(list)->values, std::back_inserter(result.facets),
              [&](const auto& corners) {
                return std::ranges::all_of(corners, [&](auto v) { return vertices.may_have(v); });
              },
              &ListedFacet::vertices);
        std::ranges::sort(result.facets, {}, &ListedFacet::key);
        return result;
      },
      facets_of_cells, [&](std::vector<BoundaryFacet> facets) { facets_.append(facets); });
  num_facets_ = sum(exchange_, facets_.size());
  if (num_facets_.all != sum(exchange_, num_listed).all)
    throw StoreError("the store is damaged: its boundary facets are not those of its cells");
}

std::optional<std::size_t> BoundarySurface::place_of_list(
    std::size_t leaf, const std::map<std::size_t, std::size_t>& beside) const {
  if (numbering_->first_own() <= leaf && leaf < numbering_->end_own())
    return leaf - numbering_->first_own();
  const auto found = beside.find(leaf);
  return found == beside.end() ? std::nullopt : std::optional(found->second);
}

std::vector<std::uint64_t> BoundarySurface::vertices_of_facets(std::size_t leaf) const {
  std::vector<std::uint64_t> vertices;
  for (const BoundaryFacet& facet : facets_of_leaf(leaf))
    for (const std::uint64_t vertex : facet.vertices)
      vertices.push_back(on_sheet(vertex, facet.labels.sheet));
  sort_and_unite(vertices);
  return vertices;
}

void BoundarySurface::find_vertices() {
  const std::size_t first_own = numbering_->first_own(), end_own = numbering_->end_own();
  // That facets of a leaf's cells name: of own leaves, and then of those beside them.
  LeafLists<std::uint64_t> named(output_);
  std::map<std::size_t, std::size_t> beside;  // places of their lists
  for (std::size_t leaf = first_own; leaf < end_own; ++leaf) {
    throw_if_stopped(stop_);
    named.append(vertices_of_facets(leaf));
  }
  const auto list_of = [&](std::size_t leaf) { return named.list(leaf - first_own).values; };
  numbering_->tell_ranks_beside(*reader_, exchange_, kCellReach, list_of,
                                [&](std::size_t leaf, const std::vector<std::uint64_t>& values) {
                                  beside[leaf] = named.num_leaves();
                                  named.append(values);
                                });

  vertices_.emplace(output_);
  if (num_sheets_ > 1) vertices_by_sheet_.emplace(output_, num_sheets_);
  LeafWindow<LeafList<std::uint64_t>> lists(kOpenFacetBytes,
                                            [&](std::size_t list) { return named.list(list); });
  for (std::size_t leaf = first_own; leaf < end_own; ++leaf) {
    throw_if_stopped(stop_);
    const std::uint64_t first = numbering_->first_vertex(leaf),
                        end = numbering_->first_vertex(leaf + 1);
    std::vector<std::uint64_t> vertices;
    if (first < end) {
      for (const std::size_t other : numbering_->near(leaf, kCellReach)) {
        const auto list = place_of_list(other, beside);
        if (!list || named.length(*list) == 0) continue;
        const auto theirs = lists.get(*list);
        const auto begin = std::ranges::lower_bound(theirs->values, on_sheet(first, 0));
        vertices.insert(vertices.end(), begin,
                        std::ranges::lower_bound(theirs->values, on_sheet(end, 0)));
      }
    }
    sort_and_unite(vertices);
    for (std::uint64_t& vertex : vertices) {
      if (vertices_by_sheet_) vertices_by_sheet_->append(sheet_in(vertex), vertex_in(vertex));
      vertex = vertex_in(vertex);
    }
    vertices.erase(std::ranges::unique(vertices).begin(), vertices.end());
    vertices_->append(vertices);
  }
  if (vertices_by_sheet_) vertices_by_sheet_->finish(exchange_);
  end_own_vertex_ = vertices_->size();
  num_vertices_ = sum(exchange_, end_own_vertex_);
  numbering_->tell_ranks_beside(
      *reader_, exchange_, kCellReach,
      [&](std::size_t leaf) {
        const std::size_t own = leaf - first_own;
        std::vector<std::uint64_t> told = vertices_->list(own).values;
        told.insert(told.begin(), num_vertices_.before + vertices_->first(own));
        return told;
      },
      [&](std::size_t leaf, const std::vector<std::uint64_t>& told) {
        vertices_beside_[leaf] = {vertices_->num_leaves(), told.front()};
        vertices_->append(std::span(told).subspan(1));
      });
  vertices_near_.emplace(kVertexBytes, [this](std::size_t list) { return vertices_->list(list); });
}

std::uint64_t BoundarySurface::num_vertices() {
  if (!vertices_) find_vertices();
  return num_vertices_.all;
}

std::uint64_t BoundarySurface::place_of(std::uint64_t vertex) {
  const std::size_t leaf = numbering_->leaf_of(vertex), first_own = numbering_->first_own();
  const bool is_own = first_own <= leaf && leaf < numbering_->end_own();
  const auto beside = is_own ? vertices_beside_.end() : vertices_beside_.find(leaf);
  if (!is_own && beside == vertices_beside_.end())
    throw CorruptRecord(leaf_name(numbering_->leaves()[leaf]) + ": a facet far away has its vertex",
                        numbering_->leaves()[leaf]);
  const std::size_t of_leaf = is_own ? leaf - first_own : beside->second.list;
  const std::uint64_t first =
      is_own ? num_vertices_.before + vertices_->first(of_leaf) : beside->second.first_place;
  const auto list = vertices_near_->get(of_leaf);
  const auto place = std::ranges::lower_bound(list->values, vertex);
  return first + static_cast<std::uint64_t>(place - list->values.begin());
}

std::function<std::optional<BoundarySurface::Facets>()> BoundarySurface::facets(
    const FacetParts& parts) {
  assert(!parts.has_places || vertices_);
  return [this, parts, first = std::uint64_t{0}]() mutable -> std::optional<Facets> {
    const std::uint64_t count = std::min(kItemsAtOnce, facets_.size() - first);
    if (count == 0) return std::nullopt;
    Facets some{num_facets_.before + first, facets_.read(first, count), {}, {}, {}};
    complete(parts, some);
    first += count;
    return some;
  };
}

void BoundarySurface::complete(const FacetParts& parts, Facets& some) {
  for (const BoundaryFacet& facet : some.facets) {
    const auto& [a, b, c] = facet.vertices;
    if (parts.has_corners)
      some.corners.push_back({positions_->of(a), positions_->of(b), positions_->of(c)});
    if (parts.has_places) some.places.push_back({place_of(a), place_of(b), place_of(c)});
    if (number_of_node_)
      some.nodes.push_back({number_of_node_(edge_between(a, b)),
                            number_of_node_(edge_between(b, c)),
                            number_of_node_(edge_between(c, a))});
  }
}

void BoundarySurface::sort_facets() {
  if (facets_by_sheet_ || num_sheets_ == 1) return;
  facets_by_sheet_.emplace(output_, num_sheets_);
  for (std::size_t leaf = 0; leaf < facets_.num_leaves(); ++leaf) {
    throw_if_stopped(stop_);
    for (const BoundaryFacet& facet : facets_.list(leaf).values)
      facets_by_sheet_->append(facet.labels.sheet, facet);
  }
  facets_by_sheet_->finish(exchange_);
  facets_before_.assign(num_sheets_, 0);
  for (SheetId sheet = 1; sheet < num_sheets_; ++sheet)
    facets_before_[sheet] = facets_before_[sheet - 1] + num_facets_of(sheet);
}

std::uint64_t BoundarySurface::first_own_facet_of(SheetId sheet) const {
  if (!facets_by_sheet_) return num_facets_.before;
  return facets_before_[sheet - 1] + facets_by_sheet_->of_ranks(sheet).before;
}

std::function<std::optional<BoundarySurface::Facets>()> BoundarySurface::facets_of(
    SheetId sheet, const FacetParts& parts) {
  assert(num_sheets_ == 1 || facets_by_sheet_);
  if (!facets_by_sheet_) return facets(parts);
  assert(!parts.has_places || vertices_);
  return [this, sheet, parts, place = first_own_facet_of(sheet),
          first = std::uint64_t{0}]() mutable -> std::optional<Facets> {
    const std::uint64_t count = std::min(kItemsAtOnce, num_own_facets_of(sheet) - first);
    if (count == 0) return std::nullopt;
    Facets some{place + first, facets_by_sheet_->read(sheet, first, count), {}, {}, {}};
    complete(parts, some);
    first += count;
    return some;
  };
}

std::function<std::optional<BoundarySurface::Vertices>()> BoundarySurface::vertices_of(
    SheetId sheet) {
  if (!vertices_by_sheet_) return vertices();
  return [this, sheet, first = std::uint64_t{0}]() mutable -> std::optional<Vertices> {
    const std::uint64_t count = std::min(kItemsAtOnce, vertices_by_sheet_->num_own(sheet) - first);
    if (count == 0) return std::nullopt;
    Vertices some{vertices_by_sheet_->of_ranks(sheet).before + first,
                  vertices_by_sheet_->read(sheet, first, count),
                  {}};
    first += count;
    return some;
  };
}

std::function<std::optional<BoundarySurface::Vertices>()> BoundarySurface::vertices() {
  assert(vertices_);
  return [this, first = std::uint64_t{0}]() mutable -> std::optional<Vertices> {
    const std::uint64_t count = std::min(kItemsAtOnce, end_own_vertex_ - first);
    if (count == 0) return std::nullopt;
    Vertices some{num_vertices_.before + first, vertices_->read(first, count), {}};
    for (const std::uint64_t v : some.vertices) some.positions.push_back(positions_->of(v));
    first += count;
    return some;
  };
}

}  // namespace locvol
