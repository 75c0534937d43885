// Surfaces as files of every format that is read, with a group of each face where there are some.
#pragma once

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <zlib.h>

#include <bit>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "tests/engine/ingest/surface_fixtures.h"

namespace locvol {

inline void append_double(std::string& out, double value, bool is_big_endian = false) {
  append_bytes(out, std::bit_cast<std::uint64_t>(value), 8, is_big_endian);
}

// As Geomview has it.
inline std::string to_binary_off(const Polygons& s) {
  std::string data = "OFF BINARY\n";
  append_bytes(data, s.vertices.size(), 4, true);
  append_bytes(data, s.faces.size(), 4, true);
  append_bytes(data, 0, 4, true);
  for (const Point& p : s.vertices)
    for (int axis = 0; axis < 3; ++axis) append_float(data, p[axis], true);
  for (const auto& f : s.faces) {
    append_bytes(data, f.size(), 4, true);
    for (const auto v : f) append_bytes(data, v, 4, true);
    append_bytes(data, 0, 4, true);
  }
  return data;
}

using FaceGroups = std::vector<int>;  // of each face; empty: there are none

// ---- VTK, legacy

struct LegacyVtkStyle {
  bool is_binary = false, has_offsets = false;  // the latter from version 5 on
};

inline std::string to_vtk(const Polygons& s, const LegacyVtkStyle& style,
                          const FaceGroups& groups = {}) {
  std::string data =
      fmt::format("# vtk DataFile Version {}\na title\n{}\nDATASET POLYDATA\n",
                  style.has_offsets ? "5.1" : "3.0", style.is_binary ? "BINARY" : "ASCII");
  const auto integer = [&](std::uint64_t value, int bytes) {
    if (style.is_binary)
      append_bytes(data, value, bytes, true);
    else
      data += fmt::format("{} ", value);
  };
  data += fmt::format("POINTS {} double\n", s.vertices.size());
  for (const Point& p : s.vertices)
    for (int axis = 0; axis < 3; ++axis)
      style.is_binary ? append_double(data, p[axis], true)
                      : static_cast<void>(data += fmt::format("{} ", p[axis]));
  std::size_t num_corners = 0;
  for (const auto& f : s.faces) num_corners += f.size();
  const std::size_t num_faces = s.faces.size();
  if (style.has_offsets) {
    data += fmt::format("\nPOLYGONS {} {}\nOFFSETS vtktypeint64\n", num_faces + 1, num_corners);
    std::size_t end = 0;
    integer(0, 8);
    for (const auto& f : s.faces) integer(end += f.size(), 8);
    data += "\nCONNECTIVITY vtktypeint64\n";
  } else {
    data += fmt::format("\nPOLYGONS {} {}\n", num_faces, num_faces + num_corners);
  }
  for (const auto& f : s.faces) {
    if (!style.has_offsets) integer(f.size(), 4);
    for (const auto v : f) integer(v, style.has_offsets ? 8 : 4);
  }
  data += "\n";
  if (groups.empty()) return data;
  data += fmt::format("CELL_DATA {}\nSCALARS heat float 1\nLOOKUP_TABLE default\n", num_faces);
  for (std::size_t f = 0; f < num_faces; ++f)
    style.is_binary ? append_float(data, 0.5, true) : static_cast<void>(data += "0.5 ");
  data += fmt::format("\nFIELD FieldData 1\nregion 1 {} int\n", num_faces);
  for (const int group : groups) integer(static_cast<std::uint32_t>(group), 4);
  return data + "\n";
}

// ---- VTK XML

struct VtpStyle {
  enum class Data { kText, kBase64, kAppended } data = Data::kText;
  bool is_compressed = false, is_big_endian = false;
};

inline std::string to_base64(std::string_view bytes) {
  constexpr std::string_view kDigits =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t bits = 0;
    for (std::size_t k = 0; k < 3; ++k)
      bits = bits << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0U);
    for (std::size_t k = 0; k < 4; ++k)
      text += i + k <= bytes.size() ? kDigits[bits >> (18 - 6 * k) & 63] : '=';
  }
  return text;
}

inline std::string compressed(std::string_view bytes) {
  uLongf size = compressBound(bytes.size());
  std::string packed(size, '\0');
  compress(reinterpret_cast<Bytef*>(packed.data()), &size,
           reinterpret_cast<const Bytef*>(bytes.data()), bytes.size());
  packed.resize(size);
  return packed;
}

inline std::string to_vtp(const Polygons& s, const VtpStyle& style, const FaceGroups& groups = {}) {
  std::string appended;
  // Each value by one function as text, and by one as bytes.
  const auto array = [&](std::string_view name, std::string_view type, std::string_view more,
                         std::size_t count, const auto& text_of, const auto& append_value) {
    std::string bytes, content;
    for (std::size_t i = 0; i < count; ++i) append_value(bytes, i);
    std::string head;
    if (style.is_compressed) {
      std::string packed = compressed(bytes);
      for (const std::uint64_t word : {std::uint64_t{1}, bytes.size(), std::uint64_t{0}})
        append_bytes(head, word, 4, style.is_big_endian);
      append_bytes(head, packed.size(), 4, style.is_big_endian);
      bytes = std::move(packed);
    } else {
      append_bytes(head, bytes.size(), 4, style.is_big_endian);
    }
    const std::string tag = fmt::format("<DataArray type=\"{}\" Name=\"{}\" {}", type, name, more);
    switch (style.data) {
      case VtpStyle::Data::kText:
        for (std::size_t i = 0; i < count; ++i) content += text_of(i) + " ";
        return fmt::format("{} format=\"ascii\">\n{}\n</DataArray>\n", tag, content);
      case VtpStyle::Data::kBase64:
        content =
            style.is_compressed ? to_base64(head) + to_base64(bytes) : to_base64(head + bytes);
        return fmt::format("{} format=\"binary\">\n{}\n</DataArray>\n", tag, content);
      case VtpStyle::Data::kAppended:
        content = fmt::format("{} format=\"appended\" offset=\"{}\"/>\n", tag, appended.size());
        appended += head + bytes;
        return content;
    }
    return content;
  };
  const auto integers = [&](std::string_view name, const std::vector<std::int64_t>& values) {
    return array(
        name, "Int64", "", values.size(), [&](std::size_t i) { return std::to_string(values[i]); },
        [&](std::string& out, std::size_t i) {
          append_bytes(out, static_cast<std::uint64_t>(values[i]), 8, style.is_big_endian);
        });
  };
  std::vector<std::int64_t> corners, ends;
  for (const auto& f : s.faces) {
    corners.insert(corners.end(), f.begin(), f.end());
    ends.push_back(static_cast<std::int64_t>(corners.size()));
  }
  const auto coordinate = [&](std::size_t i) { return s.vertices[i / 3][static_cast<int>(i % 3)]; };
  std::string text = fmt::format(
      "<?xml version=\"1.0\"?>\n<VTKFile type=\"PolyData\" version=\"0.1\" byte_order=\"{}\"{}>\n"
      "<PolyData>\n<Piece NumberOfPoints=\"{}\" NumberOfVerts=\"0\" NumberOfLines=\"0\" "
      "NumberOfStrips=\"0\" NumberOfPolys=\"{}\">\n<CellData>\n",
      style.is_big_endian ? "BigEndian" : "LittleEndian",
      style.is_compressed ? " compressor=\"vtkZLibDataCompressor\"" : "", s.vertices.size(),
      s.faces.size());
  if (!groups.empty()) text += integers("region", {groups.begin(), groups.end()});
  text += "</CellData>\n<Points>\n";
  text += array(
      "Points", "Float64", "NumberOfComponents=\"3\"", 3 * s.vertices.size(),
      [&](std::size_t i) { return fmt::format("{}", coordinate(i)); },
      [&](std::string& out, std::size_t i) {
        append_double(out, coordinate(i), style.is_big_endian);
      });
  text += "</Points>\n<Polys>\n" + integers("connectivity", corners) + integers("offsets", ends) +
          "</Polys>\n</Piece>\n</PolyData>\n";
  if (style.data == VtpStyle::Data::kAppended)
    text += "<AppendedData encoding=\"raw\">_" + appended + "</AppendedData>";
  return text + "</VTKFile>\n";
}

// ---- Gmsh

struct GmshStyle {
  bool is_binary = false, is_old = false;  // the latter is 2.2, not 4.1
};

// Node i has the tag 10 i + 3; groups are physical surfaces with the names "group 1", ...
inline std::string to_msh(const Polygons& s, const GmshStyle& style,
                          const FaceGroups& groups = {}) {
  std::string data =
      fmt::format("$MeshFormat\n{} {} 8\n", style.is_old ? "2.2" : "4.1", style.is_binary ? 1 : 0);
  const auto put = [&](std::uint64_t value, int bytes) {
    if (style.is_binary)
      append_bytes(data, value, bytes);
    else
      data += fmt::format("{} ", static_cast<std::int64_t>(value));
  };
  const auto end_line = [&] {
    if (!style.is_binary) data += "\n";
  };
  if (style.is_binary) {
    put(1, 4);
    data += "\n";
  }
  data += "$EndMeshFormat\n";
  const int num_groups = groups.empty() ? 0 : *std::ranges::max_element(groups);
  if (num_groups > 0) {
    data += fmt::format("$PhysicalNames\n{}\n", num_groups);
    for (int g = 1; g <= num_groups; ++g) data += fmt::format("2 {0} \"group {0}\"\n", g);
    data += "$EndPhysicalNames\n";
  }
  const auto group_of = [&](std::size_t face) { return groups.empty() ? 0 : groups[face]; };
  const auto tag = [](std::uint64_t vertex) { return 10 * vertex + 3; };
  const auto put_position = [&](const Point& p) {
    for (int axis = 0; axis < 3; ++axis)
      style.is_binary ? append_double(data, p[axis])
                      : static_cast<void>(data += fmt::format("{} ", p[axis]));
    end_line();
  };
  const auto type_of = [](std::size_t num_corners) { return num_corners == 3 ? 2U : 3U; };
  if (style.is_old) {
    data += fmt::format("$Nodes\n{}\n", s.vertices.size());
    for (std::size_t v = 0; v < s.vertices.size(); ++v) {
      put(tag(v), 4);
      put_position(s.vertices[v]);
    }
    data +=
        fmt::format("{}$EndNodes\n$Elements\n{}\n", style.is_binary ? "\n" : "", s.faces.size());
    for (std::size_t f = 0; f < s.faces.size(); ++f) {
      const auto group = static_cast<std::uint64_t>(group_of(f));
      const unsigned type = type_of(s.faces[f].size());
      if (style.is_binary)
        for (const std::uint64_t value : {std::uint64_t{type}, std::uint64_t{1}, std::uint64_t{2}})
          put(value, 4);
      put(f + 1, 4);
      if (!style.is_binary) data += fmt::format("{} 2 ", type);
      put(group, 4);
      put(group + 1, 4);
      for (const auto v : s.faces[f]) put(tag(v), 4);
      end_line();
    }
    return data + (style.is_binary ? "\n" : "") + "$EndElements\n";
  }
  // Surface g + 1 is that of group g.
  data += "$Entities\n";
  for (const std::uint64_t count : {0, 0, num_groups + 1, 0}) put(count, 8);
  end_line();
  for (int g = 0; g <= num_groups; ++g) {
    put(static_cast<std::uint64_t>(g + 1), 4);
    put_position({0, 0, 0});
    put_position({1, 1, 1});
    put(g > 0 ? 1 : 0, 8);
    if (g > 0) put(static_cast<std::uint64_t>(g), 4);
    put(0, 8);
    end_line();
  }
  data += (style.is_binary ? "\n" : "") + std::string("$EndEntities\n$Nodes\n");
  for (const std::uint64_t value :
       {std::uint64_t{1}, s.vertices.size(), tag(0), tag(s.vertices.size() - 1)})
    put(value, 8);
  end_line();
  for (const std::uint64_t value : {2, 1, 0}) put(value, 4);
  put(s.vertices.size(), 8);
  end_line();
  for (std::size_t v = 0; v < s.vertices.size(); ++v) put(tag(v), 8);
  end_line();
  for (const Point& p : s.vertices) put_position(p);
  data += (style.is_binary ? "\n" : "") + std::string("$EndNodes\n$Elements\n");
  for (const std::uint64_t value : {s.faces.size(), s.faces.size(), std::size_t{1}, s.faces.size()})
    put(value, 8);
  end_line();
  for (std::size_t f = 0; f < s.faces.size(); ++f) {
    put(2, 4);
    put(static_cast<std::uint64_t>(group_of(f) + 1), 4);
    put(type_of(s.faces[f].size()), 4);
    put(1, 8);
    end_line();
    put(f + 1, 8);
    for (const auto v : s.faces[f]) put(tag(v), 8);
    end_line();
  }
  return data + (style.is_binary ? "\n" : "") + "$EndElements\n";
}

// ---- 3MF

inline std::string to_zip(const std::vector<NamedFile>& files, bool is_deflated) {
  std::string data, directory;
  for (const auto& [name, content] : files) {
    std::string packed = content;
    if (is_deflated) {
      z_stream z{};
      deflateInit2(&z, Z_DEFAULT_COMPRESSION, Z_DEFLATED, -15, 8, Z_DEFAULT_STRATEGY);
      packed.resize(deflateBound(&z, content.size()));
      z.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(content.data()));
      z.avail_in = static_cast<uInt>(content.size());
      z.next_out = reinterpret_cast<Bytef*>(packed.data());
      z.avail_out = static_cast<uInt>(packed.size());
      deflate(&z, Z_FINISH);
      packed.resize(z.total_out);
      deflateEnd(&z);
    }
    const std::size_t place = data.size();
    std::string common;
    append_bytes(common, 20, 2);
    append_bytes(common, 0, 2);
    append_bytes(common, is_deflated ? 8 : 0, 2);
    append_bytes(common, 0, 4);
    append_bytes(
        common,
        crc32(0, reinterpret_cast<const Bytef*>(content.data()), static_cast<uInt>(content.size())),
        4);
    append_bytes(common, packed.size(), 4);
    append_bytes(common, content.size(), 4);
    append_bytes(common, name.size(), 2);
    append_bytes(common, 0, 2);
    data += "PK\3\4" + common + name + packed;
    directory += "PK\1\2";
    append_bytes(directory, 20, 2);
    directory += common;
    append_bytes(directory, 0, 10);
    append_bytes(directory, place, 4);
    directory += name;
  }
  const std::size_t place = data.size();
  data += directory + "PK\5\6" + std::string(4, '\0');
  for (int i = 0; i < 2; ++i) append_bytes(data, files.size(), 2);
  append_bytes(data, directory.size(), 4);
  append_bytes(data, place, 4);
  append_bytes(data, 0, 2);
  return data;
}

// REQUIRES: triangles alone
inline std::string mesh_of_3mf(const Polygons& s) {
  std::string text = "<mesh>\n<vertices>\n";
  for (const Point& p : s.vertices)
    text += fmt::format("<vertex x=\"{}\" y=\"{}\" z=\"{}\"/>\n", p.x, p.y, p.z);
  text += "</vertices>\n<triangles>\n";
  for (const auto& f : s.faces)
    text += fmt::format("<triangle v1=\"{}\" v2=\"{}\" v3=\"{}\"/>\n", f[0], f[1], f[2]);
  return text + "</triangles>\n</mesh>\n";
}
inline std::string to_3mf_of(const std::string& resources, const std::string& build,
                             bool is_deflated = false) {
  return to_zip({{"3D/3dmodel.model",
                  fmt::format("<?xml version=\"1.0\"?>\n<model unit=\"millimeter\">\n<resources>\n"
                              "{}</resources>\n<build>{}</build>\n</model>\n",
                              resources, build)}},
                is_deflated);
}
inline std::string to_3mf(const Polygons& s, bool is_deflated) {
  return to_3mf_of(fmt::format("<object id=\"1\">{}</object>\n", mesh_of_3mf(s)),
                   "<item objectid=\"1\"/>", is_deflated);
}

// ---- glTF

// REQUIRES: triangles alone
inline std::string gltf_buffer(const Polygons& s) {
  std::string bytes;
  for (const Point& p : s.vertices)
    for (int axis = 0; axis < 3; ++axis) append_float(bytes, p[axis]);
  for (const auto& f : s.faces)
    for (const auto v : f) append_bytes(bytes, v, 2);
  return bytes;
}
inline std::string gltf_json(const Polygons& s, const std::string& uri, const std::string& nodes) {
  const std::size_t points = 12 * s.vertices.size(), corners = 6 * s.faces.size();
  return fmt::format(
      R"({{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{}],)"
      R"("meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}],)"
      R"("accessors":[{{"bufferView":0,"componentType":5126,"count":{},"type":"VEC3"}},)"
      R"({{"bufferView":1,"componentType":5123,"count":{},"type":"SCALAR"}}],"bufferViews":[)"
      R"({{"buffer":0,"byteLength":{}}},{{"buffer":0,"byteOffset":{},"byteLength":{}}}],)"
      R"("buffers":[{{"byteLength":{}{}}}]}})",
      nodes, s.vertices.size(), 3 * s.faces.size(), points, points, corners, points + corners,
      uri.empty() ? "" : fmt::format(",\"uri\":\"{}\"", uri));
}
inline std::string to_gltf(const Polygons& s) {
  return gltf_json(s, "data:application/octet-stream;base64," + to_base64(gltf_buffer(s)),
                   R"({"mesh":0})");
}
inline std::string to_glb(const Polygons& s, const std::string& nodes = R"({"mesh":0})") {
  std::string json = gltf_json(s, "", nodes), buffer = gltf_buffer(s);
  json.resize((json.size() + 3) / 4 * 4, ' ');
  buffer.resize((buffer.size() + 3) / 4 * 4, '\0');
  std::string data = "glTF";
  append_bytes(data, 2, 4);
  append_bytes(data, 28 + json.size() + buffer.size(), 4);
  append_bytes(data, json.size(), 4);
  data += "JSON" + json;
  append_bytes(data, buffer.size(), 4);
  return data + std::string("BIN\0", 4) + buffer;
}

// ---- All of them

// Those of `s`, which has triangles alone where `has_triangles` says so.
inline std::vector<NamedFile> in_every_format(const Polygons& s) {
  std::vector<NamedFile> files = {
      {"cube.off", to_off(s)},
      {"cube.obj", to_obj(s)},
      {"ascii.stl", to_ascii_stl(s)},
      {"binary.stl", to_binary_stl(s)},
      {"ascii.ply", to_ply(s, PlyEncoding::kAscii)},
      {"little.ply", to_ply(s, PlyEncoding::kLittleEndian)},
      {"big.ply", to_ply(s, PlyEncoding::kBigEndian)},
      {"binary.off", to_binary_off(s)},
      {"ascii_3.vtk", to_vtk(s, {})},
      {"ascii_5.vtk", to_vtk(s, {.has_offsets = true})},
      {"binary_3.vtk", to_vtk(s, {.is_binary = true})},
      {"binary_5.vtk", to_vtk(s, {.is_binary = true, .has_offsets = true})},
      {"text.vtp", to_vtp(s, {})},
      {"base64.vtp", to_vtp(s, {.data = VtpStyle::Data::kBase64})},
      {"zlib.vtp", to_vtp(s, {.data = VtpStyle::Data::kBase64, .is_compressed = true})},
      {"appended.vtp", to_vtp(s, {.data = VtpStyle::Data::kAppended, .is_big_endian = true})},
      {"ascii_2.msh", to_msh(s, {.is_old = true})},
      {"binary_2.msh", to_msh(s, {.is_binary = true, .is_old = true})},
      {"ascii_4.msh", to_msh(s, {})},
      {"binary_4.msh", to_msh(s, {.is_binary = true})},
  };
  if (std::ranges::all_of(s.faces, [](const auto& f) { return f.size() == 3; }))
    files.insert(files.end(), {{"stored.3mf", to_3mf(s, false)},
                               {"deflated.3mf", to_3mf(s, true)},
                               {"cube.glb", to_glb(s)},
                               {"cube.gltf", to_gltf(s)}});
  return files;
}

}  // namespace locvol
