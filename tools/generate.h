// Closed surfaces by formula, with as many triangles as asked for, to try the mesher on: streamed
// to a file, so the surface may be far larger than memory.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string_view>

namespace locvol {

struct ShapeInfo {
  std::string_view name;
  std::string_view description;
  int genus = 0;
  std::uint64_t min_triangles = 0;  // with fewer it would lose its form
};

std::span<const ShapeInfo> shapes();

struct GeneratedSurface {
  std::uint64_t num_vertices = 0, num_triangles = 0, bytes = 0;
};

// Writes `shape` with about `num_triangles` triangles (within a few percent; small numbers, 10%) as
// binary STL or binary PLY with coordinates in double precision, by the extension of `out`. One
// component, a closed 2-manifold oriented outwards, about 2 units across, without
// self-intersections or degenerate triangles. Equal arguments give equal bytes.
//
// The file appears under its name only when it is whole; until then it is `out`.partial (and, for
// PLY, `out`.partial.faces beside it).
// Memory: what a plane through the surface meets, about the square root of the surface.
// Throws std::invalid_argument: no such shape, extension, or number of triangles;
// std::runtime_error with the file's name when it cannot be written.
GeneratedSurface generate(std::string_view shape, std::uint64_t num_triangles,
                          const std::filesystem::path& out);

// What is called so is of many bodies, and has as many triangles as it needs.
inline constexpr std::string_view kPolycrystal = "polycrystal";

// Writes the Voronoi cells of random points in a cube 2 units wide, from 1 to kMaxBodies of them,
// as binary PLY. Each grain is a group ("region 1", "region 2", ...) that is closed by itself, and
// turned outwards. A face between two grains is given twice, once with each, in the same triangles.
// What else is said of generate() holds here, too, but for memory: 8 kB a grain.
GeneratedSurface generate_polycrystal(std::uint64_t num_grains, std::uint64_t seed,
                                      const std::filesystem::path& out);

}  // namespace locvol
