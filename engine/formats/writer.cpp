#include "engine/formats/writer.h"

#include <list>
#include <optional>
#include <vector>

#include "engine/exchange/exchange.h"
#include "engine/formats/formats.h"
#include "engine/shared/partial_file.h"

namespace locvol {
namespace {

MeshCounts counts_of(MeshSource& mesh, MeshFormat format) {
  MeshCounts counts{mesh.num_vertices(), mesh.num_cells(), 0, 0};
  if (has_boundary(format)) counts.num_boundary_facets = mesh.boundary().num_facets();
  if (format == MeshFormat::kPly) counts.num_boundary_vertices = mesh.boundary().num_vertices();
  return counts;
}

std::uint64_t write(MeshSource& mesh, const OutputOptions& options, PartialFile& file,
                    PartialFile* second) {
  switch (options.format) {
    case MeshFormat::kVtu:
      return write_vtu(mesh, options.has_quality, file);
    case MeshFormat::kVtuZlib:
      return write_compressed_vtu(mesh, options.has_quality, file);
    case MeshFormat::kVtkHdf:
      return write_vtkhdf(mesh, options.has_quality, file);
    case MeshFormat::kMsh4:
      return write_msh4(mesh, file);
    case MeshFormat::kMsh2:
      return write_msh2(mesh, file);
    case MeshFormat::kMedit:
      return write_medit(mesh, file);
    case MeshFormat::kMeditBinary:
      return write_binary_medit(mesh, file);
    case MeshFormat::kAbaqus:
      return write_abaqus(mesh, file);
    case MeshFormat::kTetgen:
      return write_tetgen(mesh, file, *second);
    case MeshFormat::kStl:
      return write_stl(mesh, file);
    case MeshFormat::kPly:
      return write_ply(mesh, file);
    case MeshFormat::kObj:
      return write_obj(mesh, file);
  }
  return 0;
}

}  // namespace

WriteSummary write_mesh(const Store& store, const std::filesystem::path& file,
                        const OutputOptions& options, int num_threads, const StepProgress& on_step,
                        const StopToken* stop) {
  MeshSource mesh(store, file, num_threads, on_step, stop);
  const MeshCounts counts = counts_of(mesh, options.format);
  check_limits(options.format, counts, file);
  std::list<PartialFile> files;
  std::vector<PartialFile*> all;
  for (const auto& name : files_of(options.format, file))
    all.push_back(&files.emplace_back(name, stop));
  const std::uint64_t bytes = write(mesh, options, *all.front(), all.back());
  PartialFile::publish_all(all);
  return {counts.num_vertices, counts.num_cells, bytes, counts.num_boundary_facets};
}

WriteSummary write_mesh_as_rank(const Store& store, const std::filesystem::path& file,
                                const OutputOptions& options, Exchange& exchange, int num_threads) {
  MeshSource mesh(store, file, num_threads, {}, nullptr, &exchange);
  const MeshCounts counts{mesh.num_vertices(), mesh.num_cells(), 0, 0};
  check_limits(options.format, counts, file);
  const bool is_first = exchange.rank() == 0;
  std::optional<PartialFile> own;
  if (is_first) own.emplace(file);
  wait_for_all(exchange);  // it is there
  std::uint64_t bytes = 0;
  if (is_first) {
    bytes = write_part_of_vtu(mesh, options.has_quality, *own, true);
    wait_for_all(exchange);  // and whole
    own->publish();
  } else {
    PartialFile part = PartialFile::of_another(file);
    bytes = write_part_of_vtu(mesh, options.has_quality, part, false);
    part.finish_part();
    wait_for_all(exchange);
  }
  wait_for_all(exchange);  // and has its name
  return {counts.num_vertices, counts.num_cells, bytes, 0};
}

WriteSummary write_vtu(const Store& store, const std::filesystem::path& file, int num_threads,
                       const StepProgress& on_step) {
  return write_mesh(store, file, {}, num_threads, on_step);
}

}  // namespace locvol
