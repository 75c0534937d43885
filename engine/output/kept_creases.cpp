#include "engine/output/kept_creases.h"

#include <cassert>
#include <iterator>
#include <numeric>
#include <ranges>
#include <tuple>
#include <utility>

#include "engine/exchange/pack.h"
#include "engine/output/leaf_window.h"
#include "engine/output/stored_mesh.h"
#include "engine/output/vertex_positions.h"
#include "engine/shared/compensated_sum.h"
#include "octree/sort_and_unite.h"
#include "refine/crease_segments.h"

namespace locvol {

auto fields(Maybe<KeptCorner> auto& kept) {
  auto& [vertex, cell, corner, leaf, position] = kept;
  return std::tuple(Field("vertex", vertex), Field("cell", cell), Field("corner", corner),
                    Field("leaf", leaf), Field("position", position));
}

namespace {

constexpr std::size_t kListBytes = std::size_t{4} << 20, kPointBytes = std::size_t{8} << 20;
constexpr std::uint64_t kEdgesAtOnce = std::uint64_t{1} << 14;

// Of a crease, on one rank.
struct EdgeSums {
  std::uint64_t num_edges = 0;
  CompensatedSum length;
  Point min, max;  // of their ends

  void add(double way, const Box& box) {
    length.add(way);
    join(box);
    ++num_edges;
  }
  void join(const Box& box) {
    const Box all = num_edges == 0 ? box : Box{min, max}.joined(box);
    min = all.min;
    max = all.max;
  }
};
auto fields(Maybe<EdgeSums> auto& sums) {
  auto& [num_edges, length, min, max] = sums;
  return std::tuple(Field("num_edges", num_edges), Field("length", length), Field("min", min),
                    Field("max", max));
}

auto by_vertices(const KeptEdge& item) { return std::tuple(item.vertices, item.cell); }
auto by_cell(const KeptEdge& item) { return std::tuple(item.cell, item.vertices); }

bool is_in(const NumberRange& range, std::uint64_t number) {
  return range.first <= number && number < range.end;
}

}  // namespace

// Memory: that of NumberWindow, and 8 MB.
class KeptCreases::Segments {
 public:
  Segments(const Reader& reader, const RunRecord& run, const VertexNumbering& numbering,
           PageRelease& pages)
      : reader_(reader),
        run_(run),
        numbering_(numbering),
        pages_(pages),
        scale_(reader, run),
        numbers_(reader, numbering),
        near_(kPointBytes, [this](std::size_t leaf) { return load(leaf); }) {}

  // Edges whose smaller vertex is in the leaf, and its corners.
  std::vector<Item> of(std::size_t leaf) {
    const auto here = near_.get(leaf);
    if (here->points.empty()) return {};
    const RunParameters& p = run_.parameters;
    const double reach = kCellReach * scale_.of(leaf);
    DomainPiece piece;
    piece.region = run_.frame.box(numbering_.leaves()[leaf]).expanded(reach);
    piece.crease_floor = p.spacing_floor * p.sizes().least;
    std::vector<MeshPoint> points;
    for (const std::size_t other : numbering_.near(leaf, kCellReach)) {
      const auto theirs = near_.get(other);
      piece.add_creases(theirs->surface);
      std::ranges::copy_if(theirs->points, std::back_inserter(points), [&](const MeshPoint& point) {
        return piece.region.contains(point.position);
      });
    }
    piece.unite();
    sort_and_unite(points, &MeshPoint::id);
    std::vector<std::uint64_t> ids;
    std::vector<Point> positions;
    for (const MeshPoint& point : points) {
      ids.push_back(point.id);
      positions.push_back(point.position);
    }
    std::vector<NumberWindow::Numbered> numbered = numbers_.numbered(leaf, ids);
    std::ranges::sort(numbered, {}, &NumberWindow::Numbered::place);
    const auto of_point = [&](std::size_t place) {
      return std::ranges::equal_range(numbered, place, {}, &NumberWindow::Numbered::place);
    };
    const NumberRange own{numbering_.first_vertex(leaf), numbering_.first_vertex(leaf + 1)};
    std::vector<Item> items;
    const auto add = [&](std::int64_t one, std::int64_t other, std::uint64_t crease,
                         std::uint64_t length) {
      const auto [a, b] =
          edge_between(static_cast<std::uint64_t>(one), static_cast<std::uint64_t>(other));
      if (is_in(own, a)) items.push_back({{a, b}, 0, crease, length});
    };
    // Of copies, an edge joins those of one body.
    for (const auto& [ends, length, crease, way] :
         crease_segments(std::move(piece), positions, p.size))
      for (const NumberWindow::Numbered& one : of_point(ends[0]))
        for (const NumberWindow::Numbered& other : of_point(ends[1]))
          if (one.body == other.body)
            add(one.number, other.number, crease, std::bit_cast<std::uint64_t>(length));
    std::vector<std::size_t> by_position(positions.size());
    std::iota(by_position.begin(), by_position.end(), std::size_t{0});
    const auto position_of = [&](std::size_t place) { return positions[place]; };
    std::ranges::sort(by_position, {}, position_of);
    for (const CornerPoint& corner : here->surface.corners) {
      const auto place = std::ranges::lower_bound(by_position, corner.position, {}, position_of);
      if (place == by_position.end() || positions[*place] != corner.position) continue;
      for (const NumberWindow::Numbered& copy : of_point(*place))
        add(copy.number, copy.number, corner.corner, 0);
    }
    std::ranges::sort(items, {}, by_vertices);
    return items;
  }

 private:
  // Of a leaf, that on creases.
  struct OnCreases {
    LeafSurface surface;  // no triangles
    std::vector<MeshPoint> points;
    std::size_t bytes() const {
      return sizeof *this + surface.bytes() + sizeof(MeshPoint) * points.capacity();
    }
  };

  OnCreases load(std::size_t leaf) const {
    const MortonKey key = numbering_.leaves()[leaf];
    OnCreases here;
    const auto info = reader_.leaf(key);
    if (!info || !info->has_surface()) return here;
    here.surface = reader_.surface(key);
    pages_.count(here.surface.bytes());
    here.surface.triangles = {};
    if (here.surface.bytes() == 0) return here;
    for (const MeshPoint& point : reader_.points(key).points)
      if (point.kind == PointKind::kCrease) here.points.push_back(point);
    return here;
  }

  const Reader& reader_;
  const RunRecord& run_;
  const VertexNumbering& numbering_;
  PageRelease& pages_;
  LeafScale scale_;
  NumberWindow numbers_;
  LeafWindow<OnCreases> near_;
};

KeptCreases::KeptCreases(const Reader& reader, const RunRecord& run,
                         const VertexNumbering& numbering, const BoundarySurface& boundary,
                         const std::filesystem::path& output, PageRelease& pages,
                         const StopToken* stop, Exchange& exchange)
    : reader_(reader),
      run_(run),
      numbering_(numbering),
      output_(output),
      pages_(pages),
      stop_(stop),
      exchange_(exchange),
      num_creases_(reader.sheets().creases.size()) {
  find(
      [&](std::size_t leaf) {
        std::vector<Facet> facets;
        for (const BoundaryFacet& facet : boundary.facets_of_leaf(leaf))
          facets.push_back({facet.vertices, facet.cell});
        return facets;
      },
      true);
}

KeptCreases::KeptCreases(const Reader& reader, const RunRecord& run,
                         const VertexNumbering& numbering, const std::filesystem::path& output,
                         PageRelease& pages, const StopToken* stop, Exchange& exchange)
    : reader_(reader),
      run_(run),
      numbering_(numbering),
      output_(output),
      pages_(pages),
      stop_(stop),
      exchange_(exchange),
      num_creases_(reader.sheets().creases.size()) {
  NumberWindow numbers(reader, numbering);
  find(
      [&](std::size_t leaf) {
        const auto [listed, number] = numbers.facets(leaf);
        pages.count(sizeof(listed.facets[0]) * listed.facets.size());
        std::vector<Facet> facets;
        for (const auto& [vertices, labels] : listed.facets) {
          Facet& facet = facets.emplace_back();
          std::ranges::transform(vertices, facet.vertices.begin(), [&](std::uint32_t v) {
            return static_cast<std::uint64_t>(number[v]);
          });
        }
        return facets;
      },
      false);
}

void KeptCreases::find(const FacetsOf& facets_of, bool has_cells) {
  Lists segments(numbering_, output_, kListBytes), found(numbering_, output_, kListBytes),
      first(numbering_, output_, kListBytes);
  find_segments(segments);
  find_in_facets(facets_of, segments, found);
  keep_first(segments, found, first);
  if (!has_cells) return add_up(first);
  Lists of_cells(numbering_, output_, kListBytes);
  sort_by_cell(found, first, of_cells);
  add_up(of_cells);
}

void KeptCreases::find_segments(Lists& segments) {
  Segments around(reader_, run_, numbering_, pages_);
  for (std::size_t leaf = numbering_.first_own(); leaf < numbering_.end_own(); ++leaf) {
    throw_if_stopped(stop_);
    segments.append(around.of(leaf));
  }
  segments.tell(reader_, exchange_);
}

// Of each leaf those that facets of it have, each with the first of their cells.
void KeptCreases::find_in_facets(const FacetsOf& facets_of, Lists& segments, Lists& found) {
  for (std::size_t leaf = numbering_.first_own(); leaf < numbering_.end_own(); ++leaf) {
    throw_if_stopped(stop_);
    std::vector<Item> near, here;
    segments.for_each_near(leaf, [&](std::span<const Item> items) {
      near.insert(near.end(), items.begin(), items.end());
    });
    if (!near.empty()) {
      std::ranges::sort(near, {}, by_vertices);
      for (const Facet& facet : facets_of(leaf))
        for (std::size_t i = 0; i < 3; ++i)
          for (std::size_t j = i; j < 3; ++j) {
            const auto [a, b] = std::minmax(facet.vertices[i], facet.vertices[j]);
            const auto item = std::ranges::lower_bound(near, std::array{a, b}, {}, &Item::vertices);
            if (item == near.end() || item->vertices != std::array{a, b}) continue;
            here.push_back(*item);
            here.back().cell = facet.cell;
          }
      std::ranges::sort(here, {}, by_vertices);
      const auto later = std::ranges::unique(here, {}, &Item::vertices);
      here.erase(later.begin(), later.end());
    }
    found.append(here);
  }
  found.tell(reader_, exchange_);
}

// Of each leaf those whose smaller vertex it has.
void KeptCreases::keep_first(const Lists& segments, Lists& found, Lists& first) const {
  for (std::size_t leaf = numbering_.first_own(); leaf < numbering_.end_own(); ++leaf) {
    throw_if_stopped(stop_);
    std::vector<Item> here;
    const NumberRange own{numbering_.first_vertex(leaf), numbering_.first_vertex(leaf + 1)};
    if (segments.has_some(leaf))
      found.for_each_near(leaf, [&](std::span<const Item> items) {
        std::ranges::copy_if(items, std::back_inserter(here),
                             [&](const Item& item) { return is_in(own, item.vertices[0]); });
      });
    std::ranges::sort(here, {}, by_vertices);
    here.erase(std::ranges::unique(here, {}, &Item::vertices).begin(), here.end());
    first.append(here);
  }
  first.tell(reader_, exchange_);
}

// Of each leaf those whose first cell it has.
void KeptCreases::sort_by_cell(const Lists& found, Lists& first, Lists& of_cells) const {
  for (std::size_t leaf = numbering_.first_own(); leaf < numbering_.end_own(); ++leaf) {
    throw_if_stopped(stop_);
    std::vector<Item> here;
    const NumberRange own{numbering_.first_cell(leaf), numbering_.first_cell(leaf + 1)};
    if (found.has_some(leaf))
      first.for_each_near(leaf, [&](std::span<const Item> items) {
        std::ranges::copy_if(items, std::back_inserter(here),
                             [&](const Item& item) { return is_in(own, item.cell); });
      });
    std::ranges::sort(here, {}, by_cell);
    of_cells.append(here);
  }
}

void KeptCreases::add_up(const Lists& kept) {
  VertexPositions positions(reader_, numbering_);
  std::vector<EdgeSums> sums(num_creases_);
  std::vector<KeptCorner> own_corners;
  edges_.emplace(output_);
  for (std::size_t leaf = numbering_.first_own(); leaf < numbering_.end_own(); ++leaf) {
    std::vector<Item> edges;
    if (kept.has_some(leaf))
      for (const Item& item : kept.own(leaf)) {
        if (is_corner(item)) {
          own_corners.push_back({item.vertices[0], item.cell, item.crease, numbering_.place(leaf),
                                 positions.of(item.vertices[0])});
          continue;
        }
        if (item.crease == 0 || item.crease > num_creases_)
          throw StoreError("the store is damaged: an edge is of a crease that is not known");
        const auto& [a, b] = item.vertices;
        sums[item.crease - 1].add(item.length(),
                                  Box::around(positions.of(a)).joined(positions.of(b)));
        edges.push_back(item);
      }
    edges_->append(edges);
  }
  num_own_edges_ = edges_->size();
  num_edges_ = sum(exchange_, num_own_edges_);
  kept_.resize(num_creases_);
  std::vector<EdgeSums> all(num_creases_);
  for (const std::string& of_rank : exchange_.gather(pack(sums))) {
    const auto theirs = unpack<std::vector<EdgeSums>>(of_rank);
    for (std::size_t c = 0; c < std::min(num_creases_, theirs.size()); ++c) {
      if (theirs[c].num_edges == 0) continue;
      all[c].join({theirs[c].min, theirs[c].max});
      all[c].num_edges += theirs[c].num_edges;
      all[c].length.add(theirs[c].length);
    }
  }
  for (std::size_t c = 0; c < num_creases_; ++c)
    kept_[c] = {all[c].num_edges, all[c].length.value(), {all[c].min, all[c].max}};
  corners_ = gather_all(exchange_, own_corners);
  std::ranges::sort(corners_, {}, [](const KeptCorner& corner) {
    return std::pair(corner.corner, corner.vertex);
  });
}

KeptCreases::Edges KeptCreases::with_nodes(std::uint64_t first, std::vector<KeptEdge> edges) const {
  Edges some{first, std::move(edges), {}};
  if (number_of_node_)
    for (const auto& [a, b] : std::views::transform(some.edges, &KeptEdge::vertices))
      some.nodes.push_back(number_of_node_({a, b}));
  return some;
}

std::function<std::optional<KeptCreases::Edges>()> KeptCreases::edges() const {
  return [this, first = std::uint64_t{0}]() mutable -> std::optional<Edges> {
    const std::uint64_t count = std::min(kEdgesAtOnce, num_own_edges_ - first);
    if (count == 0) return std::nullopt;
    Edges some = with_nodes(num_edges_.before + first, edges_->read(first, count));
    first += count;
    return some;
  };
}

// A vertex is on the creases that edges around it are of, which leaves within 2λ have.
void KeptCreases::sort() {
  if (by_crease_) return;
  by_crease_.emplace(output_, num_creases_);
  vertices_by_crease_.emplace(output_, num_creases_);
  Lists edges(numbering_, output_, kListBytes);
  for (std::size_t leaf = numbering_.first_own(); leaf < numbering_.end_own(); ++leaf) {
    throw_if_stopped(stop_);
    const std::vector<Item> here = edges_->list(leaf - numbering_.first_own()).values;
    edges.append(here);
    for (const Item& edge : here) by_crease_->append(static_cast<CreaseId>(edge.crease), edge);
  }
  edges.tell(reader_, exchange_);
  for (std::size_t leaf = numbering_.first_own(); leaf < numbering_.end_own(); ++leaf) {
    throw_if_stopped(stop_);
    const NumberRange own{numbering_.first_vertex(leaf), numbering_.first_vertex(leaf + 1)};
    std::vector<std::pair<std::uint64_t, std::uint64_t>> here;  // vertex, crease
    if (own.size() > 0)
      edges.for_each_near(leaf, [&](std::span<const Item> items) {
        for (const Item& edge : items)
          for (const std::uint64_t vertex : edge.vertices)
            if (is_in(own, vertex)) here.emplace_back(vertex, edge.crease);
      });
    sort_and_unite(here);
    for (const auto& [vertex, crease] : here)
      vertices_by_crease_->append(static_cast<CreaseId>(crease), vertex);
  }
  by_crease_->finish(exchange_);
  vertices_by_crease_->finish(exchange_);
  edges_before_.assign(num_creases_, 0);
  for (std::size_t c = 1; c < num_creases_; ++c)
    edges_before_[c] = edges_before_[c - 1] + kept_[c - 1].num_edges;
}

std::uint64_t KeptCreases::first_own_edge_of(CreaseId crease) const {
  return edges_before_[crease - 1] + by_crease_->of_ranks(crease).before;
}

std::function<std::optional<KeptCreases::Edges>()> KeptCreases::edges_of(CreaseId crease) const {
  assert(by_crease_);
  return [this, crease, first = std::uint64_t{0}]() mutable -> std::optional<Edges> {
    const std::uint64_t count = std::min(kEdgesAtOnce, by_crease_->num_own(crease) - first);
    if (count == 0) return std::nullopt;
    Edges some =
        with_nodes(first_own_edge_of(crease) + first, by_crease_->read(crease, first, count));
    first += count;
    return some;
  };
}

std::function<std::optional<KeptCreases::Vertices>()> KeptCreases::vertices_of(
    CreaseId crease) const {
  assert(vertices_by_crease_);
  return [this, crease, first = std::uint64_t{0}]() mutable -> std::optional<Vertices> {
    const std::uint64_t count =
        std::min(kEdgesAtOnce, vertices_by_crease_->num_own(crease) - first);
    if (count == 0) return std::nullopt;
    Vertices some{vertices_by_crease_->of_ranks(crease).before + first,
                  vertices_by_crease_->read(crease, first, count)};
    first += count;
    return some;
  };
}

std::function<std::optional<KeptCreases::Vertices>()> KeptCreases::nodes_of(CreaseId crease) const {
  return [this, crease, next = edges_of(crease)]() mutable -> std::optional<Vertices> {
    auto some = next();
    if (!some) return std::nullopt;
    return Vertices{some->first - edges_before_[crease - 1], std::move(some->nodes)};
  };
}

}  // namespace locvol
