#include "engine/formats/vtu_header.h"

#include <bit>
#include <utility>

#include "engine/formats/outputs.h"

namespace locvol {
namespace {

static_assert(std::endian::native == std::endian::little, "the header says LittleEndian");

void add_array(const VtuArrayEntry& array, Text& text) {
  constexpr std::size_t kOffsetLength = 20;
  std::string digits = std::to_string(array.offset) + "\"";
  digits.resize(kOffsetLength + 1, ' ');
  text.add("        <DataArray type=\"").add(array.vtk_type).add("\" Name=\"").add(array.name);
  if (array.num_components > 1) text.add("\" NumberOfComponents=\"").add(array.num_components);
  text.add("\" format=\"appended\" offset=\"").add(digits).add("/>\n");
}

// The first array of cells is the one that viewers show. A section without arrays is left out.
void add_section(VtuSection section, std::string_view name,
                 const std::vector<VtuArrayEntry>& arrays, Text& text) {
  bool is_open = false;
  for (const VtuArrayEntry& array : arrays) {
    if (array.section != section) continue;
    if (!std::exchange(is_open, true)) {
      text.add("      <").add(name);
      if (section == VtuSection::kCellData) text.add(" Scalars=\"").add(array.name).add('"');
      if (array.has_global_ids) text.add(" GlobalIds=\"").add(array.name).add('"');
      text.add(">\n");
    }
    add_array(array, text);
  }
  if (is_open) text.add("      </").add(name).add(">\n");
}

std::string escaped(std::string_view text) {
  std::string result;
  for (const char c : text) {
    if (c == '&')
      result += "&amp;";
    else if (c == '<')
      result += "&lt;";
    else if (c == '"')
      result += "&quot;";
    else
      result += c;
  }
  return result;
}

void add_fields(const std::vector<VtuField>& fields, Text& text) {
  if (fields.empty()) return;
  text.add("    <FieldData>\n");
  for (const auto& [name, id, dimension] : fields) {
    text.add("      <DataArray type=\"Int32\" Name=\"").add(escaped(name));
    text.add("\" NumberOfTuples=\"2\" format=\"ascii\">").add(std::uint64_t{id}).add(' ');
    text.add(std::uint64_t{dimension}).add("</DataArray>\n");
  }
  text.add("    </FieldData>\n");
}

std::string head_of(std::string_view kind, bool is_compressed,
                    const std::vector<VtuField>& fields) {
  Text text;
  text.add("<?xml version=\"1.0\"?>\n<VTKFile type=\"").add(kind);
  text.add("\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\"");
  if (is_compressed) text.add(" compressor=\"vtkZLibDataCompressor\"");
  text.add(">\n  <").add(kind).add(">\n");
  add_fields(fields, text);
  return text.text();
}

std::string finished(Text& text, std::string_view kind) {
  text.add("    </Piece>\n  </").add(kind).add(">\n  <AppendedData encoding=\"raw\">\n");
  std::string result = text.text();
  result.append(7 - result.size() % 8, ' ');
  return result + '_';
}

}  // namespace

std::string vtu_header(std::uint64_t num_points, std::uint64_t num_cells,
                       const std::vector<VtuArrayEntry>& arrays, bool is_compressed,
                       const std::vector<VtuField>& fields) {
  constexpr std::string_view kKind = "UnstructuredGrid";
  Text text;
  text.add(head_of(kKind, is_compressed, fields));
  text.add("    <Piece NumberOfPoints=\"").add(num_points);
  text.add("\" NumberOfCells=\"").add(num_cells).add("\">\n");
  add_section(VtuSection::kPoints, "Points", arrays, text);
  add_section(VtuSection::kCells, "Cells", arrays, text);
  add_section(VtuSection::kPointData, "PointData", arrays, text);
  add_section(VtuSection::kCellData, "CellData", arrays, text);
  return finished(text, kKind);
}

std::string vtp_header(std::uint64_t num_points, std::uint64_t num_triangles,
                       const std::vector<VtuArrayEntry>& arrays,
                       const std::vector<VtuField>& fields) {
  constexpr std::string_view kKind = "PolyData";
  Text text;
  text.add(head_of(kKind, false, fields));
  text.add("    <Piece NumberOfPoints=\"").add(num_points);
  text.add("\" NumberOfPolys=\"").add(num_triangles).add("\">\n");
  add_section(VtuSection::kPoints, "Points", arrays, text);
  add_section(VtuSection::kCells, "Polys", arrays, text);
  add_section(VtuSection::kCellData, "CellData", arrays, text);
  return finished(text, kKind);
}

}  // namespace locvol
