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
std::uint64_t written(MeshSource& mesh, const OutputOptions&, std::span<PartialFile* const> files) {
  return kWrite(mesh, *files.front());
}
template <auto kWrite>
std::uint64_t written_as_asked(MeshSource& mesh, const OutputOptions& output,
                               std::span<PartialFile* const> files) {
  return kWrite(mesh, output, *files.front(), {});
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
           [](const MeshSizes& n, const OutputOptions& output) {
             const double v = num_points(n, output), c = n.num_cells,
                          f = output.has_boundary ? n.num_boundary_facets : 0,
                          crease = output.has_boundary && n.has_creases ? 4 : 0;
             const double data =
                 (output.has_quality ? 13 : 5) + (output.has_boundary ? 4 : 0) + crease;
             const double corners = corners_of_cell(output) * c + corners_of_facet(output) * f;
             return (24 + crease) * v + index_bytes(v) * corners +
                    (index_bytes(corners) + data) * (c + f);
           },
       .write = written_as_asked<write_vtu>},
      {.format = MeshFormat::kVtuZlib,
       .name = "vtu-zlib",
       .extensions = {},
       .description = "VTK, compressed",
       .has_cell_data = true,
       .waits_for_its_place = true,
       .bytes = [](const MeshSizes& n,
                   const OutputOptions& output) { return kZlib.bytes(n, output); },
       .write =
           [](MeshSource& mesh, const OutputOptions& output, std::span<PartialFile* const> files) {
             return write_compressed_vtu(mesh, output, *files.front());
           }},
      {.format = MeshFormat::kVtkHdf,
       .name = "vtkhdf",
       .extensions = {".vtkhdf", ".hdf"},
       .description = "VTK in HDF5, compressed",
       .has_cell_data = true,
       .waits_for_its_place = true,
       .bytes = [](const MeshSizes& n,
                   const OutputOptions& output) { return kShuffled.bytes(n, output); },
       .write =
           [](MeshSource& mesh, const OutputOptions& output, std::span<PartialFile* const> files) {
             return write_vtkhdf(mesh, output, *files.front());
           }},
      {.format = MeshFormat::kMsh4,
       .name = "msh",
       .extensions = {".msh"},
       .description = "Gmsh 4.1, binary",
       .has_boundary = true,
       .bytes =
           [](const MeshSizes& n, const OutputOptions& output) {
             return 32 * num_points(n, output) + 8 * (1 + corners_of_cell(output)) * n.num_cells +
                    8 * (1 + corners_of_facet(output)) * n.num_boundary_facets;
           },
       .write = written<write_msh4>},
      {.format = MeshFormat::kMsh2,
       .name = "msh2",
       .extensions = {},
       .description = "Gmsh 2.2, binary",
       .has_boundary = true,
       .limits =
           [](const MeshCounts& n) {
             return Limits{
                 {"vertices", n.num_vertices, kMaxInt32},
                 {"tetrahedra, boundary triangles, edges and corners",
                  n.num_cells + n.num_boundary_facets + n.num_crease_edges + n.num_corners,
                  kMaxInt32}};
           },
       .bytes =
           [](const MeshSizes& n, const OutputOptions& output) {
             return 28 * num_points(n, output) + 4 * (3 + corners_of_cell(output)) * n.num_cells +
                    4 * (3 + corners_of_facet(output)) * n.num_boundary_facets;
           },
       .write = written<write_msh2>},
      {.format = MeshFormat::kMedit,
       .name = "medit",
       .extensions = {".mesh"},
       .description = "Medit, text",
       .has_boundary = true,
       .waits_for_its_place = true,
       .bytes =
           [](const MeshSizes& n, const OutputOptions& output) {
             const double v = num_points(n, output), label = label_bytes_of_points(n, output);
             return (position_bytes(n.box, 1) + 2) * v +
                    (corners_of_cell(output) * (label + 1) + 2) * n.num_cells +
                    (corners_of_facet(output) * (label + 1) + 2) * n.num_boundary_facets;
           },
       .write = written<write_medit>},
      {.format = MeshFormat::kMeditBinary,
       .name = "meditb",
       .extensions = {".meshb"},
       .description = "Medit, binary",
       .has_boundary = true,
       .bytes =
           [](const MeshSizes& n, const OutputOptions& output) {
             const double v = num_points(n, output), c = n.num_cells, f = n.num_boundary_facets;
             const double width = c > kMaxInt32 || v > kMaxInt32 ? 8 : 4;
             return (24 + width) * v + width * (1 + corners_of_cell(output)) * c +
                    width * (1 + corners_of_facet(output)) * f;
           },
       .write =
           [](MeshSource& mesh, const OutputOptions&, std::span<PartialFile* const> files) {
             return write_binary_medit(mesh, *files.front());
           }},
      {.format = MeshFormat::kAbaqus,
       .name = "abaqus",
       .extensions = {".inp"},
       .description = "Abaqus and CalculiX, text",
       .has_boundary = true,
       .holds_triangles_alone = false,
       .waits_for_its_place = true,
       .limits =
           [](const MeshCounts& n) {
             return Limits{{"nodes", n.num_vertices, kMaxAbaqusLabel},
                           {"elements", n.num_cells, kMaxAbaqusLabel}};
           },
       .bytes =
           [](const MeshSizes& n, const OutputOptions& output) {
             const double v = num_points(n, output), node = label_bytes_of_points(n, output),
                          element = label_bytes(n.num_cells);
             const double in_sets =
                 num_boundary_vertices(n) + (output.order == 2 ? num_boundary_edges(n) : 0);
             return (node + position_bytes(n.box, 2, 20) + 1) * v +
                    (element + corners_of_cell(output) * (node + 2) + 1) * n.num_cells +
                    (node + 2) * in_sets + (element + 5) * n.num_boundary_facets;
           },
       .write = written<write_abaqus>},
      {.format = MeshFormat::kTetgen,
       .name = "tetgen",
       .extensions = {".node", ".ele"},
       .description = "TetGen, text, a file each",
       .holds_triangles_alone = false,
       .waits_for_its_place = true,
       .limits =
           [](const MeshCounts& n) {
             return Limits{{"points", n.num_vertices, kMaxInt32},
                           {"tetrahedra", n.num_cells, kMaxInt32}};
           },
       .bytes =
           [](const MeshSizes& n, const OutputOptions& output) {
             const double v = num_points(n, output), point = label_bytes_of_points(n, output),
                          f = output.has_boundary ? n.num_boundary_facets : 0;
             return (point + position_bytes(n.box, 1) + 1) * v +
                    (label_bytes(n.num_cells) + corners_of_cell(output) * (point + 1) + 1) *
                        n.num_cells +
                    (label_bytes(f) + corners_of_facet(output) * (point + 1) + 3) * f;
           },
       .write =
           [](MeshSource& mesh, const OutputOptions&, std::span<PartialFile* const> files) {
             const auto file = [&](std::size_t i) { return i < files.size() ? files[i] : nullptr; };
             return write_tetgen(mesh, *files[0], *files[1], file(2), file(3));
           }},
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
       .bytes = [](const MeshSizes& n, const OutputOptions&) { return 50 * n.num_boundary_facets; },
       .write = written<write_stl>},
      {.format = MeshFormat::kStlText,
       .name = "stl-text",
       .extensions = {},
       .description = "the boundary, text",
       .is_surface = true,
       .has_boundary = true,
       .waits_for_its_place = true,
       .bytes =
           [](const MeshSizes& n, const OutputOptions&) {  // 62 of them are the normal's
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
       .bytes =
           [](const MeshSizes& n, const OutputOptions&) {
             return 24 * num_boundary_vertices(n) + 13 * n.num_boundary_facets;
           },
       .write = written<write_ply>},
      {.format = MeshFormat::kVtp,
       .name = "vtp",
       .extensions = {".vtp"},
       .description = "the boundary, VTK XML polydata, raw",
       .is_surface = true,
       .has_boundary = true,
       .bytes =
           [](const MeshSizes& n, const OutputOptions&) {
             return 24 * num_boundary_vertices(n) + 32 * n.num_boundary_facets;
           },
       .write = written<write_vtp>},
      {.format = MeshFormat::kObj,
       .name = "obj",
       .extensions = {".obj"},
       .description = "the boundary, text",
       .is_surface = true,
       .has_boundary = true,
       .waits_for_its_place = true,
       .bytes =
           [](const MeshSizes& n, const OutputOptions&) {
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

namespace {

// Of the formats that are as wanted, in a list.
template <class IsWanted>
std::string list_of_formats(const IsWanted& is_wanted) {
  std::vector<std::string_view> names;
  for (const FormatInfo& format : mesh_formats())
    if (is_wanted(format)) names.push_back(format.name);
  return fmt::format("{}", fmt::join(names, ", "));
}

}  // namespace

void require_order(const OutputOptions& output) {
  const FormatInfo& info = info_of(output.format);
  if (output.order == 1 || info.has_second_order()) return;
  throw InputError(fmt::format(
      "{} has no cells of order {}: write {}", info.name, output.order,
      list_of_formats([](const FormatInfo& other) { return other.has_second_order(); })));
}

void require_cell_data(const OutputOptions& output) {
  const FormatInfo& info = info_of(output.format);
  if (!output.has_quality || info.has_cell_data) return;
  throw InputError(
      fmt::format("{} holds no cell data: write {}", info.name,
                  list_of_formats([](const FormatInfo& other) { return other.has_cell_data; })));
}

OutputOptions of_surface(OutputOptions output) {
  const FormatInfo& info = info_of(output.format);
  const auto refuse = [](const std::string& what) {
    throw InputError(what + ": --surface-only makes triangles, and no cells");
  };
  if (output.order != 1) refuse(fmt::format("--order {}", output.order));
  if (output.has_quality) refuse("--cell-data quality");
  if (!info.holds_triangles_alone) {
    std::vector<std::string_view> names;
    for (const FormatInfo& other : mesh_formats())
      if (other.holds_triangles_alone) names.push_back(other.name);
    throw InputError(
        fmt::format("{} has triangles as facets of cells, and --surface-only makes "
                    "none: write {}",
                    info.name, fmt::join(names, ", ")));
  }
  output.has_boundary = true;
  return output;
}

bool holds_boundary(const OutputOptions& output) {
  return output.has_boundary || info_of(output.format).has_boundary;
}

std::vector<std::filesystem::path> files_of(const OutputOptions& options,
                                            const std::filesystem::path& output) {
  if (options.format != MeshFormat::kTetgen) return {output};
  const auto extension = output.extension();
  const bool is_named = extension == ".node" || extension == ".ele";
  const std::string stem =
      is_named ? std::filesystem::path(output).replace_extension().string() : output.string();
  std::vector<std::filesystem::path> files = {stem + ".node", stem + ".ele"};
  if (options.has_boundary) files.insert(files.end(), {stem + ".face", stem + ".edge"});
  return files;
}

}  // namespace locvol
