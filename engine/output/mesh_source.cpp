#include "engine/output/mesh_source.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <string>

#include "engine/exchange/pack.h"
#include "engine/output/stored_mesh.h"
#include "engine/shared/cell_quality.h"
#include "engine/shared/leaf_name.h"

namespace locvol {
namespace {

constexpr std::uint64_t kFullPieceBytes = std::uint64_t{1} << 20;

std::optional<SheetSides> sides_of(const SurfaceSheets& sheets, const MeshShape& shape) {
  if (!shape.is_split || !sheets.has_several_bodies()) return std::nullopt;
  return SheetSides(sheets);
}

}  // namespace

MeshSource::MeshSource(const Store& store, const std::filesystem::path& output, int num_threads,
                       const StepProgress& on_step, const StopToken* stop, Exchange& exchange,
                       const MeshShape& shape)
    : store_(store),
      snapshot_(store.snapshot()),
      run_(finished_run(store, snapshot_)),
      sheets_(snapshot_.sheets()),
      sides_(sides_of(sheets_, shape)),
      output_(output),
      on_step_(on_step),
      stop_(stop),
      exchange_(exchange),
      pages_(store),
      numbering_(snapshot_, run_, output, pages_, stop_while_alone(), exchange,
                 sides_ ? &*sides_ : nullptr),
      positions_(snapshot_, numbering_),
      workers_(num_threads),
      windows_([this, num_threads] {
        return std::make_unique<MeshWindow>(store_, numbering_, num_threads);
      }),
      end_cell_(numbering_.num_cells()) {
  if (sides_) sheets_ = sides_->sheets();
  if (shape.order > 1) number_edges();
  if (shape.is_part) become_part();
}

// The first half of the steps.
void MeshSource::number_edges() {
  edges_ = std::make_unique<EdgeNumbering>(
      snapshot_, numbering_, windows_, output_, pages_, workers_, stop_while_alone(), exchange_,
      [this](std::uint64_t num_cells) { tell_step(num_cells, 2 * own_cells().size()); });
  edge_windows_.emplace(
      [this] { return std::make_unique<EdgeWindow>(numbering_, *edges_, workers_.num_threads()); });
  boundary().set_nodes([this](const MeshEdge& edge) { return number_of_node(edge); });
  boundary_nodes_ = std::make_unique<BoundaryNodes>(store_, run_, numbering_, windows_,
                                                    *edge_windows_, boundary(), output_, pages_,
                                                    workers_, stop_while_alone(), exchange_);
}

Point MeshSource::position_of(const MeshEdge& edge) {
  constexpr std::size_t kOnSurfaceBytes = std::size_t{4} << 20;
  if (!on_surface_)
    on_surface_.emplace(kOnSurfaceBytes, [this](std::size_t leaf) {
      return LeafList<NodeOnSurface>{boundary_nodes_->on_surface(leaf)};
    });
  const auto nodes = on_surface_->get(numbering_.leaf_of(edge.a));
  const MeshEdge first =
      windows_.with([&](MeshWindow& window) { return window.numbers.first_copies(edge); });
  const auto found = std::ranges::lower_bound(nodes->values, first, {}, &NodeOnSurface::edge);
  if (found != nodes->values.end() && found->edge == first) return found->position;
  return middle(position_of(edge.a), position_of(edge.b));
}

void MeshSource::tell_step(std::uint64_t num_steps, std::uint64_t num_all) {
  if (on_step_ && num_steps > num_told_) on_step_(num_told_ = num_steps, num_all);
}

void MeshSource::become_part() {
  const NumberRange own = own_vertices(), own_nodes = this->own_nodes();
  NamedVertices named(own), named_nodes(own_nodes);
  const auto flat = [](const auto& items) {
    return items.empty() ? std::span<const std::int64_t>()
                         : std::span(items.front().data(), items.size() * items.front().size());
  };
  using Others = std::pair<std::vector<std::uint64_t>, std::vector<std::uint64_t>>;
  for_each_piece(
      {.has_cells = true},
      [&](const MeshPiece& piece) {
        return Others{named.add_own(flat(piece.cells)), named_nodes.add_own(flat(piece.nodes))};
      },
      [&](const Others& others) {
        named.add_others(others.first);
        named_nodes.add_others(others.second);
      });
  std::optional<PartVertices> nodes;
  if (edges_)
    nodes.emplace(own_nodes, std::move(named_nodes), [this](std::span<const std::uint64_t> others) {
      return positions_of_other_nodes(others);
    });
  vertices_.emplace(own, std::move(named), [this](std::span<const std::uint64_t> others) {
    return positions_of_others(others);
  });
  part_nodes_ = std::move(nodes);
  part_ = {exchange_.rank(), exchange_.num_ranks()};
  first_cell_ = numbering_.first_cell(numbering_.first_own());
  end_cell_ = numbering_.first_cell(numbering_.end_own());
}

std::vector<MeshPiece::Vertex> MeshSource::positions_of_others(
    std::span<const std::uint64_t> vertices) const {
  std::vector<MeshPiece::Vertex> positions;
  positions.reserve(vertices.size());
  for (auto vertex = vertices.begin(); vertex != vertices.end();) {
    const std::size_t leaf = numbering_.leaf_of(*vertex);
    const auto first = vertex;
    std::uint64_t number = numbering_.first_vertex(leaf);
    numbering_.for_each_vertex(snapshot_, leaf, [&](const Point& p) {
      if (vertex == vertices.end() || *vertex != number++) return;
      positions.push_back({p.x, p.y, p.z});
      ++vertex;
    });
    const MortonKey key = numbering_.leaves()[leaf];
    if (vertex == first)
      throw CorruptRecord(leaf_name(key) + ": it has fewer vertices than its rank has told", key);
  }
  return positions;
}

// Those of edges that cells list, and then those of the core, by formula.
template <class IsWanted, class Visit>
void MeshSource::for_each_node(std::size_t leaf, MeshWindow& window, EdgeWindow& edge_window,
                               const IsWanted& is_wanted, const Visit& visit) const {
  std::uint64_t number = edges_->first(leaf);
  const std::vector<NodeOnSurface> on_surface = boundary_nodes_->on_surface(leaf);
  auto next = on_surface.begin();
  for (const MeshEdge& edge : edges_->listed(leaf).values) {
    const MeshEdge first = window.numbers.first_copies(edge);
    if (numbering_.sides() != nullptr)
      next = std::ranges::lower_bound(on_surface, first, {}, &NodeOnSurface::edge);
    const bool is_on_surface = next != on_surface.end() && next->edge == first;
    if (is_wanted(number++))
      visit(is_on_surface ? next->position
                          : middle(window.positions.of(edge.a), window.positions.of(edge.b)));
    if (is_on_surface) ++next;
  }
  if (numbering_.num_core_vertices(leaf) == 0) return;
  const SiteBlock<CoreEdges>& edges = *edge_window.core(leaf, window.numbers);
  SiteBlock<Point> positions(edges.box(), Point());
  for_each_site(edges.box(), [&](const LatticeSite& site) {
    positions[site] = numbering_.lattice().position(site);
  });
  for_each_site(numbering_.sites(leaf), [&](const LatticeSite& site) {
    if (edges[site].first < 0) return;
    for (std::size_t step = 0; step < kLargerNeighbors.size(); ++step)
      if ((edges[site].steps >> step & 1) != 0 && is_wanted(number++))
        visit(middle(positions[site], positions[site + kLargerNeighbors[step]]));
  });
}

std::vector<MeshPiece::Vertex> MeshSource::positions_of_other_nodes(
    std::span<const std::uint64_t> nodes) {
  std::vector<MeshPiece::Vertex> positions;
  positions.reserve(nodes.size());
  const auto is_wanted = [&](std::uint64_t node) {
    return std::ranges::binary_search(nodes, node);
  };
  windows_.with([&](MeshWindow& window) {
    edge_windows_->with([&](EdgeWindow& edges) {
      edges_->for_each_leaf_beside([&](std::size_t leaf) {
        for_each_node(leaf, window, edges, is_wanted, [&](const Point& p) {
          positions.push_back({p.x, p.y, p.z});
        });
      });
    });
  });
  if (positions.size() != nodes.size())
    throw ExchangeError("cells have edges that no rank beside knows: this is a bug of locvol");
  return positions;
}

std::vector<std::int64_t> MeshSource::numbers_of(std::uint64_t first, std::uint64_t count) const {
  std::vector<std::int64_t> numbers(count);
  for (std::uint64_t i = 0; i < count; ++i)
    numbers[i] = static_cast<std::int64_t>(number_of(first + i));
  return numbers;
}

NumberRange MeshSource::own_vertices() const {
  if (vertices_) return {0, vertices_->size()};
  if (numbering_.first_own() == numbering_.end_own()) return {};
  return {numbering_.first_vertex(numbering_.first_own()),
          numbering_.first_vertex(numbering_.end_own())};
}

std::pair<std::uint64_t, std::uint64_t> MeshSource::range_of_numbers() const {
  if (!vertices_) return {0, num_points() - 1};
  const auto [first, last] = vertices_->range();
  if (!part_nodes_ || part_nodes_->size() == 0) return {first, last};
  return {first, part_nodes_->range().second};
}

NumberRange MeshSource::own_nodes() const {
  if (part_nodes_) return {vertices_->size(), vertices_->size() + part_nodes_->size()};
  if (!edges_ || numbering_.first_own() == numbering_.end_own()) return {};
  return {edges_->first(numbering_.first_own()), edges_->end(numbering_.end_own() - 1)};
}

NumberRange MeshSource::own_cells() const {
  if (numbering_.first_own() == numbering_.end_own() || is_surface_only()) return {};
  return {numbering_.first_cell(numbering_.first_own()) - first_cell_,
          numbering_.first_cell(numbering_.end_own()) - first_cell_};
}

std::vector<std::uint32_t> MeshSource::leaves_of_cells(std::uint64_t first,
                                                       std::uint64_t count) const {
  first += first_cell_;
  std::vector<std::uint32_t> leaves;
  leaves.reserve(count);
  if (count == 0) return leaves;
  for (std::size_t leaf = numbering_.leaf_of_cell(first); leaves.size() < count; ++leaf) {
    const std::uint64_t end = std::min(numbering_.first_cell(leaf + 1), first + count);
    leaves.resize(end - first, static_cast<std::uint32_t>(numbering_.place(leaf)));
  }
  return leaves;
}

BoundarySurface& MeshSource::boundary() {
  if (!boundary_)
    boundary_ = std::make_unique<BoundarySurface>(snapshot_, numbering_, positions_, output_,
                                                  pages_, workers_, stop_while_alone(), exchange_);
  return *boundary_;
}

NumberRange MeshSource::own_triangles() {
  const std::uint64_t first = part_ ? 0 : boundary().num_facets_of_lower_ranks();
  return {first, first + boundary().num_own_facets()};
}

std::function<std::optional<TrianglePiece>()> MeshSource::triangles() {
  return [this, next = boundary().facets({}),
          first = own_triangles().first]() mutable -> std::optional<TrianglePiece> {
    const auto some = next();
    if (!some) return std::nullopt;
    TrianglePiece piece{first, {}, {}, {}, {}};
    for (const auto& nodes : some->nodes)
      std::ranges::transform(nodes, piece.nodes.emplace_back().begin(), [&](std::uint64_t node) {
        return static_cast<std::int64_t>(place_of_node(node));
      });
    for (const BoundaryFacet& facet : some->facets) {
      TrianglePiece::Triangle& triangle = piece.triangles.emplace_back();
      std::ranges::transform(facet.vertices, triangle.begin(), [&](std::uint64_t vertex) {
        return static_cast<std::int64_t>(vertices_ ? vertices_->place_of(vertex) : vertex);
      });
      piece.leaves.push_back(
          static_cast<std::uint32_t>(numbering_.place(numbering_.leaf_of_cell(facet.cell))));
      piece.sheets.push_back(facet.labels.sheet);
    }
    first += piece.triangles.size();
    return piece;
  };
}

KeptCreases& MeshSource::creases() {
  if (creases_) return *creases_;
  creases_ = std::make_unique<KeptCreases>(snapshot_, run_, numbering_, boundary(), output_, pages_,
                                           stop_while_alone(), exchange_);
  if (edges_) creases_->set_nodes([this](const MeshEdge& edge) { return number_of_node(edge); });
  return *creases_;
}

std::uint64_t MeshSource::num_crease_edges() {
  if (!has_creases()) return 0;
  return part_ ? creases().num_own_edges() : creases().num_edges();
}

NumberRange MeshSource::own_lines() {
  if (!has_creases()) return {};
  const std::uint64_t first = part_ ? 0 : creases().num_edges_of_lower_ranks();
  return {first, first + creases().num_own_edges()};
}

std::function<std::optional<LinePiece>()> MeshSource::lines() {
  if (!has_creases()) return [] { return std::optional<LinePiece>(); };
  return [this, next = creases().edges(),
          first = own_lines().first]() mutable -> std::optional<LinePiece> {
    const auto some = next();
    if (!some) return std::nullopt;
    LinePiece piece{first, {}, {}, {}, {}};
    for (const std::uint64_t node : some->nodes)
      piece.nodes.push_back({static_cast<std::int64_t>(place_of_node(node))});
    for (const KeptEdge& edge : some->edges) {
      LinePiece::Line& line = piece.lines.emplace_back();
      std::ranges::transform(edge.vertices, line.begin(), [&](std::uint64_t vertex) {
        return static_cast<std::int64_t>(vertices_ ? vertices_->place_of(vertex) : vertex);
      });
      piece.leaves.push_back(
          static_cast<std::uint32_t>(numbering_.place(numbering_.leaf_of_cell(edge.cell))));
      piece.creases.push_back(static_cast<CreaseId>(edge.crease));
    }
    first += piece.lines.size();
    return piece;
  };
}

std::vector<KeptCorner> MeshSource::corners() {
  std::vector<KeptCorner> corners;
  if (!has_creases()) return corners;
  std::ranges::copy_if(creases().corners(), std::back_inserter(corners),
                       [&](const KeptCorner& corner) { return has_cell(corner.cell); });
  if (vertices_)
    for (KeptCorner& corner : corners) corner.vertex = vertices_->place_of(corner.vertex);
  return corners;
}

std::vector<KeptCorner> MeshSource::corners_by_vertex() {
  std::vector<KeptCorner> corners;
  if (!has_creases()) return corners;
  for (KeptCorner corner : creases().corners()) {
    if (vertices_ && !vertices_->has(corner.vertex)) continue;
    if (vertices_) corner.vertex = vertices_->place_of(corner.vertex);
    corners.push_back(corner);
  }
  std::ranges::sort(corners, {}, &KeptCorner::vertex);
  return corners;
}

std::uint64_t MeshSource::bytes_of(std::size_t leaf, const PieceParts& parts) const {
  const std::uint64_t num_vertices =
      numbering_.first_vertex(leaf + 1) - numbering_.first_vertex(leaf);
  const std::uint64_t num_cells =
      is_surface_only() ? 0 : numbering_.first_cell(leaf + 1) - numbering_.first_cell(leaf);
  const std::uint64_t num_listed = num_cells - numbering_.num_core_cells(leaf);
  const std::uint64_t bytes_of_cell =
      sizeof(MeshPiece::Cell) + (edges_ ? sizeof(MeshPiece::Nodes) : 0);
  const std::uint64_t num_nodes =
      edges_ && parts.has_node_points ? edges_->end(leaf) - edges_->first(leaf) : 0;
  return (parts.has_points ? sizeof(MeshPiece::Vertex) * num_vertices : 0) +
         sizeof(MeshPiece::Vertex) * num_nodes + (parts.has_cells ? bytes_of_cell * num_cells : 0) +
         (parts.has_corners ? sizeof(std::array<Point, 4>) * num_listed : 0);
}

std::function<std::optional<MeshSource::PieceRange>()> MeshSource::ranges(const PieceParts& parts) {
  // Of a part, those of other ranks come last.
  const std::size_t num_others =
      vertices_ && parts.has_points ? vertices_->other_positions().size() : 0;
  const std::size_t num_other_nodes =
      part_nodes_ && parts.has_node_points ? part_nodes_->other_positions().size() : 0;
  return
      [this, parts, leaf = numbering_.first_own(), num_others, num_other_nodes,
       other = std::size_t{0}, other_node = std::size_t{0}]() mutable -> std::optional<PieceRange> {
        throw_if_stopped(stop_);
        constexpr std::size_t kOthersAtOnce = kFullPieceBytes / sizeof(MeshPiece::Vertex);
        const auto next_of = [](std::size_t& next, std::size_t end) {
          const std::size_t first = std::exchange(next, std::min(next + kOthersAtOnce, end));
          return std::pair{first, next};
        };
        if (leaf == numbering_.end_own()) {
          if (other < num_others) {
            const auto [first, end] = next_of(other, num_others);
            return PieceRange{first, end, true, false};
          }
          if (other_node == num_other_nodes) return std::nullopt;
          const auto [first, end] = next_of(other_node, num_other_nodes);
          return PieceRange{first, end, true, true};
        }
        PieceRange range{leaf, leaf};
        std::uint64_t bytes = 0;
        for (; range.end < numbering_.end_own() && bytes < kFullPieceBytes; ++range.end)
          bytes += bytes_of(range.end, parts);
        leaf = range.end;
        pages_.count(bytes);
        const NumberRange own = own_cells();
        const std::uint64_t num_before = edges_ ? own.size() : 0;
        if (parts.has_cells && own.size() > 0)
          tell_step(num_before + numbering_.first_cell(leaf) - first_cell_ - own.first,
                    num_before + own.size());
        return range;
      };
}

const BodyCells& MeshSource::body_cells() {
  if (body_cells_) return *body_cells_;
  struct BodiesOfLeaves {
    std::vector<BodyId> bodies;
    std::vector<LeafRun> runs;
  };
  body_cells_.emplace(num_bodies());
  do_on_all(exchange(), [&] {
    for_each_piece(
        {.has_cells = true},
        [](const MeshPiece& piece) {
          return BodiesOfLeaves{piece.bodies, piece.runs};
        },
        [&](const BodiesOfLeaves& piece) {
          std::span<const BodyId> left(piece.bodies);
          for (const LeafRun& run : piece.runs) {
            const std::uint64_t num = run.num_listed + run.num_core;
            body_cells_->append_leaf(left.first(num));
            left = left.subspan(num);
          }
        });
  });
  const std::vector<std::uint64_t> own(body_cells_->num_own().begin(),
                                       body_cells_->num_own().end());
  std::vector<std::uint64_t> all(own.size()), before(own.size());
  int rank = 0;
  for (const std::vector<std::uint64_t>& of_rank : gather_values(exchange(), own)) {
    for (std::size_t b = 0; b < own.size(); ++b) {
      all[b] += of_rank[b];
      if (rank < exchange().rank()) before[b] += of_rank[b];
    }
    ++rank;
  }
  body_cells_->set_ranks(std::move(all), std::move(before));
  return *body_cells_;
}

std::function<std::optional<MeshPiece>()> MeshSource::pieces(const PieceParts& parts) {
  return [this, parts, next = ranges(parts)]() -> std::optional<MeshPiece> {
    const auto range = next();
    if (!range) return std::nullopt;
    return read(*range, parts);
  };
}

MeshPiece MeshSource::others(const PieceRange& range) const {
  MeshPiece piece;
  const PartVertices& vertices = range.is_of_other_nodes ? *part_nodes_ : *vertices_;
  const auto positions = vertices.other_positions().subspan(range.first, range.end - range.first);
  std::vector<MeshPiece::Vertex>& points =
      range.is_of_other_nodes ? piece.node_points : piece.points;
  points.assign(positions.begin(), positions.end());
  piece.first_vertex = num_vertices();
  piece.first_node = num_points();
  piece.first_cell = num_cells();
  if (range.is_of_other_nodes)
    piece.first_node = num_vertices() + vertices.num_own() + range.first;
  else
    piece.first_vertex = vertices.num_own() + range.first;
  return piece;
}

MeshPiece MeshSource::read(const PieceRange& range, const PieceParts& parts) {
  if (range.is_of_others) return others(range);
  MeshPiece piece;
  const std::uint64_t first_vertex = numbering_.first_vertex(range.first);
  piece.first_vertex = vertices_ ? vertices_->place_of_own(first_vertex) : first_vertex;
  if (!is_surface_only()) piece.first_cell = numbering_.first_cell(range.first) - first_cell_;
  if (edges_) piece.first_node = edges_->first(range.first);
  if (part_nodes_)
    piece.first_node = vertices_->size() + part_nodes_->place_of_own(piece.first_node);
  const auto add = [&](MeshWindow& window, EdgeWindow* edges) {
    for (std::size_t leaf = range.first; leaf < range.end; ++leaf) {
      if (parts.has_points) add_points(leaf, window, piece);
      if (parts.has_node_points && edges != nullptr)
        for_each_node(
            leaf, window, *edges,
            [&](std::uint64_t node) { return !part_nodes_ || part_nodes_->has_own(node); },
            [&](const Point& p) {
              piece.node_points.push_back({p.x, p.y, p.z});
            });
      if (parts.has_cells && !is_surface_only())
        add_cells(leaf, parts.has_corners, window, edges, piece);
    }
  };
  windows_.with([&](MeshWindow& window) {
    if (!edge_windows_) return add(window, nullptr);
    edge_windows_->with([&](EdgeWindow& edges) { add(window, &edges); });
  });
  if (vertices_)
    for (MeshPiece::Cell& cell : piece.cells)
      for (std::int64_t& vertex : cell)
        vertex = static_cast<std::int64_t>(vertices_->place_of(static_cast<std::uint64_t>(vertex)));
  for (MeshPiece::Nodes& nodes : piece.nodes)
    for (std::int64_t& node : nodes)
      node = static_cast<std::int64_t>(place_of_node(static_cast<std::uint64_t>(node)));
  return piece;
}

void MeshSource::add_points(std::size_t leaf, const MeshWindow& window, MeshPiece& piece) const {
  std::uint64_t number = numbering_.first_vertex(leaf);
  numbering_.for_each_vertex(window.snapshot, leaf, [&](const Point& p) {
    if (!vertices_ || vertices_->has_own(number)) piece.points.push_back({p.x, p.y, p.z});
    ++number;
  });
}

// The cells of the leaf's core, by formula. Returns how many there are.
std::uint64_t MeshSource::add_core_cells(std::size_t leaf, MeshWindow& window,
                                         EdgeWindow* edge_window, MeshPiece& piece) const {
  // Not asked for leaves outside, which may be a thousand λ wide.
  if (numbering_.num_core_vertices(leaf) == 0) return 0;
  const SiteBlock<std::int64_t>* numbers = window.numbers.core_numbers(leaf);
  const SiteBlock<CoreEdges>* edges =
      edge_window != nullptr ? edge_window->core(leaf, window.numbers) : nullptr;
  const std::size_t num_before = piece.cells.size();
  for_each_site(numbering_.sites(leaf), [&](const LatticeSite& site) {
    const std::int64_t here = (*numbers)[site];
    if (here < 0) return;
    std::array<std::int64_t, kLargerNeighbors.size()> others{};
    for (std::size_t n = 0; n < others.size(); ++n)
      others[n] = (*numbers)[site + kLargerNeighbors[n]];
    for (std::size_t c = 0; c < kCellsOfLargerNeighbors.size(); ++c) {
      const auto& [p, q, r] = kCellsOfLargerNeighbors[c];
      if (others[p] < 0 || others[q] < 0 || others[r] < 0) continue;
      piece.cells.push_back({here, others[p], others[q], others[r]});
      if (edges == nullptr) continue;
      MeshPiece::Nodes& nodes = piece.nodes.emplace_back();
      for (std::size_t e = 0; e < nodes.size(); ++e) {
        const auto& [from, step] = kCoreCellEdges[c][e];
        const CoreEdges& at =
            (*edges)[from == CoreCellEdge::kOrigin ? site : site + kLargerNeighbors[from]];
        nodes[e] = at.number(step);
      }
    }
  });
  if (has_bodies()) add_core_bodies(leaf, window, piece);
  return piece.cells.size() - num_before;
}

// All sites of a cell are of one body. As many follow as the cells before lack.
void MeshSource::add_core_bodies(std::size_t leaf, MeshWindow& window, MeshPiece& piece) const {
  const SiteBox sites = numbering_.sites(leaf);
  const SiteBlock<BodyId> bodies = bodies_of_core(*window.numbers.core(leaf), sites);
  const SiteBlock<std::int64_t>* numbers = window.numbers.core_numbers(leaf);
  for_each_site(sites, [&](const LatticeSite& site) {
    if ((*numbers)[site] < 0) return;
    for (const auto& [p, q, r] : kCellsOfLargerNeighbors)
      if ((*numbers)[site + kLargerNeighbors[p]] >= 0 &&
          (*numbers)[site + kLargerNeighbors[q]] >= 0 &&
          (*numbers)[site + kLargerNeighbors[r]] >= 0)
        piece.bodies.push_back(bodies[site]);
  });
}

void MeshSource::add_cells(std::size_t leaf, bool has_corners, MeshWindow& window,
                           EdgeWindow* edge_window, MeshPiece& piece) const {
  const MortonKey key = numbering_.leaves()[leaf];
  const auto [cells, numbers] = window.numbers.cells(leaf);
  for (const auto& [a, b, c, d] : cells.cells)
    piece.cells.push_back({numbers[a], numbers[b], numbers[c], numbers[d]});
  if (edge_window != nullptr) {
    const CellEdges edges(cells.cells, numbers);
    const std::vector<std::int64_t> nodes =
        edge_window->numbers(leaf, cells, numbers, edges, window.numbers);
    for (const auto& cell : cells.cells) {
      MeshPiece::Nodes& of_cell = piece.nodes.emplace_back();
      std::ranges::transform(kCellEdges, of_cell.begin(), [&](const auto& ends) {
        return nodes[edges.place_of(cell[ends[0]], cell[ends[1]])];
      });
    }
  }
  if (has_corners) {
    const std::vector<Point> positions = window.positions.of(cells.vertices, numbers);
    for (const auto& [a, b, c, d] : cells.cells)
      piece.corners.push_back({positions[a], positions[b], positions[c], positions[d]});
  }
  if (has_bodies())
    for (std::size_t i = 0; i < cells.cells.size(); ++i) piece.bodies.push_back(cells.body_of(i));
  const std::uint64_t num_core = add_core_cells(leaf, window, edge_window, piece);
  if (num_core != numbering_.num_core_cells(leaf))
    throw CorruptRecord(leaf_name(key) + ": its count of core cells is not theirs", key);
  piece.runs.push_back(
      {static_cast<std::uint32_t>(numbering_.place(leaf)), cells.cells.size(), num_core});
}

std::vector<QualityValues> quality_of(const MeshPiece& piece) {
  static const QualityValues core = {static_cast<float>(std::sqrt(5.0 / 12)), 60};
  std::vector<QualityValues> values;
  values.reserve(piece.cells.size());
  auto corners = piece.corners.begin();
  for (const LeafRun& run : piece.runs) {
    for (std::uint64_t i = 0; i < run.num_listed; ++i) {
      const CellQuality q = quality_of(*corners++);
      values.push_back(
          {static_cast<float>(q.radius_edge_ratio), static_cast<float>(q.min_dihedral_degrees)});
    }
    values.insert(values.end(), run.num_core, core);
  }
  return values;
}

std::vector<std::uint32_t> leaves_of(const MeshPiece& piece) {
  std::vector<std::uint32_t> leaves;
  leaves.reserve(piece.cells.size());
  for (const LeafRun& run : piece.runs)
    leaves.insert(leaves.end(), run.num_listed + run.num_core, run.leaf);
  return leaves;
}

}  // namespace locvol
