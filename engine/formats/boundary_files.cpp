#include <array>
#include <bit>
#include <cmath>
#include <utility>
#include <vector>

#include "engine/formats/formats.h"
#include "engine/formats/mesh_arrays.h"
#include "engine/formats/mesh_format.h"
#include "engine/formats/outputs.h"
#include "engine/formats/sheet_names.h"

namespace locvol {
namespace {

static_assert(std::endian::native == std::endian::little, "STL and PLY are little-endian");

using Float3 = std::array<float, 3>;

Float3 in_floats(const Point& p) {
  return {static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)};
}

bool is_distinct(const std::array<Float3, 3>& corners) {
  for (const Float3& corner : corners)
    for (const float c : corner)
      if (!std::isfinite(c)) return false;
  return corners[0] != corners[1] && corners[1] != corners[2] && corners[2] != corners[0];
}

// STL has float32 coordinates, which must tell the corners of each triangle apart.
void check_resolution(MeshSource& mesh, const std::filesystem::path& file) {
  do_on_all(mesh.exchange(), [&, &boundary = mesh.boundary()] {
    encode_in_order(
        mesh.workers(), boundary.facets({.has_corners = true}),
        [](const BoundarySurface::Facets& some) {
          for (const auto& [a, b, c] : some.corners)
            if (!is_distinct({in_floats(a), in_floats(b), in_floats(c)})) return false;
          return true;
        },
        [&](bool is_fine) {
          if (!is_fine)
            throw FormatLimit("cannot write " + file.string() +
                              ": the float32 coordinates of STL cannot tell neighboring vertices "
                              "apart; write ply or obj, or move the model closer to the origin");
        });
  });
}

Point unit_normal(const std::array<Point, 3>& corners) {
  const Point normal = cross(corners[1] - corners[0], corners[2] - corners[0]);
  const double length = norm(normal);
  return length > 0 ? (1 / length) * normal : Point{};
}

constexpr std::uint64_t kStlTriangleBytes = 50, kPlyVertexBytes = 24, kPlyTriangleBytes = 13;

bool has_sheets(const MeshSource& mesh) { return !mesh.sheets().sheets.empty(); }

void add_point(std::string_view before, const Point& p, Text& text) {
  text.add(before).add(p.x).add(' ').add(p.y).add(' ').add(p.z).add('\n');
}

}  // namespace

// 80 bytes of text, the number of triangles (32 bits), then 50 bytes for each: the normal and three
// corners in float32, and 16 bits unused.
std::uint64_t write_stl(MeshSource& mesh, PartialFile& file) {
  check_resolution(mesh, file.name());
  BoundarySurface& boundary = mesh.boundary();
  std::string text = "binary STL by locvol";  // must not begin with "solid"
  text.resize(80, ' ');
  AppendedFile out(file, mesh.exchange());
  Bytes head;
  out.append(head.add_text(text).add(static_cast<std::uint32_t>(boundary.num_facets())).bytes());
  const auto triangles_of = [](const BoundarySurface::Facets& some) {
    Bytes triangles;
    for (const auto& corners : some.corners) {
      triangles.add(in_floats(unit_normal(corners)));
      for (const Point& corner : corners) triangles.add(in_floats(corner));
      triangles.add(std::uint16_t{0});
    }
    return triangles;
  };
  append_boundary(out, mesh, boundary.facets({.has_corners = true}), triangles_of,
                  kStlTriangleBytes * boundary.num_own_facets());
  return out.size();
}

// A solid for each sheet; coordinates are doubles.
std::uint64_t write_stl_text(MeshSource& mesh, PartialFile& file) {
  BoundarySurface& boundary = mesh.boundary();
  boundary.sort_facets();
  AppendedFile out(file, mesh.exchange());
  const auto triangles_of = [](const BoundarySurface::Facets& some) {
    Text text;
    for (const auto& corners : some.corners) {
      add_point("facet normal ", unit_normal(corners), text);
      text.add("outer loop\n");
      for (const Point& corner : corners) add_point("vertex ", corner, text);
      text.add("endloop\nendfacet\n");
    }
    return text;
  };
  const auto names = names_of_sheets(mesh.sheets(), {});
  for (SheetId sheet = 1; sheet <= boundary.num_sheets(); ++sheet) {
    out.append("solid " + names[sheet - 1] + '\n');
    append_boundary(out, mesh, boundary.facets_of(sheet, {.has_corners = true}), triangles_of);
    out.append("endsolid " + names[sheet - 1] + '\n');
  }
  return out.size();
}

// Vertices in float64, triangles with int32 indices: uint32 is read as int32 by some.
std::uint64_t write_ply(MeshSource& mesh, PartialFile& file) {
  BoundarySurface& boundary = mesh.boundary();
  AppendedFile out(file, mesh.exchange());
  Text head;
  head.add("ply\nformat binary_little_endian 1.0\ncomment by locvol\n");
  std::uint64_t sheet = 0;
  for (const SheetFacts& facts : mesh.sheets().sheets)
    head.add("comment sheet ").add(++sheet).add(": ").add(facts.name).add('\n');
  head.add("element vertex ").add(boundary.num_vertices());
  head.add("\nproperty double x\nproperty double y\nproperty double z\nelement face ");
  head.add(boundary.num_facets()).add("\nproperty list uchar int vertex_indices\n");
  out.append(head.add(has_sheets(mesh) ? "property int sheet\n" : "").add("end_header\n").text());
  const auto vertices_of = [](const BoundarySurface::Vertices& some) {
    Bytes vertices;
    for (const Point& p : some.positions) vertices.add(p.x).add(p.y).add(p.z);
    return vertices;
  };
  append_boundary(out, mesh, boundary.vertices(), vertices_of,
                  kPlyVertexBytes * boundary.num_own_vertices());
  const bool has_property = has_sheets(mesh);
  const auto triangles_of = [&](const BoundarySurface::Facets& some) {
    Bytes triangles;
    for (std::size_t f = 0; f < some.places.size(); ++f) {
      triangles.add(std::uint8_t{3});
      for (const std::uint64_t place : some.places[f])
        triangles.add(static_cast<std::int32_t>(place));
      if (has_property) triangles.add(static_cast<std::int32_t>(some.facets[f].labels.sheet));
    }
    return triangles;
  };
  append_boundary(out, mesh, boundary.facets({.has_places = true}), triangles_of,
                  (kPlyTriangleBytes + (has_property ? 4 : 0)) * boundary.num_own_facets());
  return out.size();
}

std::uint64_t write_obj(MeshSource& mesh, PartialFile& file) {
  BoundarySurface& boundary = mesh.boundary();
  boundary.num_vertices();
  AppendedFile out(file, mesh.exchange());
  out.append("# boundary by locvol\n");
  const auto vertices_of = [](const BoundarySurface::Vertices& some) {
    Text text;
    for (const Point& p : some.positions) add_point("v ", p, text);
    return text;
  };
  append_boundary(out, mesh, boundary.vertices(), vertices_of);
  const auto triangles_of = [](const BoundarySurface::Facets& some) {
    Text text;
    for (const auto& [a, b, c] : some.places)
      text.add("f ").add(a + 1).add(' ').add(b + 1).add(' ').add(c + 1).add('\n');
    return text;
  };
  boundary.sort_facets();
  const auto names = names_of_sheets(mesh.sheets(), {.forbidden = " \t#\\"});
  for (SheetId sheet = 1; sheet <= boundary.num_sheets(); ++sheet) {
    if (has_sheets(mesh)) out.append("g " + names[sheet - 1] + '\n');
    append_boundary(out, mesh, boundary.facets_of(sheet, {.has_places = true}), triangles_of);
  }
  return out.size();
}

// Arrays are appended one after another, each with its length in bytes before it.
std::uint64_t write_vtp(MeshSource& mesh, PartialFile& file) {
  BoundarySurface& boundary = mesh.boundary();
  const std::uint64_t num_vertices = boundary.num_vertices(), num = boundary.num_facets(),
                      num_own = boundary.num_own_facets();
  constexpr std::uint64_t kIndex = sizeof(std::int64_t), kLabel = sizeof(std::uint32_t);
  std::vector<VtuArrayEntry> arrays;
  std::uint64_t end = 0;
  const auto add_array = [&](VtuSection section, const char* name, const char* type,
                             std::uint64_t num_components, std::uint64_t num_bytes) {
    arrays.push_back({section, name, type, num_components, end});
    end += sizeof(std::uint64_t) + num_bytes;
    return num_bytes;
  };
  using Labels = std::uint32_t FacetLabels::*;
  std::vector<std::pair<const char*, Labels>> labels;
  if (has_sheets(mesh)) labels.emplace_back("sheet", &FacetLabels::sheet);
  if (mesh.has_bodies())
    labels.insert(labels.end(),
                  {{"behind", &FacetLabels::behind}, {"before", &FacetLabels::before}});
  const std::uint64_t point_bytes =
      add_array(VtuSection::kPoints, "Points", "Float64", 3, kPlyVertexBytes * num_vertices);
  const std::uint64_t corner_bytes =
      add_array(VtuSection::kCells, "connectivity", "Int64", 1, 3 * kIndex * num);
  const std::uint64_t end_bytes =
      add_array(VtuSection::kCells, "offsets", "Int64", 1, kIndex * num);
  for (const auto& [name, member] : labels)
    add_array(VtuSection::kCellData, name, "UInt32", 1, kLabel * num);

  AppendedFile out(file, mesh.exchange());
  out.append(vtp_header(num_vertices, num, arrays, name_fields(mesh, {.has_boundary = true})));
  const auto append_count = [&](std::uint64_t num_bytes) {
    out.append(Bytes().add(num_bytes).bytes());
  };
  append_count(point_bytes);
  append_boundary(
      out, mesh, boundary.vertices(),
      [](const BoundarySurface::Vertices& some) {
        Bytes vertices;
        for (const Point& p : some.positions) vertices.add(p.x).add(p.y).add(p.z);
        return vertices;
      },
      kPlyVertexBytes * boundary.num_own_vertices());
  append_count(corner_bytes);
  append_boundary(
      out, mesh, boundary.facets({.has_places = true}),
      [](const BoundarySurface::Facets& some) {
        Bytes corners;
        for (const auto& places : some.places)
          for (const std::uint64_t place : places) corners.add(static_cast<std::int64_t>(place));
        return corners;
      },
      3 * kIndex * num_own);
  append_count(end_bytes);
  append_boundary(
      out, mesh, boundary.facets({}),
      [](const BoundarySurface::Facets& some) {
        Bytes ends;
        for (std::uint64_t i = 1; i <= some.facets.size(); ++i)
          ends.add(static_cast<std::int64_t>(3 * (some.first + i)));
        return ends;
      },
      kIndex * num_own);
  for (const auto& [name, member] : labels) {
    append_count(kLabel * num);
    append_boundary(
        out, mesh, boundary.facets({}),
        [member = member](const BoundarySurface::Facets& some) {
          Bytes values;
          for (const BoundaryFacet& facet : some.facets) values.add(facet.labels.*member);
          return values;
        },
        kLabel * num_own);
  }
  out.append(kVtuFooter);
  return out.size();
}

}  // namespace locvol
