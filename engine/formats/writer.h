// Streams the finished mesh out of a store, in any format.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

#include "engine/exchange/exchange.h"
#include "engine/exchange/one_rank.h"
#include "engine/formats/mesh_format.h"
#include "engine/shared/step_progress.h"
#include "octree/stop.h"
#include "storage/store.h"

namespace locvol {

struct WriteSummary {
  std::uint64_t num_vertices = 0, num_cells = 0, bytes = 0;
  std::uint64_t num_boundary_facets = 0;  // of formats that hold the boundary
  // Of second order: nodes in the middle of edges; of those of boundary edges, how many are off the
  // middle, on the surface, and how many in it though the surface is not there.
  std::uint64_t num_nodes = 0, num_nodes_on_surface = 0, num_nodes_off_surface = 0;
  friend bool operator==(const WriteSummary&, const WriteSummary&) = default;
};

// Writes the used vertices, numbered leaf by leaf in Morton order, and tetrahedra in the same
// order, positively oriented; or the boundary alone. What each format holds: formats/formats.h. The
// file appears under its name only when it is whole.
// Memory: one leaf and the id tables of its neighbors, and for each thread a mebibyte or a leaf
// more. Steps are cells. Throws StoreError; FormatLimit before a byte is written;
// std::runtime_error with the file's name when it cannot be written; Stopped, with nothing written.
//
// `exchange`: of the ranks that have the mesh together. All call it, each with its store,
// and all see the file's directory: each writes what is its own into the one file, which has the
// same bytes. What has no known place, text and what is compressed, waits in nameless files beside
// it, an array or a list at a time.
WriteSummary write_mesh(const Store& store, const std::filesystem::path& file,
                        const OutputOptions& options, int num_threads = 1,
                        const StepProgress& on_step = {}, const StopToken* stop = nullptr,
                        Exchange& exchange = alone());
// Called by all ranks, before the work is done. Throws std::runtime_error on the first rank that
// does not see what rank 0 begins there, and ExchangeError on others.
void require_seen_by_all(const std::filesystem::path& file, Exchange& exchange);
// A file for each rank, with its cells and all of their vertices, in formats that have parts; where
// a file can name them all, also that one. Nothing is gathered but 16 bytes a rank. Each rank sees
// the directory of its own file, and all are whole before one has its name. `file`: whose names
// these have in place of its extension.
WriteSummary write_piece_as_rank(const Store& store, const std::filesystem::path& file,
                                 const OutputOptions& options, Exchange& exchange,
                                 int num_threads = 1);
bool can_be_written_in_pieces(MeshFormat format);
// FILE-3.vtu, FILE-3.vtkhdf; FILE_4.msh, as Gmsh has it. REQUIRES: the format has pieces
std::filesystem::path piece_of(const std::filesystem::path& file, MeshFormat format, int rank);
// FILE.pvtu, FILE.vtkhdf; Gmsh has none.
std::optional<std::filesystem::path> index_of_pieces(const std::filesystem::path& file,
                                                     MeshFormat format);
// Writes the mesh as VTU, without the quality.
WriteSummary write_vtu(const Store& store, const std::filesystem::path& file, int num_threads = 1,
                       const StepProgress& on_step = {});

}  // namespace locvol
