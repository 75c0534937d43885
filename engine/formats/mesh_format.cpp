#include "engine/formats/mesh_format.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>

#include "engine/formats/limits.h"

namespace locvol {
namespace {

constexpr std::uint64_t kMaxUint32 = 0xffffffff;
constexpr std::uint64_t kMaxAbaqusLabel = 999'999'999;

struct Limit {
  std::string_view what;
  std::uint64_t count, most;
};

std::vector<Limit> limits_of(MeshFormat format, const MeshCounts& n) {
  switch (format) {
    case MeshFormat::kVtu:
    case MeshFormat::kVtuZlib:
    case MeshFormat::kVtkHdf:
    case MeshFormat::kMsh4:
    case MeshFormat::kMedit:
    case MeshFormat::kMeditBinary:
    case MeshFormat::kObj:
      return {};
    case MeshFormat::kMsh2:
      return {
          {"vertices", n.num_vertices, kMaxInt32},
          {"tetrahedra and boundary triangles", n.num_cells + n.num_boundary_facets, kMaxInt32}};
    case MeshFormat::kAbaqus:
      return {{"nodes", n.num_vertices, kMaxAbaqusLabel},
              {"elements", n.num_cells, kMaxAbaqusLabel}};
    case MeshFormat::kTetgen:
      return {{"points", n.num_vertices, kMaxInt32}, {"tetrahedra", n.num_cells, kMaxInt32}};
    case MeshFormat::kStl:
      return {{"triangles", n.num_boundary_facets, kMaxUint32}};
    case MeshFormat::kPly:
      return {{"vertices", n.num_boundary_vertices, kMaxInt32},
              {"triangles", n.num_boundary_facets, kMaxUint32}};
  }
  return {};
}

}  // namespace

std::span<const FormatInfo> mesh_formats() {
  static const std::vector<FormatInfo> formats = {
      {MeshFormat::kVtu, "vtu", {".vtu"}, "VTK, raw binary", true},
      {MeshFormat::kVtuZlib, "vtu-zlib", {}, "VTK, compressed", true},
      {MeshFormat::kVtkHdf, "vtkhdf", {".vtkhdf", ".hdf"}, "VTK in HDF5, compressed", true},
      {MeshFormat::kMsh4, "msh", {".msh"}, "Gmsh 4.1, binary"},
      {MeshFormat::kMsh2, "msh2", {}, "Gmsh 2.2, binary"},
      {MeshFormat::kMedit, "medit", {".mesh"}, "Medit, text"},
      {MeshFormat::kMeditBinary, "meditb", {".meshb"}, "Medit, binary"},
      {MeshFormat::kAbaqus, "abaqus", {".inp"}, "Abaqus and CalculiX, text"},
      {MeshFormat::kTetgen, "tetgen", {".node", ".ele"}, "TetGen, both files, text"},
      {MeshFormat::kStl, "stl", {".stl"}, "the boundary, binary", false, true},
      {MeshFormat::kPly, "ply", {".ply"}, "the boundary, binary", false, true},
      {MeshFormat::kObj, "obj", {".obj"}, "the boundary, text", false, true},
  };
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

bool has_boundary(MeshFormat format) {
  switch (format) {
    case MeshFormat::kVtu:
    case MeshFormat::kVtuZlib:
    case MeshFormat::kVtkHdf:
    case MeshFormat::kTetgen:
      return false;
    default:
      return true;
  }
}

void check_limits(MeshFormat format, const MeshCounts& counts, const std::filesystem::path& file,
                  std::string_view counted) {
  for (const auto& [what, count, most] : limits_of(format, counts)) {
    if (count <= most) continue;
    throw FormatLimit(
        fmt::format("cannot write {}: the format {} numbers at most {} {}, and {} {}; write {}",
                    file.string(), info_of(format).name, most, what, counted, count,
                    info_of(format).is_surface ? "obj" : "vtu, vtkhdf or msh"));
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
