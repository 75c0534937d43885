#include <array>
#include <vector>

#include "engine/formats/formats.h"
#include "engine/formats/outputs.h"

namespace locvol {
namespace {

// Of a cell and of a facet, the order in which TetGen has their nodes (-o2): the edges from 2 to 3,
// 0 to 3, 0 to 1, 1 to 2, 1 to 3, and 0 to 2; and those across from each vertex.
constexpr std::array<std::size_t, 6> kTetgenCellNodes = {5, 3, 0, 1, 4, 2};
constexpr std::array<std::size_t, 3> kTetgenFacetNodes = {1, 2, 0};

Text node_lines(const std::vector<MeshPiece::Vertex>& points, std::uint64_t first) {
  Text text;
  text.reserve(72 * points.size());
  std::uint64_t index = first;
  for (const auto& [x, y, z] : points)
    text.add(++index).add(' ').add(x).add(' ').add(y).add(' ').add(z).add('\n');
  return text;
}

Text element_lines(const MeshPiece& piece) {
  Text text;
  text.reserve(48 * piece.cells.size());
  for (std::size_t i = 0; i < piece.cells.size(); ++i) {
    text.add(piece.first_cell + i + 1);
    const auto add = [&](std::int64_t v) { text.add(' ').add(static_cast<std::uint64_t>(v) + 1); };
    for (const std::int64_t v : piece.cells[i]) add(v);
    if (!piece.nodes.empty())
      for (const std::size_t n : kTetgenCellNodes) add(piece.nodes[i][n]);
    if (!piece.bodies.empty()) text.add(' ').add(std::uint64_t{piece.bodies[i]});
    text.add('\n');
  }
  return text;
}

Text face_lines(const BoundarySurface::Facets& some) {
  Text text;
  for (std::size_t i = 0; i < some.facets.size(); ++i) {
    text.add(some.first + i + 1);
    for (const std::uint64_t v : some.facets[i].vertices) text.add(' ').add(v + 1);
    if (!some.nodes.empty())
      for (const std::size_t n : kTetgenFacetNodes) text.add(' ').add(some.nodes[i][n] + 1);
    text.add(' ').add(std::uint64_t{some.facets[i].labels.sheet}).add('\n');
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

Text edge_lines(const LinePiece& piece) {
  Text text;
  std::uint64_t index = piece.first;
  for (std::size_t i = 0; i < piece.lines.size(); ++i) {
    text.add(++index);
    for (const std::int64_t v : piece.lines[i])
      text.add(' ').add(static_cast<std::uint64_t>(v) + 1);
    if (!piece.nodes.empty()) text.add(' ').add(static_cast<std::uint64_t>(piece.nodes[i][0]) + 1);
    text.add(' ').add(std::uint64_t{piece.creases[i]}).add('\n');
  }
  return text;
}

// Likewise.
std::uint64_t write_edges(MeshSource& mesh, PartialFile& file) {
  AppendedFile out(file, mesh.exchange());
  out.append(Text().add(mesh.num_crease_edges()).add(" 1\n").text());
  append_boundary(out, mesh, mesh.lines(), edge_lines);
  return out.size();
}

}  // namespace

std::uint64_t write_tetgen(MeshSource& mesh, PartialFile& nodes, PartialFile& elements,
                           PartialFile* faces, PartialFile* edges) {
  AppendedFile node_file(nodes, mesh.exchange()), element_file(elements, mesh.exchange());
  // Number of points, dimension, attributes, boundary markers.
  node_file.append(Text().add(mesh.num_points()).add(" 3 0 0\n").text());
  append_pieces(node_file, mesh, {.has_points = true}, [](const MeshPiece& piece) {
    return node_lines(piece.points, piece.first_vertex);
  });
  if (mesh.order() == 2)
    append_pieces(node_file, mesh, {.has_node_points = true}, [](const MeshPiece& piece) {
      return node_lines(piece.node_points, piece.first_node);
    });
  // Number of tetrahedra, points of each, attributes: the body, where there are several.
  element_file.append(Text()
                          .add(mesh.num_cells())
                          .add(mesh.order() == 2 ? " 10 " : " 4 ")
                          .add(mesh.has_bodies() ? "1\n" : "0\n")
                          .text());
  append_pieces(element_file, mesh, {.has_cells = true}, element_lines);
  std::uint64_t bytes = node_file.size() + element_file.size();
  if (faces != nullptr) bytes += write_faces(mesh, *faces);
  if (edges != nullptr) bytes += write_edges(mesh, *edges);
  return bytes;
}

}  // namespace locvol
