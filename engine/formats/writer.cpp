#include "engine/formats/writer.h"

#include <fmt/format.h>

#include <exception>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <system_error>
#include <vector>

#include "engine/exchange/exchange.h"
#include "engine/formats/formats.h"
#include "engine/formats/mesh_arrays.h"
#include "engine/formats/outputs.h"
#include "engine/shared/partial_file.h"

namespace locvol {
namespace {

MeshCounts mesh_counts(MeshSource& mesh, const OutputOptions& options) {
  MeshCounts counts{mesh.num_points(), mesh.num_cells(), 0, 0, mesh.order()};
  if (holds_boundary(options)) counts.num_boundary_facets = mesh.num_boundary_facets();
  if (options.format == MeshFormat::kPly || options.format == MeshFormat::kVtp)
    counts.num_boundary_vertices = mesh.boundary().num_vertices();
  if (holds_boundary(options) && !info_of(options.format).is_surface) add_creases(mesh, counts);
  return counts;
}

std::filesystem::path with_end(const std::filesystem::path& file, const std::string& end) {
  return file.parent_path() / (file.stem().string() + end);
}

// In order of rank.
std::vector<PieceFile> piece_files(const std::filesystem::path& file, MeshFormat format,
                                   const MeshCounts& own, Exchange& exchange) {
  const auto num_vertices = gather_numbers(exchange, own.num_vertices);
  const auto num_cells = gather_numbers(exchange, own.num_cells);
  const auto num_facets = gather_numbers(exchange, own.num_boundary_facets);
  const auto num_edges = gather_numbers(exchange, own.num_crease_edges);
  const auto num_corners = gather_numbers(exchange, own.num_corners);
  std::vector<PieceFile> pieces;
  for (std::size_t rank = 0; rank < num_cells.size(); ++rank)
    pieces.push_back({piece_of(file, format, static_cast<int>(rank)).filename().string(),
                      {num_vertices[rank], num_cells[rank], num_facets[rank], 0, own.order,
                       own.has_creases, num_edges[rank], num_corners[rank]}});
  return pieces;
}

void write_index(std::span<const PieceFile> pieces, const MeshSource& mesh,
                 const OutputOptions& options, PartialFile& file) {
  if (options.format == MeshFormat::kVtkHdf)
    write_partitioned_vtkhdf(pieces, options, name_fields(mesh, options, "/"), file);
  else
    write_pvtu(pieces, options, file);
}

// The first rank's file, for another.
std::unique_ptr<PartialFile> begun_by_first(const std::filesystem::path& file,
                                            const StopToken* stop) {
  try {
    return std::unique_ptr<PartialFile>(new PartialFile(PartialFile::of_another(file, stop)));
  } catch (const std::system_error& e) {
    if (e.code() != std::errc::no_such_file_or_directory) throw;
    throw std::runtime_error(
        "cannot write " + file.string() +
        ": what the first process begins there, this one does not see; choose a directory that all "
        "see, or --pieces, a file each");
  }
}

// `num_bytes`, `num_facets`: of all ranks
WriteSummary summary_of(const MeshSource& mesh, std::uint64_t num_bytes, std::uint64_t num_facets) {
  WriteSummary summary{mesh.num_all_vertices(), mesh.num_all_cells(), num_bytes, num_facets};
  if (mesh.order() == 1) return summary;
  summary.num_nodes = mesh.num_all_nodes();
  summary.num_nodes_on_surface = mesh.boundary_nodes().num_on_surface();
  summary.num_nodes_off_surface = mesh.boundary_nodes().num_kept_off();
  return summary;
}

}  // namespace

void add_creases(MeshSource& mesh, MeshCounts& counts) {
  if (!mesh.has_creases()) return;
  counts.has_creases = true;
  counts.num_crease_edges = mesh.num_crease_edges();
  counts.num_corners = mesh.corners().size();
}

void require_seen_by_all(const std::filesystem::path& file, Exchange& exchange) {
  std::optional<PartialFile> begun;
  std::exception_ptr unseen;
  do_on_all(exchange, [&] {
    if (exchange.rank() == 0) begun.emplace(file);
  });
  if (exchange.rank() != 0) try {
      begun_by_first(file, nullptr);
    } catch (...) {
      unseen = std::current_exception();
    }
  wait_for_all(exchange);  // all have looked
  begun.reset();
  check_on_all(exchange, [&] {
    if (unseen) std::rethrow_exception(unseen);
  });
}

WriteSummary write_mesh(const Store& store, const std::filesystem::path& file,
                        const OutputOptions& asked, int num_threads, const StepProgress& on_step,
                        const StopToken* stop, Exchange& exchange) {
  require_order(asked);
  require_cell_data(asked);
  MeshSource mesh(store, file, num_threads, on_step, stop, exchange,
                  {.order = asked.order, .is_split = asked.splits_interfaces});
  const OutputOptions options = mesh.is_surface_only() ? of_surface(asked) : asked;
  const MeshCounts counts = mesh_counts(mesh, options);
  check_on_all(exchange, [&] { check_limits(options.format, counts, file); });
  const auto names = files_of(options, file);
  std::vector<std::unique_ptr<PartialFile>> files;
  do_on_all(exchange, [&] {
    if (!mesh.is_of_first_rank()) return;
    for (const auto& name : names) files.push_back(std::make_unique<PartialFile>(name, stop));
  });
  do_on_all(exchange, [&] {
    if (mesh.is_of_first_rank()) return;
    for (const auto& name : names) files.push_back(begun_by_first(name, stop));
  });
  std::vector<PartialFile*> all;
  for (const auto& partial : files) all.push_back(partial.get());
  const std::uint64_t own_bytes = info_of(options.format).write(mesh, options, all);
  do_on_all(exchange, [&] {
    if (mesh.is_of_first_rank()) return;
    for (const auto& part : files) part->finish_part();
  });
  const std::uint64_t bytes = gather_numbers(exchange, own_bytes).front();
  do_on_all(exchange, [&] {
    if (mesh.is_of_first_rank()) PartialFile::publish_all(all);
  });
  return summary_of(mesh, bytes, counts.num_boundary_facets);
}

bool can_be_written_in_pieces(MeshFormat format) {
  return format == MeshFormat::kVtu || format == MeshFormat::kVtuZlib ||
         format == MeshFormat::kVtkHdf || format == MeshFormat::kMsh4;
}

std::filesystem::path piece_of(const std::filesystem::path& file, MeshFormat format, int rank) {
  if (format == MeshFormat::kMsh4) return with_end(file, fmt::format("_{}.msh", rank + 1));
  return with_end(file,
                  fmt::format("-{}.{}", rank, format == MeshFormat::kVtkHdf ? "vtkhdf" : "vtu"));
}

std::optional<std::filesystem::path> index_of_pieces(const std::filesystem::path& file,
                                                     MeshFormat format) {
  if (format == MeshFormat::kMsh4) return std::nullopt;
  return with_end(file, format == MeshFormat::kVtkHdf ? ".vtkhdf" : ".pvtu");
}

WriteSummary write_piece_as_rank(const Store& store, const std::filesystem::path& file,
                                 const OutputOptions& options, Exchange& exchange,
                                 int num_threads) {
  const std::filesystem::path name = piece_of(file, options.format, exchange.rank());
  if (store.snapshot().run().value_or(RunRecord()).parameters.is_surface_only)
    throw InputError(
        "pieces are of cells, of which a run with --surface-only has none: write one "
        "file");
  MeshSource mesh(store, name, num_threads, {}, nullptr, exchange,
                  {.is_part = true, .order = options.order, .is_split = options.splits_interfaces});
  const MeshCounts counts = mesh_counts(mesh, options);
  const std::vector<PieceFile> pieces = piece_files(file, options.format, counts, exchange);
  const auto of_all = index_of_pieces(file, options.format);
  std::optional<PartialFile> piece, index;
  std::uint64_t bytes = 0;
  do_on_all(exchange, [&] {
    PartialFile* const own = &piece.emplace(name);
    bytes = info_of(options.format).write(mesh, options, {&own, 1});
    piece->finish();
    if (!of_all || exchange.rank() != 0) return;
    write_index(pieces, mesh, options, index.emplace(*of_all));
    index->finish();
  });
  piece->publish();
  wait_for_all(exchange);  // all have their names
  if (index) index->publish();
  wait_for_all(exchange);
  return summary_of(mesh, sum(exchange, bytes).all, sum(exchange, counts.num_boundary_facets).all);
}

WriteSummary write_vtu(const Store& store, const std::filesystem::path& file, int num_threads,
                       const StepProgress& on_step) {
  return write_mesh(store, file, {}, num_threads, on_step);
}

}  // namespace locvol
