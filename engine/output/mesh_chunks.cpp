#include "engine/output/mesh_chunks.h"

#include <algorithm>
#include <optional>
#include <string>
#include <utility>

#include "engine/shared/leaf_name.h"
#include "octree/lattice.h"
#include "octree/site_block.h"
#include "octree/sort_and_unite.h"

namespace locvol {

ChunkReader::ChunkReader(const Reader& reader, const VertexNumbering& numbering, PageRelease& pages,
                         std::size_t chunk_bytes)
    : reader_(reader),
      numbering_(numbering),
      pages_(pages),
      chunk_bytes_(chunk_bytes),
      next_leaf_(numbering.first_own()),
      has_bodies_(reader.sheets().has_several_bodies()),
      numbers_(reader, numbering),
      positions_(reader, numbering) {}

std::optional<MeshChunk> ChunkReader::next() {
  const std::size_t end = numbering_.end_own();
  while (next_leaf_ < end) {
    MeshChunk chunk;
    chunk.first_vertex = numbering_.first_vertex(next_leaf_);
    chunk.first_cell = num_cells_;
    NumberedCells numbered;
    const auto bytes = [&] {
      return chunk.vertices.size() * sizeof chunk.vertices[0] +
             numbered.cells.size() * sizeof numbered.cells[0];
    };
    for (; next_leaf_ < end && bytes() < chunk_bytes_; ++next_leaf_) {
      add_own(next_leaf_, chunk);
      add_stored_cells(next_leaf_, numbered);
      add_core_cells(next_leaf_, numbered);
    }
    pages_.count(bytes());
    complete(std::move(numbered), chunk);
    num_cells_ += chunk.cells.size();
    if (!chunk.vertices.empty()) return chunk;
  }
  return std::nullopt;
}

void ChunkReader::add_own(std::size_t leaf, MeshChunk& chunk) {
  numbering_.for_each_vertex(reader_, leaf, [&](const Point& p) {
    chunk.numbers.push_back(chunk.first_vertex + chunk.vertices.size());
    chunk.vertices.push_back({p.x, p.y, p.z});
  });
  chunk.num_own = static_cast<std::uint32_t>(chunk.vertices.size());
}

void ChunkReader::add_stored_cells(std::size_t leaf, NumberedCells& out) {
  const auto [cells, numbers] = numbers_.cells(leaf);
  for (const auto& cell : cells.cells) {
    auto& numbered = out.cells.emplace_back();
    for (std::size_t i = 0; i < 4; ++i) numbered[i] = static_cast<std::uint64_t>(numbers[cell[i]]);
  }
  if (has_bodies_)
    for (std::size_t i = 0; i < cells.cells.size(); ++i) out.bodies.push_back(cells.body_of(i));
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    if (numbers[i] < 0) continue;  // in none of the cells
    const auto number = static_cast<std::uint64_t>(numbers[i]);
    if (numbering_.leaf_of(number) == leaf) continue;
    out.foreign.push_back({number, positions_.of(number, cells.vertices[i])});
  }
}

void ChunkReader::add_core_cells(std::size_t leaf, NumberedCells& out) {
  const std::size_t num_before = out.cells.size();
  const auto check_count = [&] {
    if (out.cells.size() - num_before == numbering_.num_core_cells(leaf)) return;
    const MortonKey key = numbering_.leaves()[leaf];
    throw CorruptRecord(leaf_name(key) + ": its count of core cells is not theirs", key);
  };
  // Not asked for leaves outside, which may be a thousand λ wide.
  if (numbering_.num_core_vertices(leaf) == 0) return check_count();
  const SiteBlock<std::int64_t>& numbers = *numbers_.core_numbers(leaf);
  const SiteBox sites = numbering_.sites(leaf);
  const auto number = [&](const LatticeSite& site) {
    const auto vertex = static_cast<std::uint64_t>(numbers[site]);
    if (!sites.contains(site)) out.foreign.push_back({vertex, numbering_.lattice().position(site)});
    return vertex;
  };
  std::optional<SiteBlock<BodyId>> bodies;
  if (has_bodies_) bodies = bodies_of_core(*numbers_.core(leaf), sites);
  for_each_core_cell(
      sites, [&](const LatticeSite& site) { return numbers[site] >= 0; },
      [&](const LatticeSite& site, const LatticeCell& cell) {
        out.cells.push_back(
            {number(site), number(site + cell[0]), number(site + cell[1]), number(site + cell[2])});
        if (bodies) out.bodies.push_back((*bodies)[site]);
      });
}

// Appends the foreign vertices, once each, and gives the cells their indices.
void ChunkReader::complete(NumberedCells numbered, MeshChunk& chunk) {
  std::vector<Numbered>& foreign = numbered.foreign;
  const std::uint64_t first = chunk.first_vertex;
  const auto is_own = [&](std::uint64_t number) {
    return number >= first && number - first < chunk.num_own;
  };
  std::erase_if(foreign, [&](const Numbered& v) { return is_own(v.number); });
  sort_and_unite(foreign, &Numbered::number);
  for (const auto& [number, p] : foreign) {
    chunk.numbers.push_back(number);
    chunk.vertices.push_back({p.x, p.y, p.z});
  }
  const auto foreign_numbers = std::span(chunk.numbers).subspan(chunk.num_own);
  const auto index_of = [&](std::uint64_t number) {
    if (is_own(number)) return static_cast<std::uint32_t>(number - first);
    const auto place = std::ranges::lower_bound(foreign_numbers, number);
    return static_cast<std::uint32_t>(chunk.num_own + (place - foreign_numbers.begin()));
  };
  chunk.cells.reserve(numbered.cells.size());
  for (const auto& [a, b, c, d] : numbered.cells)
    chunk.cells.push_back({index_of(a), index_of(b), index_of(c), index_of(d)});
  chunk.bodies = std::move(numbered.bodies);
}

namespace {

// A list of own points, which have numbers that follow each other, and then of others.
class NumberedPoints {
 public:
  NumberedPoints(std::uint64_t first, std::vector<MeshChunk::Vertex>& points,
                 std::vector<std::uint64_t>& numbers)
      : first_(first), num_own_(points.size()), points_(points), numbers_(numbers) {
    for (std::size_t i = 0; i < num_own_; ++i) numbers_.push_back(first + i);
  }
  bool is_own(std::uint64_t number) const { return number >= first_ && number - first_ < num_own_; }
  // Others come in the order of their numbers.
  void add_other(std::uint64_t number, const Point& p) {
    numbers_.push_back(number);
    points_.push_back({p.x, p.y, p.z});
  }
  std::uint32_t index_of(std::int64_t number) const {
    const auto wanted = static_cast<std::uint64_t>(number);
    if (is_own(wanted)) return static_cast<std::uint32_t>(wanted - first_);
    const auto others = std::span(numbers_).subspan(num_own_);
    const auto place = std::ranges::lower_bound(others, wanted) - others.begin();
    return static_cast<std::uint32_t>(num_own_) + static_cast<std::uint32_t>(place);
  }

 private:
  std::uint64_t first_;
  std::size_t num_own_;
  std::vector<MeshChunk::Vertex>& points_;
  std::vector<std::uint64_t>& numbers_;
};

MeshChunk chunk_of_second_order(MeshSource& mesh, const MeshPiece& piece) {
  struct OtherNode {
    std::uint64_t number = 0;
    MeshEdge edge;
  };
  MeshChunk chunk;
  chunk.first_vertex = piece.first_vertex;
  chunk.first_cell = piece.first_cell;
  chunk.first_node = piece.first_node;
  chunk.vertices = piece.points;
  chunk.nodes = piece.node_points;
  chunk.bodies = piece.bodies;
  chunk.num_own = static_cast<std::uint32_t>(chunk.vertices.size());
  chunk.num_own_nodes = static_cast<std::uint32_t>(chunk.nodes.size());
  NumberedPoints vertices(chunk.first_vertex, chunk.vertices, chunk.numbers),
      nodes(chunk.first_node, chunk.nodes, chunk.node_numbers);
  std::vector<std::uint64_t> other_vertices;
  std::vector<OtherNode> other_nodes;
  for (std::size_t c = 0; c < piece.cells.size(); ++c) {
    const auto vertex = [&](std::size_t k) {
      return static_cast<std::uint64_t>(piece.cells[c][k]);
    };
    for (std::size_t k = 0; k < 4; ++k)
      if (!vertices.is_own(vertex(k))) other_vertices.push_back(vertex(k));
    for (std::size_t e = 0; e < kCellEdges.size(); ++e) {
      const auto number = static_cast<std::uint64_t>(piece.nodes[c][e]);
      const auto& [i, j] = kCellEdges[e];
      if (!nodes.is_own(number))
        other_nodes.push_back({number, edge_between(vertex(i), vertex(j))});
    }
  }
  sort_and_unite(other_vertices);
  sort_and_unite(other_nodes, &OtherNode::number);
  for (const std::uint64_t vertex : other_vertices)
    vertices.add_other(vertex, mesh.position_of(vertex));
  for (const auto& [number, edge] : other_nodes) nodes.add_other(number, mesh.position_of(edge));
  for (std::size_t c = 0; c < piece.cells.size(); ++c) {
    std::ranges::transform(piece.cells[c], chunk.cells.emplace_back().begin(),
                           [&](std::int64_t v) { return vertices.index_of(v); });
    std::ranges::transform(piece.nodes[c], chunk.cell_nodes.emplace_back().begin(),
                           [&](std::int64_t n) { return nodes.index_of(n); });
  }
  return chunk;
}

}  // namespace

std::function<std::optional<MeshChunk>()> chunks_of_second_order(MeshSource& mesh) {
  const auto next = mesh.pieces({.has_points = true, .has_cells = true, .has_node_points = true});
  return [&mesh, next]() -> std::optional<MeshChunk> {
    while (const auto piece = next()) {
      MeshChunk chunk = chunk_of_second_order(mesh, *piece);
      if (!chunk.vertices.empty() || !chunk.nodes.empty()) return chunk;
    }
    return std::nullopt;
  };
}

}  // namespace locvol
