// MeshSource is the finished mesh of a store, as every format takes it: numbered, and in pieces.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "engine/exchange/exchange.h"
#include "engine/exchange/one_rank.h"
#include "engine/output/body_cells.h"
#include "engine/output/boundary_nodes.h"
#include "engine/output/boundary_surface.h"
#include "engine/output/edge_numbering.h"
#include "engine/output/edge_window.h"
#include "engine/output/kept_creases.h"
#include "engine/output/leaf_window.h"
#include "engine/output/mesh_window.h"
#include "engine/output/number_range.h"
#include "engine/output/part_vertices.h"
#include "engine/output/vertex_copies.h"
#include "engine/output/vertex_numbering.h"
#include "engine/output/vertex_positions.h"
#include "engine/shared/encode_in_order.h"
#include "engine/shared/step_progress.h"
#include "engine/shared/workers.h"
#include "storage/store.h"

namespace locvol {

// The cells of one leaf: first those that its record lists, then those of the lattice core.
struct LeafRun {
  std::uint32_t leaf = 0;  // its place in Morton order, among all
  std::uint64_t num_listed = 0, num_core = 0;
};

// Some leaves, one after another in Morton order; of a part, at last vertices of other ranks alone.
// What was not asked for is empty.
struct MeshPiece {
  using Vertex = std::array<double, 3>;
  using Cell = std::array<std::int64_t, 4>;  // positively oriented

  std::uint64_t first_vertex = 0, first_cell = 0;
  std::vector<Vertex> points;
  std::vector<Cell> cells;
  // Of second order: where the nodes in the middle of edges lie, and which each cell has, in the
  // order of kCellEdges.
  using Nodes = std::array<std::int64_t, 6>;
  std::uint64_t first_node = 0;
  std::vector<Vertex> node_points;
  std::vector<Nodes> nodes;
  std::vector<LeafRun> runs;   // of the cells
  std::vector<BodyId> bodies;  // of the cells; empty: there is one
  BodyId body_of(std::size_t cell) const { return bodies.empty() ? kOnlyBody : bodies[cell]; }
  std::vector<std::array<Point, 4>> corners;  // of the listed cells
};

// Some triangles of the boundary, which come after the cells where both are written as cells.
struct TrianglePiece {
  using Triangle = std::array<std::int64_t, 3>;  // outward

  std::uint64_t first = 0;  // among the triangles
  std::vector<Triangle> triangles;
  std::vector<Triangle> nodes;        // of second order: as BoundarySurface::Facets has them
  std::vector<std::uint32_t> leaves;  // those of their cells
  std::vector<SheetId> sheets;
};

// Some edges of creases, which come after the triangles.
struct LinePiece {
  using Line = std::array<std::int64_t, 2>;

  std::uint64_t first = 0;  // among the edges
  std::vector<Line> lines;
  std::vector<std::array<std::int64_t, 1>> nodes;  // of second order: one of each
  std::vector<std::uint32_t> leaves;               // those of their cells
  std::vector<CreaseId> creases;
};

struct PieceParts {
  bool has_points = false, has_cells = false;
  bool has_corners = false;      // with the cells
  bool has_node_points = false;  // there are none of first order
};

// Of one cell.
struct QualityValues {
  float radius_edge_ratio = 0, min_dihedral_degrees = 0;
};

// Which rank's part of a mesh.
struct MeshPart {
  int rank = 0, num_ranks = 1;
};

// What is to be had of a mesh.
struct MeshShape {
  bool is_part = false;   // of one rank
  int order = 1;          // or 2
  bool is_split = false;  // bodies share no vertices, see vertex_copies.h
};

// Vertices are numbered as VertexNumbering says, cells leaf by leaf in the same order. A part is
// what one rank has, as a mesh by itself: its cells, from 0 on, with all of their vertices, which
// have the numbers of PartVertices.
// Of second order, there are nodes in the middle of edges, which have the numbers after those of
// the vertices, as EdgeNumbering says; on the boundary they lie on the surface (BoundaryNodes).
// Memory: that of VertexNumbering, PartVertices and BoundarySurface; of second order those of
// EdgeNumbering, EdgeWindow and BoundaryNodes, too; 8 MB for the points near a
// leaf and those of NumberWindow, which the threads divide, and for each thread a piece: a
// mebibyte, or a leaf more.
// Threads: used by one at a time; what is given to encode is called from any.
// Errors: StoreError; CorruptRecord; std::system_error of the files beside the output.
class MeshSource {
 public:
  // The run must be done, and `store` outlive this object. `output`: temporary files lie beside it.
  // Steps are the rank's cells, told in the first pass over them. Any pass throws Stopped.
  // `exchange`: see VertexNumbering; then pieces are of own leaves, and numbers of all ranks, but
  // for a part.
  MeshSource(const Store& store, const std::filesystem::path& output, int num_threads,
             const StepProgress& on_step = {}, const StopToken* stop = nullptr,
             Exchange& exchange = alone(), const MeshShape& shape = {});

  const RunRecord& run() const { return run_; }
  const std::filesystem::path& output() const { return output_; }
  const SurfaceSheets& sheets() const { return sheets_; }
  bool has_bodies() const { return sheets_.has_several_bodies(); }
  std::size_t num_bodies() const { return has_bodies() ? sheets_.bodies.size() : 1; }
  // Found by a pass over the cells at the first call, which all ranks make. REQUIRES: has_bodies()
  const BodyCells& body_cells();
  std::uint64_t num_vertices() const { return vertices_ ? vertices_->size() : num_all_vertices(); }
  bool is_surface_only() const { return numbering_.is_surface_only(); }
  std::uint64_t num_cells() const { return is_surface_only() ? 0 : end_cell_ - first_cell_; }
  int order() const { return edges_ ? 2 : 1; }
  // Of second order: nodes, which have the numbers after those of the vertices.
  std::uint64_t num_nodes() const { return part_nodes_ ? part_nodes_->size() : num_all_nodes(); }
  std::uint64_t num_points() const { return num_vertices() + num_nodes(); }
  NumberRange own_nodes() const;
  // Of the first own leaf, among all: see LeafRun.
  std::uint64_t first_place() const { return numbering_.place(numbering_.first_own()); }
  // REQUIRES: it is of second order
  const BoundaryNodes& boundary_nodes() const { return *boundary_nodes_; }
  // Where vertices and nodes of own cells lie, by their numbers in the mesh of all; fast for those
  // that lie near the ones before.
  Point position_of(std::uint64_t vertex) { return positions_.of(vertex); }
  Point position_of(const MeshEdge& edge);
  // Of those that have this mesh together: of a rank's part, that is the rank alone.
  Exchange& exchange() const { return part_ ? alone() : exchange_; }
  bool is_of_first_rank() const { return exchange().rank() == 0; }
  // What the pieces hold of it.
  NumberRange own_vertices() const;
  NumberRange own_cells() const;
  // The leaves of some own cells, one after another; safe from many threads.
  std::vector<std::uint32_t> leaves_of_cells(std::uint64_t first, std::uint64_t count) const;
  // Of a part, what it is of the mesh of all ranks; else that is the same. Safe from many threads.
  std::optional<MeshPart> part() const { return part_; }
  std::uint64_t num_all_vertices() const { return numbering_.num_vertices(); }
  std::uint64_t num_all_cells() const { return is_surface_only() ? 0 : numbering_.num_cells(); }
  std::uint64_t num_all_nodes() const { return edges_ ? edges_->size() : 0; }
  std::uint64_t first_of_all_cells() const { return first_cell_; }
  // Of vertices and nodes.
  std::uint64_t number_of(std::uint64_t point) const {
    if (!vertices_) return point;
    return point < vertices_->size() ? vertices_->number_of(point)
                                     : part_nodes_->number_of(point - vertices_->size());
  }
  std::vector<std::int64_t> numbers_of(std::uint64_t first, std::uint64_t count) const;
  // The least and the largest. REQUIRES: there is a vertex
  std::pair<std::uint64_t, std::uint64_t> range_of_numbers() const;
  Workers& workers() { return workers_; }
  // Found at the first call, which all ranks make. Its numbers are of all ranks, also of a part.
  BoundarySurface& boundary();
  std::uint64_t num_boundary_facets() {
    return part_ ? boundary().num_own_facets() : boundary().num_facets();
  }
  // The triangles of the boundary, in the order of their cells, by the mesh's own numbers.
  std::function<std::optional<TrianglePiece>()> triangles();
  NumberRange own_triangles();
  bool has_creases() const { return keeps_creases(run_); }
  // As boundary(). REQUIRES: has_creases()
  KeptCreases& creases();
  // Without creases, none. The edges in the order of their cells, the corners in that of their ids;
  // their vertices by the mesh's own numbers.
  std::uint64_t num_crease_edges();
  std::function<std::optional<LinePiece>()> lines();
  NumberRange own_lines();
  std::vector<KeptCorner> corners();  // of a part, its own; else of all ranks
  // Those whose vertices the mesh has, by these; a part may have one whose cell it has not.
  std::vector<KeptCorner> corners_by_vertex();
  // By its number in the mesh of all. In a run of the surface alone, as BoundaryFacet::cell has it.
  bool has_cell(std::uint64_t cell) const { return first_cell_ <= cell && cell < end_cell_; }
  // REQUIRES: they are sorted by sheet
  std::uint64_t num_boundary_facets_of(SheetId sheet) {
    return part_ ? boundary().num_own_facets_of(sheet) : boundary().num_facets_of(sheet);
  }

  // Calls take(encode(piece)) for each piece, encode on any thread, take in order.
  template <class Encode, class Take>
  void for_each_piece(const PieceParts& parts, const Encode& encode, Take take) {
    encode_in_order(
        workers_, ranges(parts),
        [&](const PieceRange& range) { return encode(read(range, parts)); }, take);
  }
  // Gives piece after piece, and then nothing. One at a time may be in use.
  std::function<std::optional<MeshPiece>()> pieces(const PieceParts& parts);

 private:
  struct PieceRange {  // from `first` to before `end`: leaves, or vertices of other ranks
    std::size_t first = 0, end = 0;
    bool is_of_others = false, is_of_other_nodes = false;
  };
  // Where ranks talk to each other, none may stop.
  const StopToken* stop_while_alone() const { return exchange_.num_ranks() == 1 ? stop_ : nullptr; }
  std::function<std::optional<PieceRange>()> ranges(const PieceParts& parts);
  std::uint64_t bytes_of(std::size_t leaf, const PieceParts& parts) const;
  void become_part();
  std::vector<MeshPiece::Vertex> positions_of_others(std::span<const std::uint64_t> vertices) const;
  std::vector<MeshPiece::Vertex> positions_of_other_nodes(std::span<const std::uint64_t> nodes);
  std::uint64_t place_of_node(std::uint64_t node) const {
    return part_nodes_ ? vertices_->size() + part_nodes_->place_of(node) : node;
  }
  void number_edges();
  std::uint64_t number_of_node(const MeshEdge& edge) {
    return edge_windows_->with([&](EdgeWindow& edges) { return edges.number(edge); });
  }
  void tell_step(std::uint64_t num_steps, std::uint64_t num_all);
  MeshPiece read(const PieceRange& range, const PieceParts& parts);  // by any thread
  MeshPiece others(const PieceRange& range) const;
  void add_points(std::size_t leaf, const MeshWindow& window, MeshPiece& piece) const;
  // Calls visit(position) for the nodes of a leaf for whose numbers is_wanted() holds, in order.
  template <class IsWanted, class Visit>
  void for_each_node(std::size_t leaf, MeshWindow& window, EdgeWindow& edges,
                     const IsWanted& is_wanted, const Visit& visit) const;
  // `edges`: null of first order
  void add_cells(std::size_t leaf, bool has_corners, MeshWindow& window, EdgeWindow* edges,
                 MeshPiece& piece) const;
  std::uint64_t add_core_cells(std::size_t leaf, MeshWindow& window, EdgeWindow* edges,
                               MeshPiece& piece) const;
  void add_core_bodies(std::size_t leaf, MeshWindow& window, MeshPiece& piece) const;

  const Store& store_;
  Snapshot snapshot_;
  RunRecord run_;
  SurfaceSheets sheets_;
  std::optional<SheetSides> sides_;
  std::filesystem::path output_;
  StepProgress on_step_;
  const StopToken* stop_;
  Exchange& exchange_;
  std::uint64_t num_told_ = 0;
  PageRelease pages_;
  VertexNumbering numbering_;
  VertexPositions positions_;
  Workers workers_;
  MeshWindows windows_;
  std::unique_ptr<EdgeNumbering> edges_;
  std::optional<EdgeWindows> edge_windows_;
  std::unique_ptr<BoundarySurface> boundary_;
  std::unique_ptr<BoundaryNodes> boundary_nodes_;
  std::optional<LeafWindow<LeafList<NodeOnSurface>>> on_surface_;  // of boundary_nodes_
  std::unique_ptr<KeptCreases> creases_;
  std::optional<BodyCells> body_cells_;
  std::uint64_t first_cell_ = 0, end_cell_;  // of a part, in the mesh of all
  std::optional<MeshPart> part_;
  std::optional<PartVertices> vertices_, part_nodes_;
};

// Of the cells of a piece, in order; those of the core by formula, without the displacement of
// 2^-18 of the spacing. REQUIRES: it has cells and corners
std::vector<QualityValues> quality_of(const MeshPiece& piece);
// The leaf of each cell of a piece.
std::vector<std::uint32_t> leaves_of(const MeshPiece& piece);

}  // namespace locvol
