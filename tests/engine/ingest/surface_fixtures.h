// Small surfaces, and files of them in every format, for the tests of the surface reader.
#pragma once

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <optional>
#include <random>
#include <string>
#include <string_view>
#include <vector>

#include "engine/ingest/surface_input.h"
#include "engine/ingest/triangle_soup.h"
#include "octree/geometry.h"

namespace locvol {

// A checked surface, in memory.
struct InputSurface {
  SurfaceFacts facts;
  std::string digest;
  std::vector<Triangle> pieces;  // in order of id
  std::vector<Point> vertices;
  std::vector<TriangleCorners> triangles;

  std::vector<std::array<Point, 3>> corners() const {
    std::vector<std::array<Point, 3>> corners;
    for (const Triangle& t : pieces) corners.push_back(t.corners);
    return corners;
  }
};

inline InputSurface read_whole_surface(const std::filesystem::path& file,
                                       std::uint64_t bucket_capacity = kBucketCapacity,
                                       const std::optional<double>& weld = std::nullopt) {
  IngestWatch watch;
  Workers workers(3);
  InputSurface surface;
  RawSurface raw = read_surface(file, std::filesystem::temp_directory_path(), watch);
  surface.digest = raw.digest;
  const Frame frame = frame_of(raw.box);
  const CheckedSurface checked =
      check_surface(std::move(raw), frame, watch, workers, bucket_capacity, IngestShare(), weld);
  surface.facts = checked.facts;
  for (const TriangleBucket& bucket : checked.buckets.all())
    for (const Triangle& t : checked.load(bucket)) surface.pieces.push_back(t);
  std::ranges::sort(surface.pieces, {}, &Triangle::id);
  const auto again = std::ranges::unique(surface.pieces, {}, &Triangle::id);
  surface.pieces.erase(again.begin(), again.end());
  TriangleSoup soup = soup_of(surface.pieces);
  surface.vertices = std::move(soup.vertices);
  surface.triangles = std::move(soup.triangles);
  return surface;
}

// A directory of its own for each test, gone with it.
class SurfaceFiles {
 public:
  SurfaceFiles() {
    const auto* test = testing::UnitTest::GetInstance()->current_test_info();
    std::string name = fmt::format("locvol_{}_{}_{}", test->test_suite_name(), test->name(),
                                   std::random_device()());
    std::replace(name.begin(), name.end(), '/', '_');
    directory_ = std::filesystem::temp_directory_path() / name;
    std::filesystem::create_directories(directory_);
  }
  SurfaceFiles(const SurfaceFiles&) = delete;
  SurfaceFiles& operator=(const SurfaceFiles&) = delete;
  ~SurfaceFiles() { std::filesystem::remove_all(directory_); }

  const std::filesystem::path& directory() const { return directory_; }
  std::filesystem::path write(const std::string& name, std::string_view content) const {
    const auto path = directory_ / name;
    std::ofstream(path, std::ios::binary) << content;
    return path;
  }
  InputSurface read(const std::string& name, std::string_view content) const {
    return read_whole_surface(write(name, content));
  }

 private:
  std::filesystem::path directory_;
};

// The message with which `content` is refused; empty if it is accepted.
inline std::string refusal(const SurfaceFiles& files, const std::string& name,
                           std::string_view content) {
  try {
    files.read(name, content);
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find(name), std::string::npos) << error.what();
    return error.what();
  }
  return {};
}

struct Polygons {
  std::vector<Point> vertices;
  std::vector<std::vector<std::uint32_t>> faces;

  void append(Polygons other) {  // by value: it may be this one
    const auto offset = static_cast<std::uint32_t>(vertices.size());
    vertices.insert(vertices.end(), other.vertices.begin(), other.vertices.end());
    for (auto face : other.faces) {
      for (auto& v : face) v += offset;
      faces.push_back(face);
    }
  }
};

// Facing outward; vertex i at the upper end of x, y, z where bits 0, 1, 2 of i are set.
inline Polygons box_of_quads(const Point& min, const Point& max) {
  Polygons box;
  for (int i = 0; i < 8; ++i)
    box.vertices.push_back({i & 1 ? max.x : min.x, i & 2 ? max.y : min.y, i & 4 ? max.z : min.z});
  box.faces = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
  return box;
}

inline Polygons box_of_triangles(const Point& min, const Point& max) {
  const Polygons quads = box_of_quads(min, max);
  Polygons box{quads.vertices, {}};
  for (const auto& q : quads.faces) {
    box.faces.push_back({q[0], q[1], q[2]});
    box.faces.push_back({q[0], q[2], q[3]});
  }
  return box;
}

// Of radius 1 and n sides, from z = 0 upwards.
inline Polygons cylinder(std::uint32_t n, double height = 1) {
  Polygons shape;
  for (std::uint32_t i = 0; i < n; ++i)
    for (const double z : {0.0, height})
      shape.vertices.push_back(
          {std::cos(2 * std::numbers::pi * i / n), std::sin(2 * std::numbers::pi * i / n), z});
  shape.vertices.push_back({0, 0, 0});
  shape.vertices.push_back({0, 0, height});
  for (std::uint32_t i = 0; i < n; ++i) {
    const std::uint32_t a = 2 * i, b = 2 * ((i + 1) % n);
    shape.faces.push_back({a, b, b + 1});
    shape.faces.push_back({a, b + 1, a + 1});
    shape.faces.push_back({b, a, 2 * n});
    shape.faces.push_back({a + 1, b + 1, 2 * n + 1});
  }
  return shape;
}

inline Polygons cube() { return box_of_triangles({0, 0, 0}, {1, 1, 1}); }

inline std::string to_off(const Polygons& s, std::string_view line_end = "\n") {
  std::string text =
      fmt::format("OFF{}{} {} 0{}", line_end, s.vertices.size(), s.faces.size(), line_end);
  for (const Point& p : s.vertices) text += fmt::format("{} {} {}{}", p.x, p.y, p.z, line_end);
  for (const auto& f : s.faces)
    text += fmt::format("{} {}{}", f.size(), fmt::join(f, " "), line_end);
  return text;
}

inline std::string to_obj(const Polygons& s) {
  std::string text = "# cube\no cube\n";
  for (const Point& p : s.vertices) text += fmt::format("v {} {} {}\n", p.x, p.y, p.z);
  for (const auto& f : s.faces) {
    text += "f";
    for (const auto v : f) text += fmt::format(" {}", v + 1);
    text += "\n";
  }
  return text;
}

// Without a name, or with one for each face.
inline std::string to_grouped_obj(const Polygons& s, const std::vector<std::string>& groups = {}) {
  std::string text;
  for (const Point& p : s.vertices) text += fmt::format("v {} {} {}\n", p.x, p.y, p.z);
  for (std::size_t f = 0; f < s.faces.size(); ++f) {
    if (!groups.empty()) text += fmt::format("g {}\n", groups[f]);
    text += "f";
    for (const std::uint32_t v : s.faces[f]) text += fmt::format(" {}", v + 1);
    text += "\n";
  }
  return text;
}

inline std::string to_ascii_stl(const Polygons& s) {
  std::string text = "solid a cube\n";
  for (const auto& f : s.faces) {
    text += " facet normal 0 0 0\n  outer loop\n";
    for (const auto v : f)
      text +=
          fmt::format("   vertex {} {} {}\n", s.vertices[v].x, s.vertices[v].y, s.vertices[v].z);
    text += "  endloop\n endfacet\n";
  }
  return text + "endsolid a cube\n";
}

// Appends the low `bytes` bytes of `bits`.
inline void append_bytes(std::string& out, std::uint64_t bits, int bytes,
                         bool is_big_endian = false) {
  for (int i = 0; i < bytes; ++i) {
    const int shift = 8 * (is_big_endian ? bytes - 1 - i : i);
    out.push_back(shift < 64 ? static_cast<char>(bits >> shift & 0xff) : '\0');
  }
}

inline void append_float(std::string& out, double value, bool is_big_endian = false) {
  append_bytes(out, std::bit_cast<std::uint32_t>(static_cast<float>(value)), 4, is_big_endian);
}

inline std::string to_binary_stl(const Polygons& s, std::string_view header = "binary") {
  std::string data(header);
  data.resize(80, ' ');
  append_bytes(data, s.faces.size(), 4);
  for (const auto& f : s.faces) {
    data.append(12, '\0');
    for (const auto v : f)
      for (int axis = 0; axis < 3; ++axis) append_float(data, s.vertices[v][axis]);
    data.append(2, '\0');
  }
  return data;
}

enum class PlyEncoding { kAscii, kLittleEndian, kBigEndian };

inline std::string to_ply(const Polygons& s, PlyEncoding encoding) {
  const std::string name = encoding == PlyEncoding::kAscii          ? "ascii"
                           : encoding == PlyEncoding::kLittleEndian ? "binary_little_endian"
                                                                    : "binary_big_endian";
  std::string data = fmt::format(
      "ply\nformat {} 1.0\ncomment cube\nelement vertex {}\nproperty float x\nproperty float y\n"
      "property float z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
      name, s.vertices.size(), s.faces.size());
  if (encoding == PlyEncoding::kAscii) {
    for (const Point& p : s.vertices) data += fmt::format("{} {} {}\n", p.x, p.y, p.z);
    for (const auto& f : s.faces) data += fmt::format("{} {}\n", f.size(), fmt::join(f, " "));
    return data;
  }
  const bool is_big = encoding == PlyEncoding::kBigEndian;
  for (const Point& p : s.vertices)
    for (int axis = 0; axis < 3; ++axis) append_float(data, p[axis], is_big);
  for (const auto& f : s.faces) {
    append_bytes(data, f.size(), 1, is_big);
    for (const auto v : f) append_bytes(data, v, 4, is_big);
  }
  return data;
}

struct NamedFile {
  std::string name, content;
};

// What every surface that is accepted must be: closed, each edge in two triangles.
inline void expect_closed(const InputSurface& s) {
  std::vector<std::array<std::uint32_t, 2>> edges;
  for (const auto& t : s.triangles)
    for (std::size_t k = 0; k < 3; ++k)
      edges.push_back({std::min(t[k], t[(k + 1) % 3]), std::max(t[k], t[(k + 1) % 3])});
  std::sort(edges.begin(), edges.end());
  for (std::size_t i = 0; i < edges.size(); ++i) {
    const auto uses = std::ranges::equal_range(edges, edges[i]);
    ASSERT_EQ(uses.size(), 2u);
  }
}

}  // namespace locvol
