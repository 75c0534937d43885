// TriangleSoup is a surface as read, with equal points merged; SurfaceBuilder makes it while a file
// is parsed.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

#include "engine/surface_reader.h"
#include "octree/geometry.h"

namespace locvol {

using TriangleCorners = std::array<std::uint32_t, 3>;  // numbers of vertices

struct TriangleSoup {
  std::vector<Point> vertices;  // all different, in the order of their first appearance; no -0.0
  std::vector<TriangleCorners> triangles;
  std::uint64_t num_merged_points = 0;
  std::uint64_t num_cut_polygons = 0;  // with more than three corners
};

class SurfaceBuilder : public SurfaceSink {
 public:
  static constexpr std::uint64_t kMaxTriangles = 0xffffffff / 3;  // half-edges have 32 bits

  explicit SurfaceBuilder(std::filesystem::path file) : file_(std::move(file)) {}

  void expect(std::uint64_t num_vertices, std::uint64_t num_polygons) override;
  // Throws InputError for more than 2^32 - 2 vertices.
  void vertex(const Point& position) override;
  // Throws InputError: fewer than 3 corners, more than kMaxPolygonCorners, a polygon that crosses
  // itself, too many triangles.
  void polygon(std::span<const std::uint64_t> corners, const FilePlace& place) override;
  // Throws InputError if a polygon names a vertex that is not there.
  TriangleSoup finish();

 private:
  struct Deferred {
    FilePlace place;
    std::size_t end = 0;  // in deferred_corners_
  };

  void add(std::span<const std::uint64_t> corners, const FilePlace& place);
  void add_triangle(std::uint32_t a, std::uint32_t b, std::uint32_t c);
  std::uint32_t merged(const Point& position);  // the number of the vertex there
  void grow_slots();
  std::size_t slot_of(const Point& position) const;  // where it is, or belongs
  [[noreturn]] void refuse(const FilePlace& place, const std::string& what) const;

  std::filesystem::path file_;
  TriangleSoup soup_;
  std::vector<std::uint32_t> numbers_;  // by number in the file
  std::vector<std::uint32_t> slots_;    // hash table, open addressing; number + 1, or 0: free
  // Polygons that name vertices which had not come yet.
  std::vector<Deferred> deferred_;
  std::vector<std::uint64_t> deferred_corners_;
  // Scratch of add().
  std::vector<std::uint32_t> ring_;
  std::vector<Point> ring_points_;
  std::vector<TriangleCorners> ring_triangles_;
};

}  // namespace locvol
