// Arbitrary bytes as a surface file. parse_surface() hands what its sink may rely on,
// read_surface() makes sound triangles of it, check_surface() finds the same whatever is cut into
// how large buckets; or they throw InputError.
//
//   | format u8 | the file ... |
//
// The first byte is the letter of an extension, or kWholeBinaryStl: a .stl file whose size and
// count of triangles are made to agree, as chance never would.

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "engine/ingest/polygon_triangulation.h"
#include "engine/ingest/surface_input.h"
#include "engine/ingest/surface_reader.h"
#include "tests/fuzz/expect.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

namespace fs = std::filesystem;

constexpr char kWholeBinaryStl = 'b';

const char* extension(char format) {
  switch (format) {
    case kWholeBinaryStl:
    case 's':
      return ".stl";
    case 'o':
      return ".obj";
    case 'f':
      return ".off";
    case 'p':
      return ".ply";
    case 'k':
      return ".vtk";
    case 'v':
      return ".vtp";
    case 'm':
      return ".msh";
    case '3':
      return ".3mf";
    case 'g':
      return ".glb";
    case 'j':
      return ".gltf";
    default:
      return "";
  }
}

bool is_finite(const Point& p) {
  return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z);
}

// The n - 2 triangles cover the polygon's edges once, and meet each other along all of their other
// edges, in opposite directions.
void expect_is_cut(const std::vector<Point>& corners,
                   const std::vector<std::array<std::uint32_t, 3>>& triangles) {
  const auto n = static_cast<std::uint32_t>(corners.size());
  expect(triangles.size() == n - 2, "a polygon of n corners is cut into n - 2 triangles");
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> uses;
  for (std::uint32_t i = 0; i < n; ++i) --uses[{i, (i + 1) % n}];
  for (const auto& t : triangles) {
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t from = t[i], to = t[(i + 1) % 3];
      expect(from < n && to < n, "the triangles of a polygon have its corners");
      ++uses[{from, to}];
    }
  }
  for (const auto& [edge, count] : uses) {
    const auto opposite = uses.find({edge.second, edge.first});
    expect(count == (opposite == uses.end() ? 0 : opposite->second),
           "the triangles of a polygon meet along its diagonals");
  }
}

// How many bytes a file may hold: what zlib has packed stands for at most 1032 times as many, and
// objects and nodes may be placed often.
std::uint64_t most_bytes(char format, std::string_view content) {
  constexpr std::uint64_t kPlaced = 1'000'000;
  if (format == '3' || format == 'g' || format == 'j' || content.starts_with("PK") ||
      content.starts_with("glTF") || content.find("\"asset\"") != content.npos)
    return content.size() * 1032 * kPlaced;
  const bool is_packed = content.starts_with("\x1f\x8b") || content.find("VTKFile") != content.npos;
  return content.size() * (is_packed ? 1032 : 1);
}

// Checks the promises of surface_reader.h, and cuts polygons.
class CheckingSink : public SurfaceSink {
 public:
  explicit CheckingSink(std::uint64_t most_bytes) : bytes_(most_bytes) {}

  void vertex(const Point& position) override {
    expect(is_finite(position), "coordinates are finite");
    points_.push_back(position);
    expect(points_.size() <= bytes_, "a vertex takes a byte of the file at least");
  }

  void polygon(std::span<const std::uint64_t> corners, const FilePlace& place) override {
    num_corners_ += corners.size();
    expect(num_corners_ <= 3 * bytes_, "a corner takes a byte of the file, or a strip's, a third");
    expect(1 <= place.number && place.number <= bytes_, "a place is in the file");
    cut(corners);
  }

  void facet(const std::array<Point, 3>& corners) override {
    num_corners_ += corners.size();
    expect(num_corners_ <= bytes_, "a corner takes a byte of the file at least");
    for (const Point& p : corners) expect(is_finite(p), "coordinates are finite");
  }

 private:
  void cut(std::span<const std::uint64_t> corners) {
    constexpr std::size_t kMaxCorners = 64;  // for speed
    if (corners.size() < 4 || corners.size() > kMaxCorners) return;
    ring_.clear();
    for (const std::uint64_t c : corners) {
      if (c >= points_.size()) return;
      if (ring_.empty() || ring_.back() != points_[c]) ring_.push_back(points_[c]);
    }
    while (!ring_.empty() && ring_.front() == ring_.back()) ring_.pop_back();
    if (ring_.size() >= 3 && triangulate_polygon(ring_, triangles_))
      expect_is_cut(ring_, triangles_);
  }

  std::uint64_t bytes_;
  std::uint64_t num_corners_ = 0;
  std::vector<Point> points_;
  std::vector<Point> ring_;
  std::vector<std::array<std::uint32_t, 3>> triangles_;
};

void expect_sound(const RawSurface& surface) {
  std::uint64_t num_triangles = 0;
  surface.spill.for_each(surface.triangles.front(), [&](const Triangle& triangle) {
    expect(triangle.id == num_triangles++, "triangles are counted in the order of the file");
    for (std::size_t i = 0; i < 3; ++i) {
      const Point& p = triangle.corners[i];
      expect(is_finite(p) && surface.box.contains(p), "triangles lie in the box");
      expect(p != triangle.corners[(i + 1) % 3], "triangles have three corners");
      for (int axis = 0; axis < 3; ++axis)
        expect(p[axis] != 0 || !std::signbit(p[axis]), "there is one zero");
    }
  });
  expect(num_triangles == surface.num_triangles() && num_triangles > 0, "no triangle is lost");
}

void expect_sound(const SurfaceFacts& facts) {
  expect(facts.num_triangles >= 4 && facts.num_vertices >= 4, "it is a closed surface");
  const auto num_edges = static_cast<std::int64_t>(3 * facts.num_triangles / 2);
  expect(facts.num_triangles % 2 == 0, "each edge has two triangles");
  expect(static_cast<std::int64_t>(facts.num_vertices) - num_edges +
                 static_cast<std::int64_t>(facts.num_triangles) ==
             facts.euler_characteristic,
         "the Euler characteristic is that of the counts");
  expect(1 <= facts.num_components && facts.num_components <= facts.num_triangles / 4,
         "components are counted");
  expect(std::isfinite(facts.area) && facts.area > 0, "it has an area");
  expect(std::isfinite(facts.volume), "it has a volume");
}

void expect_names(const InputError& error, const fs::path& path) {
  expect(std::string_view(error.what()).starts_with(path.native() + ": "),
         "an error names the file");
}

// A file of each extension, written anew for every input.
class InputFiles {
 public:
  fs::path write(char format, std::string_view content) {
    const fs::path path = directory_ / (std::string("surface") + extension(format));
    const int file = open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    expect(file >= 0, "the directory for temporary files takes a file");
    expect(write_all(file, content), "the directory for temporary files has room");
    close(file);
    return path;
  }
  const fs::path& directory() const { return directory_.path(); }

 private:
  static bool write_all(int file, std::string_view content) {
    while (!content.empty()) {
      const ssize_t n = ::write(file, content.data(), content.size());
      if (n <= 0) return false;
      content.remove_prefix(static_cast<std::size_t>(n));
    }
    return true;
  }

  TempDir directory_;
};

std::string file_content(char format, std::string_view bytes) {
  std::string content(bytes);
  constexpr std::size_t kHeader = 84, kTriangle = 50;
  if (format != kWholeBinaryStl || content.size() < kHeader) return content;
  const std::size_t count = (content.size() - kHeader) / kTriangle;
  content.resize(kHeader + kTriangle * count);
  for (std::size_t i = 0; i < 4; ++i)
    content[kHeader - 4 + i] = static_cast<char>(count >> (8 * i));
  return content;
}

std::optional<RawSurface> read(const fs::path& path, const fs::path& directory) {
  IngestWatch watch;
  try {
    std::optional<RawSurface> surface = read_surface(path, directory, watch);
    expect_sound(*surface);
    return surface;
  } catch (const InputError& error) {
    expect_names(error, path);
    return std::nullopt;
  }
}

// The facts, if it bounds a volume.
std::optional<SurfaceFacts> check(const fs::path& path, const fs::path& directory,
                                  std::uint64_t bucket_capacity) {
  std::optional<RawSurface> surface = read(path, directory);
  if (!surface) return std::nullopt;
  const Frame frame = frame_of(surface->box);
  IngestWatch watch;
  Workers workers(1);
  try {
    const SurfaceFacts facts =
        check_surface(std::move(*surface), frame, watch, workers, bucket_capacity).facts;
    expect_sound(facts);
    return facts;
  } catch (const InputError& error) {
    expect_names(error, path);
    return std::nullopt;
  }
}

void read_as_surface(char format, std::string_view bytes) {
  static InputFiles files;
  constexpr std::uint64_t kFewTriangles = 8;
  const std::string content = file_content(format, bytes);
  const fs::path path = files.write(format, content);
  CheckingSink sink(most_bytes(format, content));
  try {
    parse_surface(path, sink);
  } catch (const InputError& error) {
    expect_names(error, path);
    return;
  }
  const auto facts = check(path, files.directory(), kBucketCapacity);
  expect(facts == check(path, files.directory(), kFewTriangles),
         "how the work is cut does not decide its result");
}

}  // namespace
}  // namespace locvol

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  locvol::read_as_surface(bytes[0], bytes.substr(1));
  return 0;
}
