#include "engine/output/boundary_nodes.h"

#include <algorithm>
#include <iterator>
#include <memory>
#include <utility>

#include "engine/output/quadratic_cell.h"
#include "engine/shared/encode_in_order.h"
#include "octree/sort_and_unite.h"

namespace locvol {
namespace {

constexpr std::size_t kEdgeBytes = std::size_t{8} << 20, kNodeBytes = std::size_t{4} << 20,
                      kSurfaceBytes = std::size_t{16} << 20,
                      kCreasePointBytes = std::size_t{4} << 20;
constexpr std::uint64_t kNodesAtOnce = std::uint64_t{1} << 14;

}  // namespace

struct BoundaryNodes::FacetEdge {
  MeshEdge edge;
  std::uint64_t apex = 0;  // the facet's third vertex
  std::uint32_t sheet = 0;
  std::uint16_t is_turned = 0;  // does the facet go round from the edge's larger end?
  std::uint16_t is_added = 0;   // see locvol::is_added()
  friend auto operator<=>(const FacetEdge&, const FacetEdge&) = default;
};

// Of one leaf.
struct BoundaryNodes::OwnEdges {
  std::size_t leaf = 0;
  std::vector<FacetEdge> edges;  // ascending
};

struct BoundaryNodes::EdgeShape {
  MeshEdge edge;
  BoundaryEdgeShape shape;
};

struct BoundaryNodes::FoundNodes {
  std::vector<std::pair<std::uint64_t, SheetId>> nodes;  // with each of their sheets; ascending
  std::vector<NodeOnSurface> places;                     // off the middle
  std::uint64_t num_without = 0;                         // whose place on the surface is not known
};

struct BoundaryNodes::CellsToAsk {
  std::size_t leaf = 0;
  std::vector<NodeOnSurface> nodes;  // near it, in the order of their edges
};

// The surface around leaves, and the mesh's points on creases, for one thread.
struct BoundaryNodes::SurfaceWindow {
  SurfaceWindow(const Store& store, const VertexNumbering& numbering, int num_shares)
      : snapshot(store.snapshot()),
        surfaces(kSurfaceBytes / static_cast<std::size_t>(num_shares),
                 [this, &numbering](std::size_t leaf) {
                   return snapshot.surface(numbering.leaves()[leaf]);
                 }),
        crease_points(kCreasePointBytes / static_cast<std::size_t>(num_shares),
                      [this, &numbering](std::size_t leaf) {
                        LeafList<Point> points;
                        for (const MeshPoint& p : snapshot.points(numbering.leaves()[leaf]).points)
                          if (p.kind == PointKind::kCrease) points.values.push_back(p.position);
                        return points;
                      }) {}

  const Snapshot snapshot;
  LeafWindow<LeafSurface> surfaces;
  LeafWindow<LeafList<Point>> crease_points;
};

BoundaryNodes::BoundaryNodes(const Store& store, const RunRecord& run,
                             const VertexNumbering& numbering, MeshWindows& windows,
                             EdgeWindows& edge_windows, const BoundarySurface& boundary,
                             const std::filesystem::path& output, PageRelease& pages,
                             Workers& workers, const StopToken* stop, Exchange& exchange)
    : run_(run),
      numbering_(&numbering),
      windows_(windows),
      edge_windows_(edge_windows),
      pages_(pages),
      stop_(stop),
      nodes_(output),
      on_surface_(numbering, output, kNodeBytes) {
  const Snapshot reader = store.snapshot();
  if (boundary.num_sheets() > 1) by_sheet_.emplace(output, boundary.num_sheets());
  Candidates candidates(numbering, output, kNodeBytes);
  {
    NearLists<FacetEdge> edges(numbering, output, kEdgeBytes);
    do_on_all(exchange, [&] {
      for (std::size_t leaf = numbering.first_own(); leaf < numbering.end_own(); ++leaf)
        edges.append(edges_of(boundary.facets_of_leaf(leaf)));
    });
    edges.tell(reader, exchange);
    do_on_all(exchange, [&] { find_places(store, edges, candidates, workers); });
  }
  if (by_sheet_) by_sheet_->finish(exchange);
  num_nodes_ = sum(exchange, nodes_.size());
  candidates.tell(reader, exchange);
  Refused refused(numbering, output, kNodeBytes);
  do_on_all(exchange, [&] { ask_cells(candidates, refused, workers); });
  refused.tell(reader, exchange);
  std::uint64_t num_refused = 0;
  do_on_all(exchange, [&] { num_refused = keep(candidates, refused); });
  num_on_surface_ = sum(exchange, on_surface_.size()).all;
  on_surface_.tell(reader, exchange);
  num_kept_off_ = sum(exchange, num_kept_off_ + num_refused).all;
}

std::vector<BoundaryNodes::FacetEdge> BoundaryNodes::edges_of(
    std::span<const BoundaryFacet> facets) {
  std::vector<FacetEdge> edges;
  edges.reserve(3 * facets.size());
  for (const BoundaryFacet& facet : facets)
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint64_t a = facet.vertices[k], b = facet.vertices[(k + 1) % 3];
      edges.push_back({edge_between(a, b), facet.vertices[(k + 2) % 3], facet.labels.sheet,
                       static_cast<std::uint16_t>(a > b),
                       static_cast<std::uint16_t>(is_added(facet.labels))});
    }
  std::ranges::sort(edges);
  return edges;
}

void BoundaryNodes::find_places(const Store& store, NearLists<FacetEdge>& edges,
                                Candidates& candidates, Workers& workers) {
  LendingPool<SurfaceWindow> surfaces(
      [&] { return std::make_unique<SurfaceWindow>(store, *numbering_, workers.num_threads()); });
  std::size_t next = numbering_->first_own();
  encode_in_order(
      workers,
      [&]() -> std::optional<OwnEdges> {
        throw_if_stopped(stop_);
        if (next == numbering_->end_own()) return std::nullopt;
        OwnEdges own{next++, {}};
        const std::uint64_t first = numbering_->first_vertex(own.leaf),
                            end = numbering_->first_vertex(own.leaf + 1);
        if (first == end) return own;
        const auto start = [](const FacetEdge& e) { return e.edge.a; };
        edges.for_each_near(own.leaf, [&](std::span<const FacetEdge> theirs) {
          own.edges.insert(own.edges.end(), std::ranges::lower_bound(theirs, first, {}, start),
                           std::ranges::lower_bound(theirs, end, {}, start));
        });
        std::ranges::sort(own.edges);
        pages_.count(sizeof(Triangle) * own.edges.size());
        return own;
      },
      [&](const OwnEdges& own) { return places_of(own, surfaces); },
      [&](const FoundNodes& found) {
        std::vector<std::uint64_t> nodes;
        for (const auto& [node, sheet] : found.nodes) {
          if (nodes.empty() || nodes.back() != node) nodes.push_back(node);
          if (by_sheet_) by_sheet_->append(sheet, node);
        }
        nodes_.append(nodes);
        candidates.append(found.places);
        num_kept_off_ += found.num_without;
      });
}

// Of a boundary that is a manifold, each edge has two facets. Copies of an edge have one place:
// that which the edge would have without them.
std::vector<BoundaryNodes::EdgeShape> BoundaryNodes::shapes_of(const OwnEdges& own,
                                                               FoundNodes& found) {
  std::vector<EdgeShape> shapes;
  windows_.with([&](MeshWindow& window) {
    const auto unit_normal = [&](const FacetEdge& e, const std::array<Point, 2>& ends) {
      const Point normal = cross(ends[1] - ends[0], window.positions.of(e.apex) - ends[0]);
      const double length = norm(normal);
      return length > 0 ? (e.is_turned != 0 ? -1 / length : 1 / length) * normal : Point{};
    };
    std::vector<std::pair<MeshEdge, const FacetEdge*>> edges;  // by their first copies
    edges.reserve(own.edges.size());
    for (const FacetEdge& e : own.edges)
      edges.emplace_back(window.numbers.first_copies(e.edge), &e);
    if (numbering_->sides() != nullptr)
      std::ranges::stable_sort(edges, {}, &std::pair<MeshEdge, const FacetEdge*>::first);
    for (auto first = edges.begin(); first != edges.end();) {
      const MeshEdge edge = first->first;
      std::vector<const FacetEdge*> facets;
      auto end = first;
      for (std::uint64_t node = 0; end != edges.end() && end->first == edge; ++end) {
        const FacetEdge& e = *end->second;
        if (end == first || e.edge != end[-1].second->edge)
          node = edge_windows_.with([&](EdgeWindow& numbers) { return numbers.number(e.edge); });
        found.nodes.emplace_back(node, e.sheet);
        if (e.is_added == 0) facets.push_back(&e);
      }
      if (facets.size() == 2) {
        const std::array ends = {window.positions.of(edge.a), window.positions.of(edge.b)};
        shapes.push_back(
            {edge,
             {.ends = ends,
              .sheets = {facets[0]->sheet, facets[1]->sheet},
              .outward = unit_normal(*facets[0], ends) + unit_normal(*facets[1], ends)}});
      } else {
        ++found.num_without;
      }
      first = end;
    }
  });
  sort_and_unite(found.nodes);
  return shapes;
}

BoundaryNodes::FoundNodes BoundaryNodes::places_of(const OwnEdges& own,
                                                   LendingPool<SurfaceWindow>& surfaces) {
  FoundNodes found;
  const std::vector<EdgeShape> shapes = shapes_of(own, found);
  if (shapes.empty()) return found;
  const auto around = [](const EdgeShape& shape) {
    const auto& [a, b] = shape.shape.ends;
    return Box::around(middle(a, b)).expanded(kFarthestNode * norm(b - a));
  };
  Box region = around(shapes.front());
  for (const EdgeShape& shape : shapes) region = region.joined(around(shape));
  const NodePlaces places = surfaces.with(
      [&](SurfaceWindow& window) { return surface_around(own.leaf, region, window); });
  for (const auto& [edge, shape] : shapes) {
    const auto place = places.place(shape);
    if (!place)
      ++found.num_without;
    else if (*place != middle(shape.ends[0], shape.ends[1]))
      found.places.push_back({edge, *place});
  }
  return found;
}

// Creases, and points on them, as far as an edge from the leaf may reach.
NodePlaces BoundaryNodes::surface_around(std::size_t leaf, const Box& region,
                                         SurfaceWindow& window) const {
  const RunParameters& parameters = run_.parameters;
  const bool has_creases = run_.has_creases && parameters.init == Initialization::kCover;
  std::vector<Triangle> triangles;
  DomainPiece creases;
  creases.region =
      run_.frame.box(numbering_->leaves()[leaf]).expanded(kCellReach * numbering_->scale(leaf));
  creases.crease_floor = parameters.spacing_floor * parameters.sizes().least;
  const std::vector<std::size_t> near = numbering_->near(leaf, kCellReach);
  for (const std::size_t other : near) {
    const MortonKey key = numbering_->leaves()[other];
    const bool is_in_region = run_.frame.box(key).overlaps(region);
    if (!is_in_region && !has_creases) continue;
    if (!window.snapshot.leaf(key).value_or(LeafInfo()).has_surface()) continue;
    const auto surface = window.surfaces.get(other);
    if (is_in_region)
      std::ranges::copy_if(surface->triangles, std::back_inserter(triangles),
                           [&](const Triangle& t) { return t.box().overlaps(region); });
    if (has_creases) creases.add_creases(*surface);
  }
  sort_and_unite(triangles, &Triangle::id);
  creases.unite();
  std::vector<Point> crease_points;
  for (const std::size_t other : near) {
    if (creases.creases.empty()) break;
    const auto points = window.crease_points.get(other);
    crease_points.insert(crease_points.end(), points->values.begin(), points->values.end());
  }
  return NodePlaces(std::move(triangles), std::move(creases), std::move(crease_points),
                    parameters.size);
}

void BoundaryNodes::ask_cells(Candidates& candidates, Refused& refused, Workers& workers) {
  std::size_t next = numbering_->first_own();
  encode_in_order(
      workers,
      [&]() -> std::optional<CellsToAsk> {
        throw_if_stopped(stop_);
        if (next == numbering_->end_own()) return std::nullopt;
        CellsToAsk cells{next++, {}};
        if (numbering_->first_cell(cells.leaf) == numbering_->first_cell(cells.leaf + 1))
          return cells;
        candidates.for_each_near(cells.leaf, [&](std::span<const NodeOnSurface> nodes) {
          cells.nodes.insert(cells.nodes.end(), nodes.begin(), nodes.end());
        });
        std::ranges::sort(cells.nodes, {}, &NodeOnSurface::edge);
        if (!cells.nodes.empty())
          pages_.count(16 * (numbering_->first_cell(next) - numbering_->first_cell(next - 1)));
        return cells;
      },
      [&](const CellsToAsk& cells) { return refused_by(cells); },
      [&](const std::vector<MeshEdge>& edges) { refused.append(edges); });
}

std::vector<MeshEdge> BoundaryNodes::refused_by(const CellsToAsk& asked) {
  std::vector<MeshEdge> refused;
  if (asked.nodes.empty()) return refused;
  std::vector<std::uint64_t> ends;
  for (const NodeOnSurface& node : asked.nodes) ends.insert(ends.end(), {node.edge.a, node.edge.b});
  sort_and_unite(ends);
  windows_.with([&](MeshWindow& window) {
    const auto [cells, numbers] = window.numbers.cells(asked.leaf);
    std::vector<bool> is_end(numbers.size());
    std::vector<std::uint64_t> first_copies(numbers.size());
    for (std::size_t v = 0; v < numbers.size(); ++v) {
      if (numbers[v] < 0) continue;
      first_copies[v] = window.numbers.first_copy(static_cast<std::uint64_t>(numbers[v]));
      is_end[v] = std::ranges::binary_search(ends, first_copies[v]);
    }
    for (const auto& cell : cells.cells) {
      if (std::ranges::count_if(cell, [&](std::uint32_t v) { return is_end[v]; }) < 2) continue;
      std::array<const NodeOnSurface*, 6> nodes{};
      for (std::size_t e = 0; e < 6; ++e) {
        const std::uint32_t v = cell[kCellEdges[e][0]], w = cell[kCellEdges[e][1]];
        if (!is_end[v] || !is_end[w]) continue;
        const MeshEdge edge = edge_between(first_copies[v], first_copies[w]);
        const auto found = std::ranges::lower_bound(asked.nodes, edge, {}, &NodeOnSurface::edge);
        if (found != asked.nodes.end() && found->edge == edge) nodes[e] = &*found;
      }
      if (std::ranges::all_of(nodes, [](const auto* node) { return node == nullptr; })) continue;
      std::array<Point, 4> corners;
      for (std::size_t k = 0; k < 4; ++k)
        corners[k] = window.positions.of(static_cast<std::uint64_t>(numbers[cell[k]]),
                                         cells.vertices[cell[k]]);
      NodeShifts shifts{};
      for (std::size_t e = 0; e < 6; ++e)
        if (nodes[e] != nullptr)
          shifts[e] =
              nodes[e]->position - middle(corners[kCellEdges[e][0]], corners[kCellEdges[e][1]]);
      const std::uint8_t allowed = allowed_nodes(corners, shifts);
      for (std::size_t e = 0; e < 6; ++e)
        if (nodes[e] != nullptr && (allowed >> e & 1) == 0) refused.push_back(nodes[e]->edge);
    }
  });
  sort_and_unite(refused);
  return refused;
}

// Returns how many it does not keep.
std::uint64_t BoundaryNodes::keep(const Candidates& candidates, Refused& refused) {
  std::uint64_t num_refused = 0;
  for (std::size_t leaf = numbering_->first_own(); leaf < numbering_->end_own(); ++leaf) {
    throw_if_stopped(stop_);
    std::vector<NodeOnSurface> nodes = candidates.own(leaf);
    std::vector<MeshEdge> edges;
    if (!nodes.empty())
      refused.for_each_near(leaf, [&](std::span<const MeshEdge> theirs) {
        edges.insert(edges.end(), theirs.begin(), theirs.end());
      });
    std::ranges::sort(edges);
    num_refused += std::erase_if(nodes, [&](const NodeOnSurface& node) {
      return std::ranges::binary_search(edges, node.edge);
    });
    on_surface_.append(nodes);
  }
  return num_refused;
}

std::function<std::optional<BoundarySurface::Vertices>()> BoundaryNodes::nodes() const {
  return [this, first = std::uint64_t{0}]() mutable -> std::optional<BoundarySurface::Vertices> {
    const std::uint64_t count = std::min(kNodesAtOnce, nodes_.size() - first);
    if (count == 0) return std::nullopt;
    BoundarySurface::Vertices some{num_nodes_.before + first, nodes_.read(first, count), {}};
    first += count;
    return some;
  };
}

std::function<std::optional<BoundarySurface::Vertices>()> BoundaryNodes::nodes_of(
    SheetId sheet) const {
  if (!by_sheet_) return nodes();
  return [this, sheet,
          first = std::uint64_t{0}]() mutable -> std::optional<BoundarySurface::Vertices> {
    const std::uint64_t count = std::min(kNodesAtOnce, by_sheet_->num_own(sheet) - first);
    if (count == 0) return std::nullopt;
    BoundarySurface::Vertices some{
        by_sheet_->of_ranks(sheet).before + first, by_sheet_->read(sheet, first, count), {}};
    first += count;
    return some;
  };
}

}  // namespace locvol
