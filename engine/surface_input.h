// Reads a surface from a file, repairs what is unambiguous, and refuses what bounds no volume.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "octree/geometry.h"
#include "storage/records.h"

namespace locvol {

// The input is at fault. The message names the file, the place (line, triangle, coordinates) and
// the cure.
class InputError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// A closed 2-manifold without self-intersections, each edge in exactly two triangles. Orientation
// is made consistent where possible, but nothing relies on it: sides are found by parity.
struct InputSurface {
  std::vector<Point> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  SurfaceFacts facts;
  std::string digest;  // SHA-256 of the triangles' coordinates, hexadecimal

  Triangle triangle(std::uint64_t i) const {
    const auto& t = triangles[i];
    return {i, {vertices[t[0]], vertices[t[1]], vertices[t[2]]}};
  }
};

// STL (binary, ASCII), OBJ, OFF, PLY (ASCII, both byte orders), told apart by content first, then
// by extension. Throws InputError.
InputSurface read_surface(const std::filesystem::path& file);

}  // namespace locvol
