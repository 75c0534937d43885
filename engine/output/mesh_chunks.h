// Hands out a finished mesh piece by piece, each with all that its cells need.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "engine/output/leaf_window.h"
#include "engine/output/mesh_source.h"
#include "engine/output/vertex_numbering.h"
#include "engine/output/vertex_positions.h"

namespace locvol {

// The cells of some leaves, one after another in Morton order, and their vertices: own ones, which
// have the numbers from first_vertex on, and those that are own ones of other chunks.
struct MeshChunk {
  using Vertex = std::array<double, 3>;
  using Cell = std::array<std::uint32_t, 4>;

  std::uint64_t first_vertex = 0, first_cell = 0;
  std::uint32_t num_own = 0;
  std::vector<Vertex> vertices;
  std::vector<std::uint64_t> numbers;  // of the vertices, as in the writers' files
  std::vector<Cell> cells;             // indices into `vertices`, positively oriented
  std::vector<BodyId> bodies;          // of the cells; empty: there is one

  // Of second order: nodes in the middle of edges, likewise; and those of each cell, as indices
  // into `nodes`, in the order of kCellEdges.
  std::uint64_t first_node = 0;
  std::uint32_t num_own_nodes = 0;
  std::vector<Vertex> nodes;
  std::vector<std::uint64_t> node_numbers;
  std::vector<std::array<std::uint32_t, 6>> cell_nodes;
};

// Bytes of a chunk, of its own vertices and its cells: it ends with the leaf that reaches them.
inline constexpr std::size_t kChunkBytes = std::size_t{1} << 20;

// Memory: a chunk takes `chunk_bytes` or a leaf; besides, 28 MB for points of leaves near.
// Errors: CorruptRecord.
class ChunkReader {
 public:
  // All must outlive this object.
  ChunkReader(const Reader& reader, const VertexNumbering& numbering, PageRelease& pages,
              std::size_t chunk_bytes = kChunkBytes);

  // The next chunk of the rank's own leaves, in order; cells are counted from the first of these
  // on. Nothing, if there are no more.
  std::optional<MeshChunk> next();

 private:
  // A vertex, by its number.
  struct Numbered {
    std::uint64_t number = 0;
    Point position;
  };
  // Cells by the numbers of their vertices, and where those of other leaves lie.
  struct NumberedCells {
    std::vector<std::array<std::uint64_t, 4>> cells;
    std::vector<BodyId> bodies;
    std::vector<Numbered> foreign;
  };

  void add_own(std::size_t leaf, MeshChunk& chunk);
  void add_stored_cells(std::size_t leaf, NumberedCells& out);
  void add_core_cells(std::size_t leaf, NumberedCells& out);
  static void complete(NumberedCells numbered, MeshChunk& chunk);

  const Reader& reader_;
  const VertexNumbering& numbering_;
  PageRelease& pages_;
  std::size_t chunk_bytes_;
  std::size_t next_leaf_;
  std::uint64_t num_cells_ = 0;  // of the chunks before
  bool has_bodies_;              // several
  NumberWindow numbers_;
  VertexPositions positions_;
};

// The same chunks of a mesh of second order, but for where one ends. Gives one after another, and
// then nothing; `mesh` must outlive it.
// Memory: as MeshSource. Errors: StoreError; std::system_error.
std::function<std::optional<MeshChunk>()> chunks_of_second_order(MeshSource& mesh);

}  // namespace locvol
