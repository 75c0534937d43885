#include "engine/formats/formats.h"
#include "engine/formats/outputs.h"

namespace locvol {
namespace {

Text node_lines(const MeshPiece& piece) {
  Text text;
  text.reserve(72 * piece.points.size());
  std::uint64_t index = piece.first_vertex;
  for (const auto& [x, y, z] : piece.points)
    text.add(++index).add(' ').add(x).add(' ').add(y).add(' ').add(z).add('\n');
  return text;
}

Text element_lines(const MeshPiece& piece) {
  Text text;
  text.reserve(48 * piece.cells.size());
  std::uint64_t index = piece.first_cell;
  for (const auto& cell : piece.cells) {
    text.add(++index);
    for (const std::int64_t v : cell) text.add(' ').add(static_cast<std::uint64_t>(v) + 1);
    text.add('\n');
  }
  return text;
}

}  // namespace

std::uint64_t write_tetgen(MeshSource& mesh, PartialFile& nodes, PartialFile& elements) {
  AppendedFile node_file(nodes, mesh.exchange()), element_file(elements, mesh.exchange());
  // Number of points, dimension, attributes, boundary markers.
  node_file.append(Text().add(mesh.num_vertices()).add(" 3 0 0\n").text());
  append_pieces(node_file, mesh, {.has_points = true}, node_lines);
  // Number of tetrahedra, points of each, attributes.
  element_file.append(Text().add(mesh.num_cells()).add(" 4 0\n").text());
  append_pieces(element_file, mesh, {.has_cells = true}, element_lines);
  return node_file.size() + element_file.size();
}

}  // namespace locvol
