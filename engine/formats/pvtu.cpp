#include <fmt/format.h>

#include <span>
#include <string>

#include "engine/formats/formats.h"
#include "engine/formats/mesh_arrays.h"

namespace locvol {
namespace {

std::string entry(const ArrayInfo& array) {
  const bool is_points = array.array == ArrayName::kPoints;
  return fmt::format("      <PDataArray type=\"{}\" Name=\"{}\" NumberOfComponents=\"{}\"/>\n",
                     array.vtk_type, array.name, is_points ? 3 : 1);
}

}  // namespace

void write_pvtu(std::span<const PieceFile> pieces, const OutputOptions& output, PartialFile& file) {
  std::string points, point_data, cell_data, sources;
  for (const ArrayInfo& array : mesh_arrays(pieces.front().counts, output, {}, true)) {
    if (array.array == ArrayName::kPoints) points += entry(array);
    if (array.array == ArrayName::kPointIds || array.array == ArrayName::kCorner)
      point_data += entry(array);
    if (array.is_cell_data) cell_data += entry(array);
  }
  for (const PieceFile& piece : pieces)
    sources += fmt::format("    <Piece Source=\"{}\"/>\n", piece.name);
  const std::string text = fmt::format(
      R"(<?xml version="1.0"?>
<VTKFile type="PUnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64">
  <PUnstructuredGrid GhostLevel="0">
    <PPoints>
{}    </PPoints>
    <PPointData GlobalIds="{}">
{}    </PPointData>
    <PCellData Scalars="leaf">
{}    </PCellData>
{}  </PUnstructuredGrid>
</VTKFile>
)",
      points, kGlobalPointIds, point_data, cell_data, sources);
  file.write_at(0, std::as_bytes(std::span(text)));
}

}  // namespace locvol
