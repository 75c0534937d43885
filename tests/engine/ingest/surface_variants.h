// One small box in the formats of the reader, as many programs write them: all have the same
// triangles in the same order.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <functional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "tests/engine/ingest/surface_fixtures.h"

namespace locvol {

struct SurfaceVariant {
  std::string name;  // of the file, which says who writes such
  std::string content;
};

// Its coordinates are floats, and short in decimal digits.
inline Polygons variant_box() { return box_of_triangles({-0.5, 0.25, 1}, {1.5, 1.25, 3}); }

using NumberText = std::function<std::string(double)>;

inline std::string replaced(std::string text, std::string_view from, std::string_view to) {
  for (std::size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size())
    text.replace(at, from.size(), to);
  return text;
}

inline std::string shortest(double v) { return fmt::format("{}", v); }
inline std::string fixed6(double v) { return fmt::format("{:.6f}", v); }
inline std::string scientific(double v) { return fmt::format("{:.6e}", v); }
inline std::string scientific15(double v) { return fmt::format("{:.15e}", v); }
// As the C library of old Windows: 1.0E+000.
inline std::string three_digit_exponent(double v) {
  const std::string text = fmt::format("{:.6E}", v);
  return text.substr(0, text.size() - 2) + "0" + text.substr(text.size() - 2);
}
inline std::string of_fortran(double v) { return replaced(fmt::format("{:.9E}", v), "E", "D"); }
inline std::string plus_and_point(double v) {
  std::string text = fmt::format("{:+g}", v);
  if (text.find('.') == std::string::npos) text += ".";
  return replaced(replaced(text, "+0.", "+."), "-0.", "-.");
}

// ---- ASCII STL

struct StlStyle {
  std::string before = "", solid = "solid box\n";
  std::string facet = " facet normal 0 0 0\n", loop = "  outer loop\n", vertex = "   vertex ";
  std::string between = " ", after = "\n";  // coordinates, and a vertex
  std::string end_loop = "  endloop\n", end_facet = " endfacet\n", end_solid = "endsolid box\n";
  NumberText number = shortest;
  std::size_t solid_after = 0;  // so many facets another solid begins; 0: there is one
};

inline std::string to_stl(const StlStyle& style) {
  const Polygons box = variant_box();
  std::string text = style.before + style.solid;
  for (std::size_t f = 0; f < box.faces.size(); ++f) {
    if (style.solid_after > 0 && f > 0 && f % style.solid_after == 0)
      text += style.end_solid + style.solid;
    text += style.facet + style.loop;
    for (const auto v : box.faces[f]) {
      const Point& p = box.vertices[v];
      text += style.vertex + style.number(p.x) + style.between + style.number(p.y) + style.between +
              style.number(p.z) + style.after;
    }
    text += style.end_loop + style.end_facet;
  }
  return text + style.end_solid;
}

inline std::string in_capitals(std::string text) {
  std::ranges::transform(text, text.begin(),
                         [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  return text;
}

inline std::vector<SurfaceVariant> ascii_stl_variants() {
  const std::string plain = to_stl({});
  return {
      {"admesh.stl", to_stl({.solid = "solid  Processed by ADMesh version 0.98.4\n",
                             .facet = "  facet normal  0.00000000E+00  0.00000000E+00  1.0E+00\n",
                             .vertex = "      vertex ",
                             .between = "  ",
                             .number = scientific})},
      {"assimp.stl", to_stl({.solid = "solid AssimpScene\n", .end_solid = "endsolidAssimpScene"})},
      {"autocad.stl", to_stl({.solid = "solid AutoCAD\n",
                              .facet = "   facet normal 0.0000000e+000 0.0000000e+000 1.0e+000\n",
                              .end_solid = "endsolid AutoCAD\n",
                              .number = three_digit_exponent})},
      {"blender.stl", to_stl({.solid = "solid Exported from Blender-2.82 (sub 7)\n",
                              .facet = "facet normal -0.000000 -0.000000 1.000000\n",
                              .loop = "outer loop\n",
                              .vertex = "vertex ",
                              .end_loop = "endloop\n",
                              .end_facet = "endfacet\n",
                              .end_solid = "endsolid Exported from Blender-2.82 (sub 7)\n",
                              .number = fixed6})},
      {"catia.stl", to_stl({.solid = "solid CATIA STL\n",
                            .facet = "  facet normal  0.000000e+000  0.000000e+000  1.0e+000\n",
                            .loop = "    outer loop\n",
                            .vertex = "      vertex  ",
                            .between = "  ",
                            .end_solid = "endsolid CATIA STL\n",
                            .number = three_digit_exponent})},
      {"cubit.stl", to_stl({.solid = "solid Body_1\n", .end_solid = "endsolid Body_1\n\n\n"})},
      {"creo.stl", replaced(to_stl({.solid = "solid PART0001 (mm) facet\n", .number = scientific}),
                            "\n", "\r\n")},
      {"deform_3d.stl", in_capitals(to_stl({.solid = "solid deform-3d stl file               \n",
                                            .number = scientific}))},
      {"end_in_two_words.stl",
       to_stl(
           {.end_loop = "end loop\n", .end_facet = "end facet\n", .end_solid = "end solid box\n"})},
      {"fortran.stl", to_stl({.number = of_fortran})},
      {"freecad.stl", to_stl({.solid = "solid \n", .end_solid = "endsolid \n", .number = fixed6})},
      {"gmsh.stl", to_stl({.solid = "solid Created by Gmsh\n",
                           .facet = "facet normal 0 0 1\n",
                           .loop = "  outer loop\n",
                           .vertex = "    vertex ",
                           .end_facet = "endfacet\n",
                           .end_solid = "endsolid Created by Gmsh\n",
                           .number = [](double v) { return fmt::format("{:.16g}", v); }})},
      {"gmsh_3_solids.stl", to_stl({.solid = "solid surface 1\n", .solid_after = 4})},
      {"inventor.stl", replaced(to_stl({.solid = "solid Box1:facet 1\n"}), "\n", "\r\n")},
      {"lisp.stl", to_stl({.facet = " facet\n"})},
      {"mac_os_9.stl", replaced(plain, "\n", "\r")},
      {"matlab.stl", to_stl({.solid = "solid Created by stlwrite.m 14-Mar-2013 12:00:00\n",
                             .facet = "facet normal NaN NaN NaN\n",
                             .number = scientific})},
      {"msvc.stl", to_stl({.facet = "facet normal -1.#IND000 1.#QNAN0 -nan(ind)\n"})},
      {"netfabb.stl",
       "\xef\xbb\xbf" + replaced(to_stl({.solid = "solid Quader é\n"}), "\n", "\r\n")},
      {"no_facet_normals.stl", to_stl({.facet = "facet 0 0 1\n"})},
      {"numpy_stl.stl", to_stl({.solid = "solid \n", .end_solid = "endsolid"})},
      {"openfoam.stl", to_stl({.solid = "solid inlet\n", .solid_after = 2})},
      {"openscad.stl", to_stl({.solid = "solid OpenSCAD_Model\n",
                               .facet = "  facet normal -0 0 1\n",
                               .loop = "    outer loop\n",
                               .vertex = "      vertex ",
                               .end_loop = "    endloop\n",
                               .end_facet = "  endfacet\n",
                               .end_solid = "endsolid OpenSCAD_Model\n"})},
      {"one_line_facets.stl", to_stl({.facet = "facet normal 0 0 1 ",
                                      .loop = "outer loop ",
                                      .vertex = "vertex ",
                                      .after = " ",
                                      .end_loop = "endloop "})},
      {"padded.stl", plain + std::string(77, '\0')},
      {"plus.stl", to_stl({.number = plus_and_point})},
      {"raw_script.stl", to_stl({.solid = "", .end_solid = ""})},
      {"salome.stl", to_stl({.solid = "solid\n", .end_solid = "endsolid\n", .number = scientific})},
      {"solidworks.stl",
       replaced(to_stl({.solid = "solid Part1\n",
                        .facet = "   facet normal 0.000000e+00 0.000000e+00 1.000000e+00\n",
                        .loop = "      outer loop\n",
                        .vertex = "         vertex ",
                        .end_loop = "      endloop\n",
                        .end_facet = "   endfacet\n",
                        .end_solid = "endsolid\n",
                        .number = scientific}),
                "\n", "\r\n")},
      {"tabs.stl", replaced(to_stl({.facet = "\tfacet normal 0 0 1\n",
                                    .loop = "\t\touter loop\n",
                                    .vertex = "\t\t\tvertex\t",
                                    .between = "\t",
                                    .after = "\t \n"}),
                            "solid box", "solid\tbox")},
      {"text_before.stl", to_stl({.before = "# exported today\n\n; unit = mm\nUnits: mm\n\n"})},
      {"twice_through_windows.stl", replaced(plain, "\n", "\r\r\n")},
      {"vertex_colors.stl", to_stl({.after = " 0.5 0.5 0.5\n"})},
      {"vtk.stl", to_stl({.solid = "solid Visualization Toolkit generated SLA File\n",
                          .facet = " facet normal 0.000000e+00 0.000000e+00 1.000000e+00\n",
                          .end_solid = "endsolid\n",
                          .number = scientific})},
      {"without_end.stl", to_stl({.end_solid = ""})},
      {"word_in_name.stl", to_stl({.solid = "solid facet normal vertex endsolid\n",
                                   .end_solid = "endsolid facet outer loop\n"})},
      {"control_z.stl", replaced(plain, "\n", "\r\n") + "\x1a"},
  };
}

// ---- Binary STL

inline std::vector<SurfaceVariant> binary_stl_variants() {
  const auto with_count = [](std::string data, std::uint32_t count) {
    for (std::size_t i = 0; i < 4; ++i) data[80 + i] = static_cast<char>(count >> (8 * i));
    return data;
  };
  const std::string plain = to_binary_stl(variant_box());
  std::string colored = to_binary_stl(
      variant_box(),
      "COLOR=\xa9\xa9\xff\xff,MATERIAL=\x7f\x7f\x7f\xff\x7f\x7f\x7f\xff\x7f\x7f\x7f\xff");
  for (std::size_t t = 0; t < 12; ++t) colored[84 + 50 * t + 48] = static_cast<char>(0x80 + t);
  return {
      {"fusion_360.stl", plain},
      {"solid_in_header.stl", to_binary_stl(variant_box(), "solid binary by an old exporter\n")},
      {"meshlab.stl", to_binary_stl(variant_box(), std::string_view("VCG\0\0", 5))},
      {"trimesh.stl", to_binary_stl(variant_box(), std::string(80, '\0'))},
      {"magics.stl", colored},
      {"onshape.stl", to_binary_stl(variant_box(), std::string(80, '\xff'))},
      {"trailing_bytes.stl", plain + "\n"},
      {"sectors.stl", plain + std::string(1024 - plain.size() % 512, '\0')},
      {"count_of_0.stl", with_count(plain, 0)},
      {"count_too_low.stl", with_count(plain, 6)},
  };
}

// ---- OBJ

struct ObjStyle {
  std::string before = "", vertex = "v ", between = " ", after = "\n";
  std::string others = "";    // between vertices and faces
  std::string corner = "{}";  // for fmt, of the number of the vertex
  std::string face = "f ", after_corner = " ", after_face = "\n";
  bool is_relative = false;
  NumberText number = shortest;
};

inline std::string to_obj(const ObjStyle& style) {
  const Polygons box = variant_box();
  std::string text = style.before;
  for (const Point& p : box.vertices)
    text += style.vertex + style.number(p.x) + style.between + style.number(p.y) + style.between +
            style.number(p.z) + style.after;
  text += style.others;
  for (const auto& face : box.faces) {
    text += style.face;
    for (std::size_t i = 0; i < 3; ++i) {
      const int number =
          style.is_relative ? static_cast<int>(face[i]) - 8 : static_cast<int>(face[i]) + 1;
      text += fmt::format(fmt::runtime(style.corner), number) + (i < 2 ? style.after_corner : "");
    }
    text += style.after_face;
  }
  return text;
}

inline std::vector<SurfaceVariant> obj_variants() {
  const std::string normals = "vn 0.0000 0.0000 1.0000\n", textures = "vt 0.0 0.0\n";
  return {
      {"blender.obj",
       to_obj(ObjStyle{.before = "# Blender v2.93.1 OBJ File: ''\n# www.blender.org\n"
                                 "mtllib box.mtl\no Cube\n",
                       .others = textures + normals + "usemtl Material\ns off\n",
                       .corner = "{}/1/1",
                       .number = fixed6})},
      {"meshlab.obj",
       to_obj(ObjStyle{.before = "####\n#\n# OBJ File Generated by Meshlab\n#\n####\n",
                       .after = " 0.501961 0.501961 0.501961\n",
                       .others = "# 8 vertices, 0 vertices normals\n\n",
                       .after_face = "\n",
                       .number = fixed6})},
      {"rhino.obj", to_obj(ObjStyle{.before = "# Rhino\n\no object_1\n",
                                    .others = textures + normals,
                                    .corner = "{}/1/1",
                                    .after_corner = " \\\n  "})},
      {"rhino_windows.obj",
       replaced(to_obj(ObjStyle{.others = "l 1 2 \\\n 3 4\n", .after_corner = " \\\n"}), "\n",
                "\r\n")},
      {"3ds_max.obj",
       replaced(to_obj(ObjStyle{.before = "# 3ds Max Wavefront OBJ Exporter v0.97b\n"
                                          "mtllib box.mtl\n\n#\n# object Box001\n#\n\n",
                                .vertex = "v  ",
                                .others = normals + "# 1 vertex normals\n\no Box001\n"
                                                    "g Box001\nusemtl wire_1\ns 2\n",
                                .corner = "{}//1",
                                .after_face = " \n",
                                .number = fixed6}),
                "\n", "\r\n")},
      {"maya.obj",
       to_obj(ObjStyle{.before = "# This file uses centimeters as units.\n\nmtllib b.mtl\n"
                                 "g default\n",
                       .others = textures + normals + "s off\ng pCube1\nusemtl lambert1SG\n",
                       .corner = "{}/1/1"})},
      {"zbrush.obj",
       to_obj(ObjStyle{.before = "# File exported by pixologic ZBrush\n#Vertex Count 8\n",
                       .others = "g default\n",
                       .corner = "{}/",
                       .after_face = "\n#MRGB ffcb9773ffcb9773\n"})},
      {"homogeneous.obj", to_obj(ObjStyle{.after = " 1.0\n"})},
      {"relative.obj", to_obj(ObjStyle{.corner = "{}//-1", .is_relative = true})},
      {"vtk.obj",
       to_obj(ObjStyle{.before = "# wavefront obj file written by the visualization toolkit\n"
                                 "mtllib NONE\n\n",
                       .others = "\ng grp1\nusemtl mtlNONE\n"})},
      {"cinema_4d.obj",
       to_obj(ObjStyle{.before = "# WaveFront *.obj file (generated by CINEMA 4D)\n\n"
                                 "g Cube\nusemtl default\n",
                       .number = fixed6})},
      {"wings_3d.obj",
       to_obj(ObjStyle{.before = "# Exported from Wings 3D\nmtllib box.mtl\no cube1\n",
                       .others = normals + "g cube1_default\nusemtl default\n",
                       .corner = "{}//1"})},
      {"materials_within.obj",
       to_obj(ObjStyle{.before = "newmtl red\nKa 1 0 0\nKd 1 0 0\nillum 2\n"})},
      {"backslash_in_a_name.obj", to_obj(ObjStyle{.before = "mtllib C:\\materials\\\ng a\\\n"})},
      {"mac_os_9.obj", replaced(to_obj(ObjStyle{.before = "# old\n"}), "\n", "\r")},
      {"mark.obj", "\xef\xbb\xbf" + to_obj(ObjStyle{.before = "# cube\n"})},
      {"tabs_and_plus.obj",
       to_obj(ObjStyle{.vertex = "v\t", .between = "\t", .number = plus_and_point})},
      {"fortran.obj", to_obj(ObjStyle{.number = of_fortran})},
  };
}

// ---- OFF

struct OffStyle {
  std::string head = "OFF\n8 12 18\n", before_vertex = "", between = " ", after_vertex = "\n";
  std::string after_face = "\n";
  NumberText number = shortest;
};

inline std::string to_off(const OffStyle& style) {
  const Polygons box = variant_box();
  std::string text = style.head;
  for (const Point& p : box.vertices)
    text += style.before_vertex + style.number(p.x) + style.between + style.number(p.y) +
            style.between + style.number(p.z) + style.after_vertex;
  for (const auto& face : box.faces)
    text += fmt::format("3 {}{}", fmt::join(face, " "), style.after_face);
  return text;
}

inline std::vector<SurfaceVariant> off_variants() {
  return {
      {"cgal.off", to_off(OffStyle{.head = "OFF\n8 12 0\n\n", .after_face = " \n"})},
      {"libigl.off", to_off(OffStyle{.number = scientific15})},
      {"geomview.off", to_off(OffStyle{.head = "OFF # a box\n# two\n\n8 12 18\n"})},
      {"counts_on_first_line.off", to_off(OffStyle{.head = "OFF 8 12 0\n"})},
      {"modelnet.off", to_off(OffStyle{.head = "OFF8 12 0\n"})},
      {"two_counts.off", to_off(OffStyle{.head = "OFF\n8 12\n"})},
      {"no_keyword.off", to_off(OffStyle{.head = "8 12 0\n"})},
      {"coff.off", to_off(OffStyle{.head = "COFF\n8 12 0\n", .after_vertex = " 255 0 0 255\n"})},
      {"meshlab.off",
       to_off(OffStyle{.head = "NCOFF\n8 12 0\n", .after_vertex = " 0 0 1 128 128 128 255 \n"})},
      {"stoff.off", to_off(OffStyle{.head = "STOFF\n8 12 0\n", .after_vertex = " 0.5 0.5\n"})},
      {"face_colors.off", to_off(OffStyle{.after_face = "  0.9 0.1 0.1 1.0 # red\n"})},
      {"lower_case.off", to_off(OffStyle{.head = "off\n8 12 0\n"})},
      {"windows.off", replaced(to_off(OffStyle{}), "\n", "\r\n")},
      {"mac_os_9.off", replaced(to_off(OffStyle{}), "\n", "\r")},
      {"mark.off", "\xef\xbb\xbf" + to_off(OffStyle{})},
      {"padded.off", to_off(OffStyle{}) + std::string(30, '\0')},
  };
}

// ---- PLY

enum class PlyFormat { kAscii, kLittleEndian, kBigEndian };

struct PlyStyle {
  PlyFormat format = PlyFormat::kAscii;
  std::string comment = "";  // lines
  std::string coordinate = "float", list = "uchar int vertex_indices", line_end = "\n";
  std::string vertex_more = "", face_more = "";  // properties, in lines
  std::string vertex_text = "", vertex_bytes = "", face_text = "", face_bytes = "";  // their values
  std::string element_before = "", element_after = "";
  std::string text_before = "", text_after = "", bytes_before = "", bytes_after = "";
  bool has_strips = false;
  NumberText number = shortest;
};

inline std::string to_ply(const PlyStyle& style) {
  const Polygons box = variant_box();
  const bool is_big = style.format == PlyFormat::kBigEndian;
  const char* const name = style.format == PlyFormat::kAscii          ? "ascii"
                           : style.format == PlyFormat::kLittleEndian ? "binary_little_endian"
                                                                      : "binary_big_endian";
  std::string text = fmt::format("ply\nformat {} 1.0\n{}{}element vertex 8\n", name, style.comment,
                                 style.element_before);
  for (const char axis : {'x', 'y', 'z'})
    text += fmt::format("property {} {}\n", style.coordinate, axis);
  text += style.vertex_more;
  text += style.has_strips ? "element tristrips 1\n" : "element face 12\n";
  text += fmt::format("property list {}\n{}{}end_header\n", style.list, style.face_more,
                      style.element_after);
  text = replaced(text, "\n", style.line_end);

  std::vector<std::vector<int>> lists;
  for (const auto& face : box.faces) lists.emplace_back(face.begin(), face.end());
  if (style.has_strips) {  // of one triangle each
    std::vector<int> strips;
    for (const auto& face : lists) {
      strips.insert(strips.end(), face.begin(), face.end());
      strips.push_back(-1);
    }
    lists = {strips};
  }
  if (style.format == PlyFormat::kAscii) {
    text += replaced(style.text_before, "\n", style.line_end);
    for (const Point& p : box.vertices)
      text += style.number(p.x) + " " + style.number(p.y) + " " + style.number(p.z) +
              style.vertex_text + style.line_end;
    for (const auto& list : lists)
      text += fmt::format("{} {}{}{}", list.size(), fmt::join(list, " "), style.face_text,
                          style.line_end);
    return text + replaced(style.text_after, "\n", style.line_end);
  }
  const auto bytes_of_type = [](std::string_view type) {
    if (type.starts_with("u")) type.remove_prefix(1);
    if (type == "char" || type == "int8") return 1;
    if (type == "short" || type == "int16") return 2;
    return type == "int64" ? 8 : 4;
  };
  const std::size_t blank = style.list.find(' ');
  const int count_bytes = bytes_of_type(style.list.substr(0, blank));
  const int number_bytes =
      bytes_of_type(style.list.substr(blank + 1, style.list.rfind(' ') - blank - 1));
  text += style.bytes_before;
  for (const Point& p : box.vertices) {
    for (int axis = 0; axis < 3; ++axis) {
      if (style.coordinate == "double" || style.coordinate == "float64")
        append_bytes(text, std::bit_cast<std::uint64_t>(p[axis]), 8, is_big);
      else
        append_float(text, p[axis], is_big);
    }
    text += style.vertex_bytes;
  }
  for (const auto& list : lists) {
    append_bytes(text, list.size(), count_bytes, is_big);
    for (const int v : list)
      append_bytes(text, static_cast<std::uint64_t>(v), number_bytes, is_big);
    text += style.face_bytes;
  }
  return text + style.bytes_after;
}

inline std::vector<SurfaceVariant> ply_variants() {
  constexpr auto kLittle = PlyFormat::kLittleEndian, kBig = PlyFormat::kBigEndian;
  const std::string colors = "property uchar red\nproperty uchar green\nproperty uchar blue\n";
  const std::string normals = "property float nx\nproperty float ny\nproperty float nz\n";
  const std::string nan = std::string("\xff\xff\xff\x7f", 4);
  return {
      {"blender.ply", to_ply(PlyStyle{.comment = "comment Created by Blender 2.93.1\n",
                                      .list = "uchar uint vertex_indices",
                                      .vertex_more = normals,
                                      .vertex_text = " 0.000000 nan 1.000000",
                                      .number = fixed6})},
      {"meshlab.ply",
       to_ply(PlyStyle{.format = kLittle,
                       .comment = "comment VCGLIB generated\n",
                       .vertex_more = colors + "property uchar alpha\n",
                       .face_more = "property list uchar float texcoord\n"
                                    "property int texnumber\n",
                       .vertex_bytes = "\x7f\x7f\x7f\xff",
                       .face_bytes = std::string("\1", 1) + nan + std::string(4, '\0')})},
      {"vtk.ply",
       to_ply(PlyStyle{.format = kBig,
                       .comment = "comment VTK generated PLY File\n"
                                  "obj_info vtkPolyData points and polygons: vtk4.0\n"})},
      {"open3d.ply", to_ply(PlyStyle{.format = kLittle,
                                     .comment = "comment Created by Open3D\n",
                                     .coordinate = "double",
                                     .list = "uchar uint vertex_indices",
                                     .vertex_more = colors,
                                     .vertex_bytes = "\1\2\3"})},
      {"cloudcompare.ply", to_ply(PlyStyle{.format = kLittle,
                                           .comment = "comment Created by CloudCompare v2.12\n"
                                                      "obj_info Generated by CloudCompare!\n",
                                           .vertex_more = "property float scalar_distance\n",
                                           .vertex_bytes = nan})},
      {"trimesh.ply", to_ply(PlyStyle{.format = kLittle,
                                      .comment = "comment https://github.com/mikedh/trimesh\n",
                                      .list = "uchar int vertex_indices"})},
      {"pcl.ply", to_ply(PlyStyle{.comment = "comment PCL generated\n",
                                  .vertex_more = colors,
                                  .vertex_text = " 255 0 0",
                                  .element_after = "element camera 1\nproperty float view_px\n"
                                                   "property float view_py\n",
                                  .text_after = "0 0\n"})},
      {"stanford.ply", to_ply(PlyStyle{.comment = "obj_info num_cols 512\nobj_info num_rows 400\n"
                                                  "comment zipper output\n",
                                       .vertex_more = "property float confidence\n"
                                                      "property float intensity\n",
                                       .vertex_text = " 0.5 0.25 "})},
      {"stanford_strips.ply",
       to_ply(PlyStyle{.format = kBig, .list = "int int vertex_indices", .has_strips = true})},
      {"strips.ply", to_ply(PlyStyle{.list = "int int vertex_indices", .has_strips = true})},
      {"cyberware.ply", to_ply(PlyStyle{.format = kBig, .list = "uchar int vertex_index"})},
      {"new_names.ply",
       to_ply(PlyStyle{
           .format = kLittle, .coordinate = "float64", .list = "uint8 int32 vertex_indices"})},
      {"short_numbers.ply",
       to_ply(PlyStyle{
           .format = kLittle, .coordinate = "float32", .list = "uint16 int16 vertex_index"})},
      {"int64.ply", to_ply(PlyStyle{.format = kBig, .list = "uint32 int64 vertex_indices"})},
      {"uint64.ply", to_ply(PlyStyle{.format = kLittle, .list = "int8 uint64 vertex_indices"})},
      {"element_first.ply",
       to_ply(PlyStyle{.element_before = "element material 2\nproperty list uchar uchar name\n",
                       .text_before = "2 65 66\n0\n"})},
      {"material_and_edges.ply",
       to_ply(PlyStyle{.format = kLittle,
                       .element_before = "element material 1\nproperty uchar diffuse\n",
                       .element_after = "element edge 2\nproperty int vertex1\n"
                                        "property int vertex2\n",
                       .bytes_before = "\x40",
                       .bytes_after = std::string(16, '\0')})},
      {"windows.ply", to_ply(PlyStyle{.comment = "comment x\n", .line_end = "\r\n"})},
      {"windows_binary.ply", to_ply(PlyStyle{.format = kLittle, .line_end = "\r\n"})},
      {"mac_os_9.ply", to_ply(PlyStyle{.comment = "comment x\n", .line_end = "\r"})},
      {"mac_os_9_binary.ply",  // the first byte of which is that of a line feed
       to_ply(PlyStyle{.format = kBig,
                       .line_end = "\r",
                       .element_before = "element tag 1\nproperty uchar value\n",
                       .bytes_before = "\n"})},
      {"mark.ply", "\xef\xbb\xbf" + to_ply(PlyStyle{})},
      {"face_flags.ply",
       to_ply(PlyStyle{.face_more = "property uchar flags\n", .face_text = " 7 "})},
      {"scientific.ply", to_ply(PlyStyle{.number = three_digit_exponent})},
  };
}

inline std::vector<SurfaceVariant> surface_variants() {
  std::vector<SurfaceVariant> all;
  for (auto&& some : {ascii_stl_variants(), binary_stl_variants(), obj_variants(), off_variants(),
                      ply_variants()})
    all.insert(all.end(), some.begin(), some.end());
  return all;
}

}  // namespace locvol
