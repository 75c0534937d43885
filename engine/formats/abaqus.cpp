#include <array>
#include <charconv>

#include "engine/formats/formats.h"
#include "engine/formats/outputs.h"
#include "engine/formats/sheet_names.h"

namespace locvol {
namespace {

// Abaqus' number of the face across from each vertex.
constexpr std::array<char, 4> kFace = {'3', '4', '2', '1'};
constexpr std::uint64_t kLabelsPerLine = 16;  // no more in a set

void add_coordinate(double value, Text& text) {
  constexpr std::ptrdiff_t kMaxLength = 20;
  std::array<char, 32> digits;
  char* const start = digits.data();
  const char* end = std::to_chars(start, start + digits.size(), value).ptr;
  for (int precision = 14; end - start > kMaxLength; --precision)
    end =
        std::to_chars(start, start + digits.size(), value, std::chars_format::scientific, precision)
            .ptr;
  text.add(std::string_view(start, end));
}

Text nodes_of(const MeshPiece& piece) {
  Text text;
  text.reserve(64 * piece.points.size());
  std::uint64_t label = piece.first_vertex;
  for (const auto& point : piece.points) {
    text.add(++label);
    for (const double coordinate : point) {
      text.add(", ");
      add_coordinate(coordinate, text);
    }
    text.add('\n');
  }
  return text;
}

Text elements_of(const MeshPiece& piece) {
  Text text;
  text.reserve(48 * piece.cells.size());
  std::uint64_t label = piece.first_cell;
  for (const auto& cell : piece.cells) {
    text.add(++label);
    for (const std::int64_t v : cell) text.add(", ").add(static_cast<std::uint64_t>(v) + 1);
    text.add('\n');
  }
  return text;
}

Text faces_of(const BoundarySurface::Facets& some) {
  Text text;
  for (const BoundaryFacet& facet : some.facets)
    text.add(facet.cell + 1).add(", S").add(kFace[facet.across]).add('\n');
  return text;
}

// `num_all`: vertices of the boundary
Text node_set_of(const BoundarySurface::Vertices& some, std::uint64_t num_all) {
  Text text;
  std::uint64_t count = some.first;
  for (const std::uint64_t vertex : some.vertices) {
    const bool ends_line = ++count % kLabelsPerLine == 0 || count == num_all;
    text.add(vertex + 1).add(ends_line ? "\n" : ", ");
  }
  return text;
}

// A set of nodes and a surface of each sheet, for CalculiX derives none from the other.
void append_sheets(MeshSource& mesh, AppendedFile& out) {
  BoundarySurface& boundary = mesh.boundary();
  boundary.sort_facets();
  const auto names = names_of_sheets(
      mesh.sheets(), {.most_bytes = 80, .is_identifier = true, .taken = {"boundary", "volume"}});
  for (SheetId sheet = 1; sheet <= boundary.num_sheets(); ++sheet) {
    const std::string& name = names[sheet - 1];
    if (boundary.num_facets_of(sheet) == 0) continue;  // a set that is empty is refused
    out.append("*NSET, NSET=" + name + '\n');
    append_boundary(
        out, mesh, boundary.vertices_of(sheet),
        [&, num_all = boundary.num_vertices_of(sheet)](const BoundarySurface::Vertices& some) {
          return node_set_of(some, num_all);
        });
    out.append("*SURFACE, NAME=" + name + ", TYPE=ELEMENT\n");
    append_boundary(out, mesh, boundary.facets_of(sheet, {}), faces_of);
  }
}

}  // namespace

std::uint64_t write_abaqus(MeshSource& mesh, PartialFile& file) {
  BoundarySurface& boundary = mesh.boundary();
  const std::uint64_t num_vertices = boundary.num_vertices();
  AppendedFile out(file, mesh.exchange());
  out.append("*HEADING\ntetrahedra by locvol\n*NODE\n");
  append_pieces(out, mesh, {.has_points = true}, nodes_of);
  out.append("*ELEMENT, TYPE=C3D4, ELSET=volume\n");
  append_pieces(out, mesh, {.has_cells = true}, elements_of);
  out.append("*NSET, NSET=boundary\n");
  append_boundary(out, mesh, boundary.vertices(), [&](const BoundarySurface::Vertices& some) {
    return node_set_of(some, num_vertices);
  });
  out.append("*SURFACE, NAME=boundary, TYPE=ELEMENT\n");
  append_boundary(out, mesh, boundary.facets({}), faces_of);
  if (!mesh.sheets().sheets.empty()) append_sheets(mesh, out);
  return out.size();
}

}  // namespace locvol
