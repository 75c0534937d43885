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

Text face_lines(const BoundarySurface::Facets& some) {
  Text text;
  std::uint64_t index = some.first;
  for (const BoundaryFacet& facet : some.facets) {
    text.add(++index);
    for (const std::uint64_t v : facet.vertices) text.add(' ').add(v + 1);
    text.add(' ').add(std::uint64_t{facet.labels.sheet}).add('\n');
  }
  return text;
}

// Returns the bytes. First, how many there are, and that each has a marker.
std::uint64_t write_faces(MeshSource& mesh, PartialFile& file) {
  AppendedFile out(file, mesh.exchange());
  out.append(Text().add(mesh.boundary().num_facets()).add(" 1\n").text());
  append_boundary(out, mesh, mesh.boundary().facets({}), face_lines);
  return out.size();
}

}  // namespace

std::uint64_t write_tetgen(MeshSource& mesh, PartialFile& nodes, PartialFile& elements,
                           PartialFile* faces) {
  AppendedFile node_file(nodes, mesh.exchange()), element_file(elements, mesh.exchange());
  // Number of points, dimension, attributes, boundary markers.
  node_file.append(Text().add(mesh.num_vertices()).add(" 3 0 0\n").text());
  append_pieces(node_file, mesh, {.has_points = true}, node_lines);
  // Number of tetrahedra, points of each, attributes.
  element_file.append(Text().add(mesh.num_cells()).add(" 4 0\n").text());
  append_pieces(element_file, mesh, {.has_cells = true}, element_lines);
  const std::uint64_t bytes = node_file.size() + element_file.size();
  return faces == nullptr ? bytes : bytes + write_faces(mesh, *faces);
}

}  // namespace locvol
