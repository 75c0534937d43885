#include "engine/output/vertex_numbering.h"

#include <algorithm>
#include <stdexcept>
#include <string>
#include <tuple>

#include "engine/exchange/pack.h"
#include "engine/shared/lattice_of_run.h"
#include "engine/shared/leaf_name.h"
#include "octree/shares.h"

namespace locvol {

// Of a leaf: ids, or where its vertices are.
struct NumberList {
  MortonKey leaf;
  std::vector<std::uint64_t> numbers;
};
auto fields(Maybe<NumberList> auto& list) {
  auto& [leaf, numbers] = list;
  return std::tuple(Field("leaf", leaf), Field("numbers", numbers));
}

namespace {

constexpr std::size_t kNamesBytes = std::size_t{16} << 20, kTableBytes = std::size_t{8} << 20,
                      kCoreBytes = std::size_t{12} << 20;

[[noreturn]] void corrupt(MortonKey leaf, const std::string& what) {
  throw CorruptRecord(leaf_name(leaf) + ": " + what, leaf);
}

void require_ascending(std::span<const std::uint64_t> ids, MortonKey leaf, const char* what) {
  if (std::ranges::adjacent_find(ids, std::ranges::greater_equal()) != ids.end()) {
    corrupt(leaf, std::string(what) + " are not in order of id");
  }
}

// Those that the cells name, ascending, and how many cells there are.
struct NamedBy {
  std::vector<std::uint64_t> vertices;
  std::uint64_t num_cells = 0;
};
template <class Item, class VerticesOf>
NamedBy named_by(const std::vector<std::uint64_t>& vertices, const std::vector<Item>& items,
                 const VerticesOf& vertices_of, MortonKey leaf) {
  require_ascending(vertices, leaf, "the vertices of the cells");
  std::vector<bool> is_named(vertices.size());
  for (const Item& item : items)
    for (const std::uint32_t v : vertices_of(item)) is_named[v] = true;
  NamedBy named{{}, items.size()};
  for (std::size_t i = 0; i < vertices.size(); ++i)
    if (is_named[i]) named.vertices.push_back(vertices[i]);
  return named;
}
NamedBy named_by(const LeafCells& listed, MortonKey leaf) {
  return named_by(
      listed.vertices, listed.cells, [](const auto& cell) -> auto& { return cell; }, leaf);
}
NamedBy named_by(const LeafFacets& listed, MortonKey leaf) {
  return named_by(
      listed.vertices, listed.facets,
      [](const MeshFacet& facet) -> auto& { return facet.vertices; }, leaf);
}

std::vector<std::uint64_t> flat(std::span<const VertexCopy> copies) {
  std::vector<std::uint64_t> words;
  words.reserve(2 * copies.size());
  for (const auto& [id, body] : copies) words.insert(words.end(), {id, body});
  return words;
}
std::vector<VertexCopy> copies_in(std::span<const std::uint64_t> words) {
  std::vector<VertexCopy> copies;
  copies.reserve(words.size() / 2);
  for (std::size_t i = 0; i + 1 < words.size(); i += 2)
    copies.push_back({words[i], static_cast<BodyId>(words[i + 1])});
  return copies;
}

// The copies that cells or facets of a leaf name, and how many of these there are.
struct CopiesNamedBy {
  std::vector<VertexCopy> copies;
  std::uint64_t num_cells = 0;
};
CopiesNamedBy copies_named_by(const std::vector<std::uint64_t>& ids,
                              const std::vector<BodyId>& bodies, std::uint64_t num_cells) {
  CopiesNamedBy named{{}, num_cells};
  for (std::size_t v = 0; v < ids.size(); ++v) named.copies.push_back({ids[v], bodies[v]});
  return named;
}
CopiesNamedBy copies_named_by(LeafCells listed, MortonKey leaf) {
  require_ascending(listed.vertices, leaf, "the vertices of the cells");
  const auto [cells, bodies] = with_copies(std::move(listed));
  return copies_named_by(cells.vertices, bodies, cells.cells.size());
}
CopiesNamedBy copies_named_by(const LeafFacets& listed, MortonKey leaf, const SheetSides& sides) {
  require_ascending(listed.vertices, leaf, "the vertices of the facets");
  const auto [facets, bodies] = with_copies(listed, sides);
  return copies_named_by(facets.vertices, bodies, facets.facets.size());
}

// Own ones are one after another.
std::pair<std::size_t, std::size_t> own_leaves(const Reader& reader,
                                               std::span<const MortonKey> leaves) {
  const RankRecord rank = reader.rank().value();
  const Shares shares(rank.first);
  const auto owner = [&](MortonKey leaf) { return shares.owner_of(leaf); };
  const auto own = std::ranges::equal_range(leaves, static_cast<int>(rank.rank), {}, owner);
  return {static_cast<std::size_t>(own.begin() - leaves.begin()),
          static_cast<std::size_t>(own.end() - leaves.begin())};
}

}  // namespace

VertexNumbering::VertexNumbering(const Reader& reader, const RunRecord& run,
                                 const std::filesystem::path& output, PageRelease& pages,
                                 const StopToken* stop, Exchange& exchange, const SheetSides* sides)
    : is_surface_only_(run.parameters.is_surface_only),
      sides_(sides),
      frame_(run.frame),
      lattice_(lattice_of(run)),
      scale_(reader, run),
      octree_(reader.leaf_keys()),
      ids_file_(OpenFile::temporary(output)),
      names_file_(OpenFile::temporary(output)),
      num_core_vertices_(octree_.size()),
      num_core_cells_(octree_.size()),
      first_used_(octree_.size()),
      num_used_(octree_.size()),
      end_own_(octree_.size()) {
  if (exchange.num_ranks() > 1) std::tie(first_own_, end_own_) = own_leaves(reader, leaves());
  exchange_names(reader, pages, exchange);
  std::vector<Numbered> own;
  std::vector<std::uint64_t> num_cells;
  std::uint64_t num_vertices = 0, num_used = 0, num_all_cells = 0;
  LeafWindow<Names> names(kNamesBytes,
                          [&](std::size_t leaf) { return load_names(reader, pages, leaf); });
  for (std::size_t leaf = first_own_; leaf < end_own_; ++leaf) {
    throw_if_stopped(stop);
    const std::vector<std::uint64_t> used =
        sides_ == nullptr ? find_used(leaf, names) : find_used_copies(leaf, names);
    const std::uint64_t num_here = used.size() / words_of_vertex();
    const auto here = names.get(leaf);
    write_words(num_used, used);
    own.push_back({num_vertices, here->num_core_points, num_used, num_here});
    num_used += num_here;
    num_vertices += num_here + here->num_core_points;
    num_core_cells_[leaf] = here->num_core_cells;
    num_cells.push_back(here->num_cells + here->num_core_cells);
    num_all_cells += num_cells.back();
  }

  const SumOfRanks of_vertices = sum(exchange, num_vertices),
                   of_cells = sum(exchange, num_all_cells);
  first_place_ = sum(exchange, end_own_ - first_own_).before;
  for (Numbered& leaf : own) leaf.first_vertex += of_vertices.before;
  number(own, numbers_beside(reader, own, exchange), of_vertices.all);
  std::uint64_t next_cell = 0;
  for (std::size_t leaf = 0; leaf < octree_.size(); ++leaf) {
    const bool is_own = first_own_ <= leaf && leaf < end_own_;
    if (leaf == first_own_) next_cell = of_cells.before;
    first_cell_.push_back(next_cell);
    if (is_own) next_cell += num_cells[leaf - first_own_];
  }
  first_cell_.push_back(of_cells.all);
}

// Leaves of which nothing is known get what lies between those that are known.
void VertexNumbering::number(std::span<const Numbered> own,
                             std::span<const std::pair<std::size_t, Numbered>> beside,
                             std::uint64_t num_all) {
  auto other = beside.begin();
  std::uint64_t next = 0;
  for (std::size_t leaf = 0; leaf < octree_.size(); ++leaf) {
    const Numbered* known = nullptr;
    if (first_own_ <= leaf && leaf < end_own_)
      known = &own[leaf - first_own_];
    else if (other != beside.end() && other->first == leaf)
      known = &(other++)->second;
    if (known != nullptr) {
      if (known->first_vertex < next)
        corrupt(leaves()[leaf], "its vertices are not where its rank says");
      next = known->first_vertex;
      num_core_vertices_[leaf] = known->num_core;
      first_used_[leaf] = known->first_used;
      num_used_[leaf] = known->num_used;
    }
    first_vertex_.push_back(next);
    if (known != nullptr) next += known->num_used + known->num_core;
  }
  first_vertex_.push_back(num_all);
}

void VertexNumbering::tell_ranks_beside(const Reader& reader, Exchange& exchange, double distance,
                                        const NumbersOf& list, const TakeNumbers& take) const {
  if (exchange.num_ranks() == 1) return;
  const Shares shares(reader.rank().value().first);
  std::size_t leaf = first_own_;
  do {
    std::vector<std::vector<NumberList>> lists(static_cast<std::size_t>(exchange.num_ranks()));
    std::size_t num_bytes = 0;
    for (; leaf < end_own_ && num_bytes < kMessageBytes; ++leaf) {
      const std::vector<int> ranks =
          shares.ranks_within(frame_, frame_.box(leaves()[leaf]), distance * scale_.of(leaf));
      if (ranks.size() == 1) continue;
      const NumberList of_leaf{leaves()[leaf], list(leaf)};
      for (const int rank : ranks) {
        if (rank == exchange.rank()) continue;
        lists[static_cast<std::size_t>(rank)].push_back(of_leaf);
        num_bytes += sizeof(std::uint64_t) * of_leaf.numbers.size();
      }
    }
    for (const auto& of_rank : swap_lists(exchange, std::move(lists)))
      for (const NumberList& received : of_rank) {
        const auto place = std::ranges::lower_bound(leaves(), received.leaf);
        if (place == leaves().end() || *place != received.leaf)
          throw ExchangeError("another rank has other leaves");
        take(static_cast<std::size_t>(place - leaves().begin()), received.numbers);
      }
  } while (any(exchange, leaf < end_own_));
}

void VertexNumbering::exchange_names(const Reader& reader, PageRelease& pages, Exchange& exchange) {
  std::uint64_t size = 0;
  tell_ranks_beside(
      reader, exchange, kCellReach,
      [&](std::size_t leaf) {
        const Names names = load_names(reader, pages, leaf);
        return sides_ == nullptr ? names.foreign : flat(names.foreign_copies);
      },
      [&](std::size_t leaf, const std::vector<std::uint64_t>& ids) {
        names_file_.write_at(sizeof(std::uint64_t) * size, std::as_bytes(std::span(ids)));
        names_beside_[leaf] = {size, ids.size()};
        size += ids.size();
      });
}

// Their used ids are appended to the file.
std::vector<std::pair<std::size_t, VertexNumbering::Numbered>> VertexNumbering::numbers_beside(
    const Reader& reader, std::span<const Numbered> own, Exchange& exchange) {
  std::uint64_t num_in_file = 0;
  for (const Numbered& leaf : own) num_in_file += leaf.num_used;
  std::vector<std::pair<std::size_t, Numbered>> beside;
  tell_ranks_beside(
      reader, exchange, kCellReach,
      [&](std::size_t leaf) {
        const Numbered& numbered = own[leaf - first_own_];
        std::vector<std::uint64_t> numbers = read_words(numbered.first_used, numbered.num_used);
        numbers.insert(numbers.begin(), {numbered.first_vertex, numbered.num_core});
        return numbers;
      },
      [&](std::size_t leaf, const std::vector<std::uint64_t>& numbers) {
        const auto words = std::span(numbers).subspan(2);
        const std::uint64_t num_there = words.size() / words_of_vertex();
        write_words(num_in_file, words);
        beside.push_back({leaf, {numbers[0], numbers[1], num_in_file, num_there}});
        num_in_file += num_there;
      });
  std::ranges::sort(beside, {}, &std::pair<std::size_t, Numbered>::first);
  return beside;
}

VertexNumbering::Names VertexNumbering::load_names(const Reader& reader, PageRelease& pages,
                                                   std::size_t leaf) const {
  const MortonKey key = leaves()[leaf];
  const LeafPoints points = reader.points(key);
  Names names;
  if (const auto beside = names_beside_.find(leaf); beside != names_beside_.end()) {
    const auto [first, count] = beside->second;
    names.foreign.resize(count);
    names_file_.read_at(sizeof(std::uint64_t) * first,
                        std::as_writable_bytes(std::span(names.foreign)));
    if (sides_ != nullptr) names.foreign_copies = copies_in(std::exchange(names.foreign, {}));
    return names;
  }
  NamedBy named;
  CopiesNamedBy of_copies;
  if (sides_ == nullptr)
    named = is_surface_only_ ? named_by(reader.facets(key), key) : named_by(reader.cells(key), key);
  else
    of_copies = is_surface_only_ ? copies_named_by(reader.facets(key), key, *sides_)
                                 : copies_named_by(reader.cells(key), key);
  names.num_cells = named.num_cells + of_copies.num_cells;
  pages.count(points.points.size() * sizeof(MeshPoint) + names.num_cells * 16);
  if (!points.core.is_empty()) {
    check_core(leaf, points.core);
    const LeafInfo info = reader.leaf(key).value_or(LeafInfo());
    names.num_core_points = num_points(points.core, sites(leaf));
    names.num_core_cells = info.num_core_cells;
  }
  names.own.reserve(points.points.size());
  for (const MeshPoint& point : points.points) names.own.push_back(point.id);
  require_ascending(names.own, key, "the points");
  if (sides_ != nullptr) {
    for (const VertexCopy& copy : of_copies.copies)
      (std::ranges::binary_search(names.own, copy.id) ? names.own_copies : names.foreign_copies)
          .push_back(copy);
    return names;
  }
  names.is_named.resize(names.own.size());
  auto own = names.own.begin();
  for (const std::uint64_t vertex : named.vertices) {
    own = std::lower_bound(own, names.own.end(), vertex);
    if (own != names.own.end() && *own == vertex) {
      names.is_named[static_cast<std::size_t>(own - names.own.begin())] = true;
    } else {
      names.foreign.push_back(vertex);
    }
  }
  return names;
}

std::vector<std::uint64_t> VertexNumbering::find_used(std::size_t leaf,
                                                      LeafWindow<Names>& names) const {
  const auto here = names.get(leaf);
  std::vector<bool> is_used = here->is_named;
  if (std::ranges::find(is_used, false) != is_used.end()) {
    for (const std::size_t neighbor : neighbors(leaf)) {
      for_each_common(names.get(neighbor)->foreign, here->own,
                      [&](auto, auto own) { is_used[static_cast<std::size_t>(own)] = true; });
    }
  }
  std::vector<std::uint64_t> used;
  used.reserve(here->own.size());
  for (std::size_t i = 0; i < is_used.size(); ++i) {
    if (is_used[i]) used.push_back(here->own[i]);
  }
  return used;
}

// Cells of other leaves may name a point for bodies that own cells do not name it for.
std::vector<std::uint64_t> VertexNumbering::find_used_copies(std::size_t leaf,
                                                             LeafWindow<Names>& names) const {
  const auto here = names.get(leaf);
  std::vector<VertexCopy> used = here->own_copies;
  for (const std::size_t neighbor : neighbors(leaf))
    std::ranges::copy_if(
        names.get(neighbor)->foreign_copies, std::back_inserter(used),
        [&](const VertexCopy& copy) { return std::ranges::binary_search(here->own, copy.id); });
  sort_and_unite(used);
  return flat(used);
}

std::vector<std::uint64_t> VertexNumbering::used_ids(std::size_t leaf) const {
  std::vector<std::uint64_t> words = read_words(first_used_[leaf], num_used_[leaf]);
  if (sides_ == nullptr) return words;
  for (std::size_t i = 0; i < num_used_[leaf]; ++i) words[i] = words[2 * i];
  words.resize(num_used_[leaf]);
  return words;
}

std::vector<VertexCopy> VertexNumbering::used_copies(std::size_t leaf) const {
  return copies_in(read_words(first_used_[leaf], num_used_[leaf]));
}

std::vector<std::uint64_t> VertexNumbering::read_words(std::uint64_t first,
                                                       std::uint64_t count) const {
  const std::size_t words_of = words_of_vertex();
  std::vector<std::uint64_t> words(words_of * count);
  ids_file_.read_at(words_of * first * sizeof(std::uint64_t),
                    std::as_writable_bytes(std::span(words)));
  return words;
}

void VertexNumbering::write_words(std::uint64_t first, std::span<const std::uint64_t> words) {
  ids_file_.write_at(words_of_vertex() * first * sizeof(std::uint64_t), std::as_bytes(words));
}

void VertexNumbering::check_core(std::size_t leaf, const LatticeCore& core) const {
  try {
    locvol::check_core(core, sites(leaf));
  } catch (const std::invalid_argument& e) {
    corrupt(leaves()[leaf], e.what());
  }
}

std::size_t VertexNumbering::leaf_of(std::uint64_t vertex) const {
  const auto next = std::ranges::upper_bound(first_vertex_, vertex);
  return static_cast<std::size_t>(next - first_vertex_.begin()) - 1;
}

std::size_t VertexNumbering::leaf_of_cell(std::uint64_t cell) const {
  const auto next = std::ranges::upper_bound(first_cell_, cell);
  return static_cast<std::size_t>(next - first_cell_.begin()) - 1;
}

NumberWindow::NumberWindow(const Reader& reader, const VertexNumbering& numbering, int num_shares)
    : reader_(&reader),
      numbering_(&numbering),
      tables_(kTableBytes / static_cast<std::size_t>(num_shares),
              [this](std::size_t leaf) { return load_table(leaf); }),
      cores_(kCoreBytes / static_cast<std::size_t>(num_shares), [this](std::size_t leaf) {
        if (numbering_->num_core_vertices(leaf) == 0) return Core{};
        return Core{reader_->points(numbering_->leaves()[leaf]).core};
      }) {}

const SiteBlock<std::int64_t>* NumberWindow::core_numbers(std::size_t leaf) {
  if (leaf_of_core_numbers_ != leaf) {
    leaf_of_core_numbers_ = leaf;
    has_core_numbers_ = false;
    const SiteBox around = numbering_->sites(leaf).expanded(2);
    for (const std::size_t other : numbering_->neighbors(leaf)) {
      if (numbering_->num_core_vertices(other) == 0) continue;
      if (!has_core_numbers_) core_numbers_ = {around, -1};
      has_core_numbers_ = true;
      const auto first = static_cast<std::int64_t>(numbering_->first_core_vertex(other));
      for_each_core_site(cores_.get(other)->core, numbering_->sites(other), around,
                         [&](const LatticeSite& site, std::uint64_t num_before) {
                           core_numbers_[site] = first + static_cast<std::int64_t>(num_before);
                         });
    }
  }
  return has_core_numbers_ ? &core_numbers_ : nullptr;
}

NumberWindow::Table NumberWindow::load_table(std::size_t leaf) const {
  if (numbering_->sides() == nullptr) return {numbering_->used_ids(leaf), {}};
  Table table;
  for (const auto& [id, body] : numbering_->used_copies(leaf)) {
    table.ids.push_back(id);
    table.bodies.push_back(body);
  }
  return table;
}

// Calls visit(i, number) for the ids that have one; of copies, for each. `core_number`: likewise of
// points of the core, after all others
template <class Visit, class VisitCore>
void NumberWindow::for_each_number(std::size_t leaf, std::span<const std::uint64_t> ids,
                                   const Visit& visit, const VisitCore& visit_core) {
  if (ids.empty()) return;
  for (const std::size_t neighbor : numbering_->neighbors(leaf)) {
    const auto first = static_cast<std::int64_t>(numbering_->first_vertex(neighbor));
    const auto table = tables_.get(neighbor);
    for_each_common(ids, table->ids, [&](auto id, auto place) {
      visit(static_cast<std::size_t>(id), *table, static_cast<std::size_t>(place), first);
    });
  }
  if (const auto* core = core_numbers(leaf))
    for (std::size_t i = 0; i < ids.size() && ids[i] < kFirstOtherId; ++i) {
      const LatticeSite site = site_of(ids[i]);
      if (core->box().contains(site)) visit_core(i, (*core)[site]);
    }
}

std::vector<std::int64_t> NumberWindow::numbers(std::size_t leaf,
                                                std::span<const std::uint64_t> ids,
                                                std::span<const BodyId> bodies) {
  std::vector<std::int64_t> numbers(ids.size(), -1);
  for_each_number(
      leaf, ids,
      [&](std::size_t id, const Table& table, std::size_t place, std::int64_t first) {
        // Copies of one point follow each other, here and there.
        for (; !bodies.empty() && table.bodies[place] != bodies[id]; ++place)
          if (place + 1 == table.ids.size() || table.ids[place + 1] != ids[id]) return;
        numbers[id] = first + static_cast<std::int64_t>(place);
      },
      [&](std::size_t id, std::int64_t number) {
        if (numbers[id] < 0) numbers[id] = number;
      });
  return numbers;
}

std::vector<NumberWindow::Numbered> NumberWindow::numbered(std::size_t leaf,
                                                           std::span<const std::uint64_t> ids) {
  std::vector<Numbered> numbered;
  std::vector<bool> is_listed(ids.size());
  for_each_number(
      leaf, ids,
      [&](std::size_t id, const Table& table, std::size_t place, std::int64_t first) {
        is_listed[id] = true;
        for (; place < table.ids.size() && table.ids[place] == ids[id]; ++place)
          numbered.push_back({id, table.bodies.empty() ? kNoBody : table.bodies[place],
                              first + static_cast<std::int64_t>(place)});
      },
      [&](std::size_t id, std::int64_t number) {
        if (!is_listed[id] && number >= 0) numbered.push_back({id, kNoBody, number});
      });
  return numbered;
}

NumberWindow::Cells NumberWindow::cells(std::size_t leaf) {
  LeafCells listed = reader_->cells(numbering_->leaves()[leaf]);
  CellsOfCopies of_copies;
  if (numbering_->sides() == nullptr)
    of_copies.cells = std::move(listed);
  else
    of_copies = with_copies(std::move(listed));
  Cells result{std::move(of_copies.cells), {}};
  result.numbers = numbers(leaf, result.cells.vertices, of_copies.bodies);
  for (const auto& cell : result.cells.cells)
    for (const std::uint32_t v : cell)
      if (result.numbers[v] < 0)
        throw_unknown_point(result.cells.vertices[v], numbering_->leaves()[leaf]);
  return result;
}

NumberWindow::Facets NumberWindow::facets(std::size_t leaf) {
  FacetsOfCopies listed{reader_->facets(numbering_->leaves()[leaf]), {}};
  if (numbering_->sides() != nullptr) listed = with_copies(listed.facets, *numbering_->sides());
  Facets result{std::move(listed.facets), {}};
  result.numbers = numbers(leaf, result.facets.vertices, listed.bodies);
  return result;
}

std::uint64_t NumberWindow::first_copy(std::uint64_t vertex) {
  if (numbering_->sides() == nullptr) return vertex;
  const std::size_t leaf = numbering_->leaf_of(vertex);
  const auto table = tables_.get(leaf);
  const std::uint64_t first = numbering_->first_vertex(leaf), place = vertex - first;
  if (place >= table->ids.size()) return vertex;  // of the core
  const auto copies = std::ranges::equal_range(table->ids, table->ids[place]);
  return first + static_cast<std::uint64_t>(copies.begin() - table->ids.begin());
}

}  // namespace locvol
