#include <algorithm>
#include <array>
#include <charconv>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "engine/formats/formats.h"
#include "engine/formats/outputs.h"
#include "engine/formats/sheet_names.h"
#include "engine/output/by_sheet.h"

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

Text nodes_of(const std::vector<MeshPiece::Vertex>& points, std::uint64_t first) {
  Text text;
  text.reserve(64 * points.size());
  std::uint64_t label = first;
  for (const auto& point : points) {
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
  for (std::size_t i = 0; i < piece.cells.size(); ++i) {
    text.add(piece.first_cell + i + 1);
    const auto add = [&](std::int64_t v) { text.add(", ").add(static_cast<std::uint64_t>(v) + 1); };
    std::ranges::for_each(piece.cells[i], add);
    if (!piece.nodes.empty()) std::ranges::for_each(piece.nodes[i], add);
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

// `num_before`, `num_all`: vertices and nodes of the set, before these and all
Text node_set_of(const auto& some, std::uint64_t num_before, std::uint64_t num_all) {
  Text text;
  std::uint64_t count = num_before + some.first;
  for (const std::uint64_t vertex : some.vertices) {
    const bool ends_line = ++count % kLabelsPerLine == 0 || count == num_all;
    text.add(vertex + 1).add(ends_line ? "\n" : ", ");
  }
  return text;
}

// Vertices, and then nodes.
void append_node_set(MeshSource& mesh, std::optional<SheetId> sheet, AppendedFile& out) {
  BoundarySurface& boundary = mesh.boundary();
  const std::uint64_t num_vertices =
      sheet ? boundary.num_vertices_of(*sheet) : boundary.num_vertices();
  std::uint64_t num_all = num_vertices;
  if (mesh.order() == 2)
    num_all += sheet ? mesh.boundary_nodes().num_nodes_of(*sheet) : mesh.boundary_nodes().size();
  const auto append = [&](const auto& next, std::uint64_t num_before) {
    append_boundary(out, mesh, next, [=](const BoundarySurface::Vertices& some) {
      return node_set_of(some, num_before, num_all);
    });
  };
  append(sheet ? boundary.vertices_of(*sheet) : boundary.vertices(), 0);
  if (mesh.order() == 2)
    append(sheet ? mesh.boundary_nodes().nodes_of(*sheet) : mesh.boundary_nodes().nodes(),
           num_vertices);
}

MeshNames names_of(const MeshSource& mesh) {
  return names_of_mesh(mesh.sheets(), mesh.has_creases(),
                       {.most_bytes = 80, .is_identifier = true, .taken = {"boundary", "volume"}});
}

// A set of nodes and a surface of each sheet, for CalculiX derives none from the other.
void append_sheets(MeshSource& mesh, const std::vector<std::string>& names, AppendedFile& out) {
  BoundarySurface& boundary = mesh.boundary();
  boundary.sort_facets();
  for (SheetId sheet = 1; sheet <= boundary.num_sheets(); ++sheet) {
    const std::string& name = names[sheet - 1];
    if (boundary.num_facets_of(sheet) == 0) continue;  // a set that is empty is refused
    out.append("*NSET, NSET=" + name + '\n');
    append_node_set(mesh, sheet, out);
    out.append("*SURFACE, NAME=" + name + ", TYPE=ELEMENT\n");
    append_boundary(out, mesh, boundary.facets_of(sheet, {}), faces_of);
  }
}

// A set of elements of each body.
void append_bodies(MeshSource& mesh, const std::vector<std::string>& names, AppendedFile& out) {
  struct Numbered {
    std::uint64_t first_cell;
    std::vector<BodyId> bodies;
  };
  BySheet<std::uint64_t> cells(mesh.output(), names.size());  // by body
  do_on_all(mesh.exchange(), [&] {
    mesh.for_each_piece(
        {.has_cells = true},
        [](const MeshPiece& piece) {
          return Numbered{piece.first_cell, piece.bodies};
        },
        [&](const Numbered& some) {
          for (std::size_t i = 0; i < some.bodies.size(); ++i)
            cells.append(some.bodies[i], some.first_cell + i);
        });
  });
  cells.finish(mesh.exchange());
  for (BodyId body = 1; body <= names.size(); ++body) {
    const auto [num_all, num_before] = cells.of_ranks(body);
    if (num_all == 0) continue;
    out.append("*ELSET, ELSET=" + names[body - 1] + '\n');
    append_boundary(
        out, mesh,
        [&, from = std::uint64_t{0}]() mutable -> std::optional<BoundarySurface::Vertices> {
          constexpr std::uint64_t kAtOnce = std::uint64_t{1} << 16;
          const std::uint64_t num = std::min(kAtOnce, cells.num_own(body) - from);
          if (num == 0) return std::nullopt;
          BoundarySurface::Vertices some{num_before + from, cells.read(body, from, num), {}};
          from += num;
          return some;
        },
        [&](const BoundarySurface::Vertices& some) { return node_set_of(some, 0, num_all); });
  }
}

// A set of nodes of each crease and corner that the mesh has.
void append_creases(MeshSource& mesh, const MeshNames& names, AppendedFile& out) {
  KeptCreases& creases = mesh.creases();
  creases.sort();
  for (CreaseId crease = 1; crease <= names.creases.size(); ++crease) {
    const std::uint64_t num_vertices = creases.num_vertices_of(crease);
    if (num_vertices == 0) continue;
    out.append("*NSET, NSET=" + names.creases[crease - 1] + '\n');
    const std::uint64_t num_all =
        num_vertices + (mesh.order() == 2 ? creases.kept()[crease - 1].num_edges : 0);
    append_boundary(out, mesh, creases.vertices_of(crease), [&](const KeptCreases::Vertices& some) {
      return node_set_of(some, 0, num_all);
    });
    if (mesh.order() == 2)
      append_boundary(out, mesh, creases.nodes_of(crease), [&](const KeptCreases::Vertices& some) {
        return node_set_of(some, num_vertices, num_all);
      });
  }
  for (const KeptCorner& corner : creases.corners())
    out.append(Text()
                   .add("*NSET, NSET=")
                   .add(names.corners.at(corner.corner - 1))
                   .add('\n')
                   .add(corner.vertex + 1)
                   .add('\n')
                   .text());
}

}  // namespace

std::uint64_t write_abaqus(MeshSource& mesh, PartialFile& file) {
  BoundarySurface& boundary = mesh.boundary();
  boundary.num_vertices();
  AppendedFile out(file, mesh.exchange());
  out.append("*HEADING\ntetrahedra by locvol\n*NODE\n");
  append_pieces(out, mesh, {.has_points = true},
                [](const MeshPiece& piece) { return nodes_of(piece.points, piece.first_vertex); });
  if (mesh.order() == 2)
    append_pieces(out, mesh, {.has_node_points = true}, [](const MeshPiece& piece) {
      return nodes_of(piece.node_points, piece.first_node);
    });
  out.append(mesh.order() == 2 ? "*ELEMENT, TYPE=C3D10, ELSET=volume\n"
                               : "*ELEMENT, TYPE=C3D4, ELSET=volume\n");
  append_pieces(out, mesh, {.has_cells = true}, elements_of);
  out.append("*NSET, NSET=boundary\n");
  append_node_set(mesh, std::nullopt, out);
  out.append("*SURFACE, NAME=boundary, TYPE=ELEMENT\n");
  append_boundary(out, mesh, boundary.facets({}), faces_of);
  const MeshNames names = names_of(mesh);
  if (mesh.has_bodies()) append_bodies(mesh, names.bodies, out);
  if (!mesh.sheets().sheets.empty()) append_sheets(mesh, names.sheets, out);
  if (mesh.has_creases()) append_creases(mesh, names, out);
  return out.size();
}

}  // namespace locvol
