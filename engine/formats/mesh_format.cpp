#include "engine/formats/mesh_format.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>

#include "engine/formats/formats.h"
#include "engine/formats/limits.h"
#include "engine/formats/output_bytes.h"

namespace locvol {
namespace {

constexpr std::uint64_t kMaxUint32 = 0xffffffff;
constexpr std::uint64_t kMaxAbaqusLabel = 999'999'999;

// For rows of the table.
template <auto kWrite>
std::uint64_t written(MeshSource& mesh, bool, PartialFile& file, PartialFile*) {
  return kWrite(mesh, file);
}

std::vector<FormatInfo> table_of_formats() {
  using Limits = std::vector<FormatInfo::Limit>;
  // A function for each: bytes of values or, of text, of what stands between numbers.
  return {
      {.format = MeshFormat::kVtu,
       .name = "vtu",
       .extensions = {".vtu"},
       .description = "VTK, raw binary",
       .has_cell_data = true,
       .bytes =
           [](const MeshSizes& n, bool has_quality) {
             const double v = n.num_vertices, c = n.num_cells;
             return 24 * v + (4 * index_bytes(v) + index_bytes(4 * c) + (has_quality ? 13 : 5)) * c;
           },
       .write = [](MeshSource& mesh, bool has_quality, PartialFile& file,
                   PartialFile*) { return write_vtu(mesh, has_quality, file); }},
      {.format = MeshFormat::kVtuZlib,
       .name = "vtu-zlib",
       .extensions = {},
       .description = "VTK, compressed",
       .has_cell_data = true,
       .waits_for_its_place = true,
       .bytes = [](const MeshSizes& n, bool has_quality) { return kZlib.bytes(n, has_quality); },
       .write = [](MeshSource& mesh, bool has_quality, PartialFile& file,
                   PartialFile*) { return write_compressed_vtu(mesh, has_quality, file); }},
      {.format = MeshFormat::kVtkHdf,
       .name = "vtkhdf",
       .extensions = {".vtkhdf", ".hdf"},
       .description = "VTK in HDF5, compressed",
       .has_cell_data = true,
       .waits_for_its_place = true,
       .bytes = [](const MeshSizes& n,
                   bool has_quality) { return kShuffled.bytes(n, has_quality); },
       .write = [](MeshSource& mesh, bool has_quality, PartialFile& file,
                   PartialFile*) { return write_vtkhdf(mesh, has_quality, file); }},
      {.format = MeshFormat::kMsh4,
       .name = "msh",
       .extensions = {".msh"},
       .description = "Gmsh 4.1, binary",
       .has_boundary = true,
       .bytes =
           [](const MeshSizes& n, bool) {
             return 32 * n.num_vertices + 40 * n.num_cells + 32 * n.num_boundary_facets;
           },
       .write = written<write_msh4>},
      {.format = MeshFormat::kMsh2,
       .name = "msh2",
       .extensions = {},
       .description = "Gmsh 2.2, binary",
       .has_boundary = true,
       .limits =
           [](const MeshCounts& n) {
             return Limits{{"vertices", n.num_vertices, kMaxInt32},
                           {"tetrahedra and boundary triangles",
                            n.num_cells + n.num_boundary_facets, kMaxInt32}};
           },
       .bytes =
           [](const MeshSizes& n, bool) {
             return 28 * n.num_vertices + 28 * n.num_cells + 24 * n.num_boundary_facets;
           },
       .write = written<write_msh2>},
      {.format = MeshFormat::kMedit,
       .name = "medit",
       .extensions = {".mesh"},
       .description = "Medit, text",
       .has_boundary = true,
       .waits_for_its_place = true,
       .bytes =
           [](const MeshSizes& n, bool) {
             const double label = label_bytes(n.num_vertices);
             return (position_bytes(n.box, 1) + 2) * n.num_vertices +
                    (4 * (label + 1) + 2) * n.num_cells +
                    (3 * (label + 1) + 2) * n.num_boundary_facets;
           },
       .write = written<write_medit>},
      {.format = MeshFormat::kMeditBinary,
       .name = "meditb",
       .extensions = {".meshb"},
       .description = "Medit, binary",
       .has_boundary = true,
       .bytes =
           [](const MeshSizes& n, bool) {
             const double v = n.num_vertices, c = n.num_cells, f = n.num_boundary_facets;
             return c > kMaxInt32 ? 32 * v + 40 * c + 32 * f : 28 * v + 20 * c + 16 * f;
           },
       .write = [](MeshSource& mesh, bool, PartialFile& file,
                   PartialFile*) { return write_binary_medit(mesh, file); }},
      {.format = MeshFormat::kAbaqus,
       .name = "abaqus",
       .extensions = {".inp"},
       .description = "Abaqus and CalculiX, text",
       .has_boundary = true,
       .waits_for_its_place = true,
       .limits =
           [](const MeshCounts& n) {
             return Limits{{"nodes", n.num_vertices, kMaxAbaqusLabel},
                           {"elements", n.num_cells, kMaxAbaqusLabel}};
           },
       .bytes =
           [](const MeshSizes& n, bool) {
             const double node = label_bytes(n.num_vertices), element = label_bytes(n.num_cells);
             return (node + position_bytes(n.box, 2, 20) + 1) * n.num_vertices +
                    (element + 4 * (node + 2) + 1) * n.num_cells +
                    (node + 2) * num_boundary_vertices(n) + (element + 5) * n.num_boundary_facets;
           },
       .write = written<write_abaqus>},
      {.format = MeshFormat::kTetgen,
       .name = "tetgen",
       .extensions = {".node", ".ele"},
       .description = "TetGen, both files, text",
       .waits_for_its_place = true,
       .limits =
           [](const MeshCounts& n) {
             return Limits{{"points", n.num_vertices, kMaxInt32},
                           {"tetrahedra", n.num_cells, kMaxInt32}};
           },
       .bytes =
           [](const MeshSizes& n, bool) {
             const double point = label_bytes(n.num_vertices);
             return (point + position_bytes(n.box, 1) + 1) * n.num_vertices +
                    (label_bytes(n.num_cells) + 4 * (point + 1) + 1) * n.num_cells;
           },
       .write = [](MeshSource& mesh, bool, PartialFile& file,
                   PartialFile* second) { return write_tetgen(mesh, file, *second); }},
      {.format = MeshFormat::kStl,
       .name = "stl",
       .extensions = {".stl"},
       .description = "the boundary, binary",
       .is_surface = true,
       .has_boundary = true,
       .limits =
           [](const MeshCounts& n) {
             return Limits{{"triangles", n.num_boundary_facets, kMaxUint32}};
           },
       .bytes = [](const MeshSizes& n, bool) { return 50 * n.num_boundary_facets; },
       .write = written<write_stl>},
      {.format = MeshFormat::kStlText,
       .name = "stl-text",
       .extensions = {},
       .description = "the boundary, text",
       .is_surface = true,
       .has_boundary = true,
       .waits_for_its_place = true,
       .bytes =
           [](const MeshSizes& n, bool) {  // 62 of them are the normal's
             return (3 * position_bytes(n.box, 1) + 124) * n.num_boundary_facets;
           },
       .write = written<write_stl_text>},
      {.format = MeshFormat::kPly,
       .name = "ply",
       .extensions = {".ply"},
       .description = "the boundary, binary",
       .is_surface = true,
       .has_boundary = true,
       .limits =
           [](const MeshCounts& n) {
             return Limits{{"vertices", n.num_boundary_vertices, kMaxInt32},
                           {"triangles", n.num_boundary_facets, kMaxUint32}};
           },
       .bytes = [](const MeshSizes& n,
                   bool) { return 24 * num_boundary_vertices(n) + 13 * n.num_boundary_facets; },
       .write = written<write_ply>},
      {.format = MeshFormat::kObj,
       .name = "obj",
       .extensions = {".obj"},
       .description = "the boundary, text",
       .is_surface = true,
       .has_boundary = true,
       .waits_for_its_place = true,
       .bytes =
           [](const MeshSizes& n, bool) {
             const double v = num_boundary_vertices(n);
             return (2 + position_bytes(n.box, 1)) * v +
                    (2 + 3 * (label_bytes(v) + 1)) * n.num_boundary_facets;
           },
       .write = written<write_obj>},
  };
}

}  // namespace

std::span<const FormatInfo> mesh_formats() {
  static const std::vector<FormatInfo> formats = table_of_formats();
  return formats;
}

const FormatInfo& info_of(MeshFormat format) {
  return *std::ranges::find(mesh_formats(), format, &FormatInfo::format);
}

std::optional<MeshFormat> format_of(const std::filesystem::path& file) {
  std::string extension = file.extension().string();
  std::ranges::transform(extension, extension.begin(),
                         [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  for (const FormatInfo& info : mesh_formats())
    if (std::ranges::find(info.extensions, extension) != info.extensions.end()) return info.format;
  return std::nullopt;
}

std::optional<MeshFormat> format_named(std::string_view name) {
  const auto found = std::ranges::find(mesh_formats(), name, &FormatInfo::name);
  if (found == mesh_formats().end()) return std::nullopt;
  return found->format;
}

MeshFormat format_meant_by(const std::filesystem::path& file) {
  if (const auto format = format_of(file)) return *format;
  std::vector<std::string_view> extensions;
  for (const FormatInfo& info : mesh_formats())
    extensions.insert(extensions.end(), info.extensions.begin(), info.extensions.end());
  throw InputError(fmt::format("'{}' names no known format: it must end in {}", file.string(),
                               fmt::join(extensions, ", ")));
}

void check_limits(MeshFormat format, const MeshCounts& counts, const std::filesystem::path& file,
                  std::string_view counted) {
  const FormatInfo& info = info_of(format);
  if (info.limits == nullptr) return;
  for (const auto& [what, count, most] : info.limits(counts)) {
    if (count <= most) continue;
    throw FormatLimit(fmt::format(
        "cannot write {}: the format {} numbers at most {} {}, and {} {}; write {}", file.string(),
        info.name, most, what, counted, count, info.is_surface ? "obj" : "vtu, vtkhdf or msh"));
  }
}

std::vector<std::filesystem::path> files_of(MeshFormat format,
                                            const std::filesystem::path& output) {
  if (format != MeshFormat::kTetgen) return {output};
  const auto extension = output.extension();
  const bool is_named = extension == ".node" || extension == ".ele";
  const std::string stem =
      is_named ? std::filesystem::path(output).replace_extension().string() : output.string();
  return {stem + ".node", stem + ".ele"};
}

}  // namespace locvol
