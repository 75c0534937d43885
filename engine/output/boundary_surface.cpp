#include "engine/output/boundary_surface.h"

#include <algorithm>
#include <cassert>
#include <utility>

#include "engine/output/leaf_facets.h"
#include "engine/shared/encode_in_order.h"
#include "engine/shared/leaf_name.h"
#include "octree/sort_and_unite.h"

namespace locvol {
namespace {

constexpr std::size_t kOpenFacetBytes = std::size_t{8} << 20, kVertexBytes = std::size_t{4} << 20;
constexpr std::uint64_t kItemsAtOnce = std::uint64_t{1} << 14;

std::array<std::uint64_t, 3> smallest_first(std::array<std::uint64_t, 3> vertices) {
  std::ranges::rotate(vertices, std::ranges::min_element(vertices));
  return vertices;
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
      facets_(output) {
  find_facets(workers);
  num_facets_ = sum(exchange, facets_.size());
}

BoundarySurface::NumberedCells BoundarySurface::load_cells(std::size_t leaf,
                                                           NumberWindow& numbers) {
  LeafCells cells = reader_->cells(numbering_->leaves()[leaf]);
  NumberedCells result{numbering_->first_cell(leaf), {}, numbers.numbers(leaf, cells)};
  for (std::int64_t& number : result.numbers)
    if (number >= 0 && numbering_->is_core(static_cast<std::uint64_t>(number))) number = -1;
  result.cells = std::move(cells.cells);
  pages_->count(sizeof(result.cells[0]) * result.cells.size());
  return result;
}

std::vector<std::uint64_t> BoundarySurface::flat(std::span<const Record> records) {
  std::vector<std::uint64_t> values;
  for (const auto& [vertices, cell_and_across] : records)
    values.insert(values.end(), {vertices[0], vertices[1], vertices[2], cell_and_across});
  return values;
}

std::vector<BoundarySurface::Record> BoundarySurface::records_in(
    std::span<const std::uint64_t> values) {
  std::vector<Record> records;
  for (; values.size() >= 4; values = values.subspan(4))
    records.push_back({{values[0], values[1], values[2]}, values[3]});
  return records;
}

std::vector<BoundarySurface::Record> BoundarySurface::facets_in_one_cell(
    const NumberedCells& leaf) {
  std::vector<ListedFacet> facets;
  for (std::uint32_t i = 0; i < leaf.cells.size(); ++i)
    for (std::uint32_t across = 0; across < 4; ++across) {
      const ListedFacet facet = listed_facet(leaf.cells[i], i, across);
      const bool is_core =
          std::ranges::any_of(facet.vertices, [&](std::uint32_t n) { return leaf.numbers[n] < 0; });
      if (!is_core) facets.push_back(facet);
    }
  std::vector<Record> records;
  for_each_facet(facets, leaf.numbers.size(), [&](std::span<const ListedFacet> same) {
    if (same.size() != 1) return;
    const auto& [cell, across] = same.front().side;
    std::array<std::uint64_t, 3> vertices{};
    for (std::size_t i = 0; i < 3; ++i)
      vertices[i] = static_cast<std::uint64_t>(leaf.numbers[leaf.cells[cell][kFacets[across][i]]]);
    records.push_back({smallest_first(vertices), 4 * (leaf.first_cell + cell) + across});
  });
  std::ranges::sort(records, {}, &Record::key);
  return records;
}

void BoundarySurface::find_facets(Workers& workers) {
  const std::size_t first_own = numbering_->first_own(), end_own = numbering_->end_own();
  // In one cell of those that a leaf lists, by key: of own leaves, and then of those beside them.
  LeafLists<Record> open(output_);
  NumberWindow numbers(*reader_, *numbering_);
  std::size_t next = first_own;
  encode_in_order(
      workers,
      [&]() -> std::optional<NumberedCells> {
        if (next == end_own) return std::nullopt;
        throw_if_stopped(stop_);
        return load_cells(next++, numbers);
      },
      facets_in_one_cell, [&](std::vector<Record> records) { open.append(records); });
  std::map<std::size_t, std::size_t> beside;  // places of their lists
  numbering_->tell_ranks_beside(
      *reader_, exchange_, 2 * kCellReach,
      [&](std::size_t leaf) { return flat(open.list(leaf - first_own).values); },
      [&](std::size_t leaf, const std::vector<std::uint64_t>& values) {
        beside[leaf] = open.num_leaves();
        open.append(records_in(values));
      });

  LeafWindow<LeafList<Record>> lists(kOpenFacetBytes,
                                     [&](std::size_t list) { return open.list(list); });
  for (std::size_t leaf = first_own; leaf < end_own; ++leaf) {
    throw_if_stopped(stop_);
    const std::size_t own = leaf - first_own;
    std::vector<Record> records;
    if (open.length(own) > 0) records = lists.get(own)->values;
    for (const std::size_t other : numbering_->near(leaf, 2 * kCellReach)) {
      const auto list = place_of_list(other, beside);
      if (other == leaf || records.empty() || !list || open.length(*list) == 0) continue;
      const auto theirs = lists.get(*list);
      auto place = theirs->values.begin();
      std::erase_if(records, [&](const Record& record) {
        place =
            std::ranges::lower_bound(place, theirs->values.end(), record.key(), {}, &Record::key);
        return place != theirs->values.end() && place->key() == record.key();
      });
    }
    std::ranges::sort(records, {}, &Record::cell_and_across);
    facets_.append(records);
  }
}

std::optional<std::size_t> BoundarySurface::place_of_list(
    std::size_t leaf, const std::map<std::size_t, std::size_t>& beside) const {
  if (numbering_->first_own() <= leaf && leaf < numbering_->end_own())
    return leaf - numbering_->first_own();
  const auto found = beside.find(leaf);
  return found == beside.end() ? std::nullopt : std::optional(found->second);
}

// Those of all facets of its cells.
std::vector<std::uint64_t> BoundarySurface::vertices_of_facets(std::size_t leaf) const {
  std::vector<std::uint64_t> vertices;
  for (const Record& record : facets_.list(leaf - numbering_->first_own()).values)
    vertices.insert(vertices.end(), record.vertices.begin(), record.vertices.end());
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
        const auto begin = std::ranges::lower_bound(theirs->values, first);
        vertices.insert(vertices.end(), begin, std::ranges::lower_bound(theirs->values, end));
      }
    }
    sort_and_unite(vertices);
    vertices_->append(vertices);
  }
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
    Facets some{num_facets_.before + first, {}, {}, {}};
    for (const Record& record : facets_.read(first, count)) {
      const auto& [a, b, c] = record.vertices;
      some.facets.push_back(
          {record.vertices, record.cell_and_across / 4, record.cell_and_across % 4});
      if (parts.has_corners)
        some.corners.push_back({positions_->of(a), positions_->of(b), positions_->of(c)});
      if (parts.has_places) some.places.push_back({place_of(a), place_of(b), place_of(c)});
    }
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
