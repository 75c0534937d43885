// Parses surface files. Whatever a file holds goes to a SurfaceSink in file order, unchanged:
// merging points, cutting polygons into triangles and judging the surface is the business of
// others.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>

#include "octree/geometry.h"
#include "octree/stop.h"

namespace locvol {

// Where in the file something stands, for messages.
struct FilePlace {
  enum class Unit { kLine, kFace } unit = Unit::kLine;
  std::uint64_t number = 0;  // from 1
};
std::string to_string(const FilePlace& place);

class SurfaceSink {
 public:
  virtual ~SurfaceSink() = default;
  // So many polygons or facets are to come, for all that the file says: called before any of them,
  // if at all.
  virtual void announce(std::uint64_t /*num_faces*/) {}
  // Vertices are numbered 0, 1, 2, … in the order of the calls. Their coordinates are finite.
  virtual void vertex(const Point& position) = 0;
  // Any number of corners, with any numbers: they may name a vertex that comes later, or never.
  virtual void polygon(std::span<const std::uint64_t> corners, const FilePlace& place) = 0;
  // A triangle with corners of its own, which are no numbered vertices. They are finite.
  virtual void facet(const std::array<Point, 3>& corners) = 0;
};

// Reads the whole file. Its content decides what format it has, and only if that says nothing, its
// extension. Returns the SHA-256 of the file's bytes. Needs memory for one buffer, whatever the
// size of the file. Throws InputError: missing, unreadable, of no known format, damaged, cut off,
// with a header that promises more than the file holds, with a coordinate that is not finite, or
// named as another format than it is. Throws Stopped.
std::string parse_surface(const std::filesystem::path& file, SurfaceSink& sink,
                          const StopToken* stop = nullptr);

}  // namespace locvol
