#include <array>
#include <bit>
#include <span>
#include <vector>

#include "engine/formats/formats.h"
#include "engine/formats/limits.h"
#include "engine/formats/outputs.h"

namespace locvol {
namespace {

static_assert(std::endian::native == std::endian::little, "written as the machine has it");

// Of vertices; that of a cell is its body, that of a facet its sheet, that of an edge its crease.
constexpr std::uint64_t kReference = 1;

bool needs_64_bits(std::uint64_t num_vertices, std::uint64_t num_cells, std::uint64_t num_facets) {
  return num_vertices > kMaxInt32 || num_cells > kMaxInt32 || num_facets > kMaxInt32;
}

// ---- Text ---------------------------------------------------------------------------------------

Text vertices_of(const std::vector<MeshPiece::Vertex>& points) {
  Text text;
  text.reserve(64 * points.size());
  for (const auto& [x, y, z] : points)
    text.add(x).add(' ').add(y).add(' ').add(z).add(' ').add(kReference).add('\n');
  return text;
}

void add_element(const auto& vertices, const auto& nodes, std::uint64_t reference, Text& text) {
  for (const auto v : vertices) text.add(static_cast<std::uint64_t>(v) + 1).add(' ');
  for (const auto v : nodes) text.add(static_cast<std::uint64_t>(v) + 1).add(' ');
  text.add(reference).add('\n');
}

// Of an element of second order; else none.
template <class Nodes>
std::span<const typename Nodes::value_type> nodes_at(const std::vector<Nodes>& nodes,
                                                     std::size_t element) {
  if (nodes.empty()) return {};
  return nodes[element];
}

Text cells_of(const MeshPiece& piece) {
  Text text;
  text.reserve(40 * piece.cells.size());
  for (std::size_t i = 0; i < piece.cells.size(); ++i)
    add_element(piece.cells[i], nodes_at(piece.nodes, i), piece.body_of(i), text);
  return text;
}

Text facets_of(const BoundarySurface::Facets& some) {
  Text text;
  for (std::size_t i = 0; i < some.facets.size(); ++i)
    add_element(some.facets[i].vertices, nodes_at(some.nodes, i), some.facets[i].labels.sheet,
                text);
  return text;
}

Text edges_of(const LinePiece& piece) {
  Text text;
  for (std::size_t i = 0; i < piece.lines.size(); ++i)
    add_element(piece.lines[i], nodes_at(piece.nodes, i), piece.creases[i], text);
  return text;
}

// Some numbers from 1 on, which follow each other.
Text numbers_from(std::uint64_t first, std::uint64_t count) {
  Text text;
  for (std::uint64_t i = 0; i < count; ++i) text.add(first + i + 1).add('\n');
  return text;
}

std::string section(std::string_view name, std::uint64_t count) {
  return Text().add('\n').add(name).add('\n').add(count).add('\n').text();
}

// Edges are ridges, and corners required: remeshers keep both. There are no ridges of second order,
// for these are numbers of edges of first order.
void append_creases(MeshSource& mesh, AppendedFile& out) {
  if (!mesh.has_creases()) return;
  const bool is_second = mesh.order() == 2;
  out.append(section(is_second ? "EdgesP2" : "Edges", mesh.num_crease_edges()));
  append_boundary(out, mesh, mesh.lines(), edges_of);
  if (!is_second) {
    out.append(section("Ridges", mesh.num_crease_edges()));
    append_boundary(out, mesh, mesh.lines(), [](const LinePiece& piece) {
      return numbers_from(piece.first, piece.lines.size());
    });
  }
  const std::vector<KeptCorner> corners = mesh.corners();
  Text text;
  for (const KeptCorner& corner : corners) text.add(corner.vertex + 1).add('\n');
  for (const std::string_view name : {"Corners", "RequiredVertices"})
    out.append(section(name, corners.size()) + text.text());
}

// ---- Binary: keyword, place of the next keyword, count, lines -----------------------------------

enum Keyword : std::int32_t {
  kDimension = 3,
  kVertices = 4,
  kEdges = 5,
  kTriangles = 6,
  kTetrahedra = 8,
  kCorners = 13,
  kRidges = 14,
  kRequiredVertices = 15,
  kTrianglesP2 = 24,
  kEdgesP2 = 25,
  kTetrahedraP2 = 30,
  kEnd = 54,
};

// Sizes by version: 2 has places and integers of 32 bits, 3 places of 64, 4 both of 64.
struct Widths {
  int version;
  std::uint64_t place() const { return version >= 3 ? 8 : 4; }
  std::uint64_t integer() const { return version >= 4 ? 8 : 4; }
  std::uint64_t section(std::uint64_t num_lines, std::uint64_t line) const {
    return 4 + place() + integer() + num_lines * line;
  }
  std::uint64_t vertex() const { return 3 * 8 + integer(); }
  std::uint64_t element(std::uint64_t num_vertices) const { return (num_vertices + 1) * integer(); }
  std::uint64_t head() const { return 4 + 4 + 4 + place() + 4; }

  void add_place(std::uint64_t value, Bytes& bytes) const {
    version >= 3 ? bytes.add(value) : bytes.add(static_cast<std::int32_t>(value));
  }
  void add_integer(std::uint64_t value, Bytes& bytes) const {
    version >= 4 ? bytes.add(value) : bytes.add(static_cast<std::int32_t>(value));
  }
  void add_element(const auto& vertices, const auto& nodes, std::uint64_t reference,
                   Bytes& bytes) const {
    for (const auto v : vertices) add_integer(static_cast<std::uint64_t>(v) + 1, bytes);
    for (const auto v : nodes) add_integer(static_cast<std::uint64_t>(v) + 1, bytes);
    add_integer(reference, bytes);
  }
};

struct Counts {
  std::uint64_t num_vertices, num_cells, num_facets;
  int order;
  bool has_creases;
  std::uint64_t num_edges, num_corners;
};

std::uint64_t crease_bytes(const Widths& widths, const Counts& n) {
  if (!n.has_creases) return 0;
  return widths.section(n.num_edges, widths.element(num_corners_of_edge(n.order))) +
         (n.order == 1 ? widths.section(n.num_edges, widths.integer()) : 0) +
         2 * widths.section(n.num_corners, widths.integer());
}

std::uint64_t file_bytes(const Widths& widths, const Counts& n) {
  return widths.head() + widths.section(n.num_vertices, widths.vertex()) +
         widths.section(n.num_cells, widths.element(num_corners_of_cell(n.order))) +
         widths.section(n.num_facets, widths.element(num_corners_of_facet(n.order))) +
         crease_bytes(widths, n) + 4 + widths.place();
}

Widths widths_for(const Counts& n, int least_version) {
  Widths widths{least_version};
  if (widths.version < 3 && file_bytes(widths, n) > kMaxInt32) widths.version = 3;
  if (needs_64_bits(n.num_vertices, n.num_cells, n.num_facets)) widths.version = 4;
  return widths;
}

}  // namespace

std::uint64_t write_medit(MeshSource& mesh, PartialFile& file) {
  BoundarySurface& boundary = mesh.boundary();
  AppendedFile out(file, mesh.exchange());
  const bool is_wide = needs_64_bits(mesh.num_points(), mesh.num_cells(), boundary.num_facets());
  const bool is_second = mesh.order() == 2;
  out.append(is_wide ? "MeshVersionFormatted 4\n" : "MeshVersionFormatted 2\n");
  out.append("\nDimension 3\n");
  out.append(section("Vertices", mesh.num_points()));
  append_pieces(out, mesh, {.has_points = true},
                [](const MeshPiece& piece) { return vertices_of(piece.points); });
  if (is_second)
    append_pieces(out, mesh, {.has_node_points = true},
                  [](const MeshPiece& piece) { return vertices_of(piece.node_points); });
  out.append(section(is_second ? "TetrahedraP2" : "Tetrahedra", mesh.num_cells()));
  append_pieces(out, mesh, {.has_cells = true}, cells_of);
  out.append(section(is_second ? "TrianglesP2" : "Triangles", boundary.num_facets()));
  append_boundary(out, mesh, boundary.facets({}), facets_of);
  append_creases(mesh, out);
  out.append("\nEnd\n");
  return out.size();
}

std::uint64_t write_binary_medit(MeshSource& mesh, PartialFile& file, int least_version) {
  BoundarySurface& boundary = mesh.boundary();
  const std::vector<KeptCorner> corners = mesh.corners();
  const Counts n{mesh.num_points(),  mesh.num_cells(),        boundary.num_facets(), mesh.order(),
                 mesh.has_creases(), mesh.num_crease_edges(), corners.size()};
  const bool is_second = n.order == 2;
  const Widths widths = widths_for(n, least_version);
  const std::uint64_t cell_bytes = widths.element(num_corners_of_cell(n.order)),
                      facet_bytes = widths.element(num_corners_of_facet(n.order)),
                      edge_bytes = widths.element(num_corners_of_edge(n.order));
  const std::uint64_t bytes = file_bytes(widths, n);
  if (mesh.is_of_first_rank()) file.reserve(bytes);
  AppendedFile out(file, mesh.exchange());
  const auto begin_section = [&](Keyword keyword, std::uint64_t count, std::uint64_t line) {
    Bytes head;
    head.add(keyword);
    widths.add_place(out.size() + widths.section(count, line), head);
    widths.add_integer(count, head);
    out.append(head.bytes());
  };
  Bytes head;
  head.add(std::int32_t{1}).add(std::int32_t{widths.version}).add(kDimension);
  widths.add_place(widths.head(), head);
  out.append(head.add(std::int32_t{3}).bytes());

  begin_section(kVertices, n.num_vertices, widths.vertex());
  const auto vertex_lines = [&](const std::vector<MeshPiece::Vertex>& points) {
    Bytes some;
    some.reserve(widths.vertex() * points.size());
    for (const auto& point : points) widths.add_integer(kReference, some.add(point));
    return some;
  };
  append_pieces(
      out, mesh, {.has_points = true},
      [&](const MeshPiece& piece) { return vertex_lines(piece.points); },
      widths.vertex() * mesh.own_vertices().size());
  if (is_second)
    append_pieces(
        out, mesh, {.has_node_points = true},
        [&](const MeshPiece& piece) { return vertex_lines(piece.node_points); },
        widths.vertex() * mesh.own_nodes().size());
  begin_section(is_second ? kTetrahedraP2 : kTetrahedra, n.num_cells, cell_bytes);
  const auto cell_lines = [&](const MeshPiece& piece) {
    Bytes some;
    some.reserve(cell_bytes * piece.cells.size());
    for (std::size_t i = 0; i < piece.cells.size(); ++i)
      widths.add_element(piece.cells[i], nodes_at(piece.nodes, i), piece.body_of(i), some);
    return some;
  };
  append_pieces(out, mesh, {.has_cells = true}, cell_lines, cell_bytes * mesh.own_cells().size());
  begin_section(is_second ? kTrianglesP2 : kTriangles, n.num_facets, facet_bytes);
  const auto facet_lines = [&](const BoundarySurface::Facets& some) {
    Bytes list;
    for (std::size_t i = 0; i < some.facets.size(); ++i)
      widths.add_element(some.facets[i].vertices, nodes_at(some.nodes, i),
                         some.facets[i].labels.sheet, list);
    return list;
  };
  append_boundary(out, mesh, boundary.facets({}), facet_lines,
                  facet_bytes * boundary.num_own_facets());
  if (n.has_creases) {
    begin_section(is_second ? kEdgesP2 : kEdges, n.num_edges, edge_bytes);
    const auto edge_lines = [&](const LinePiece& piece) {
      Bytes list;
      for (std::size_t i = 0; i < piece.lines.size(); ++i)
        widths.add_element(piece.lines[i], nodes_at(piece.nodes, i), piece.creases[i], list);
      return list;
    };
    append_boundary(out, mesh, mesh.lines(), edge_lines, edge_bytes * mesh.own_lines().size());
    if (!is_second) {
      begin_section(kRidges, n.num_edges, widths.integer());
      const auto ridge_lines = [&](const LinePiece& piece) {
        Bytes list;
        for (std::size_t i = 0; i < piece.lines.size(); ++i)
          widths.add_integer(piece.first + i + 1, list);
        return list;
      };
      append_boundary(out, mesh, mesh.lines(), ridge_lines,
                      widths.integer() * mesh.own_lines().size());
    }
    Bytes list;
    for (const KeptCorner& corner : corners) widths.add_integer(corner.vertex + 1, list);
    for (const Keyword keyword : {kCorners, kRequiredVertices}) {
      begin_section(keyword, corners.size(), widths.integer());
      out.append(list.bytes());
    }
  }
  Bytes end;
  widths.add_place(0, end.add(kEnd));
  out.append(end.bytes());
  return bytes;
}

}  // namespace locvol
