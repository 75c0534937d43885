// What a run meshes: a file, or triangles that a program gives. Both go the same way, see
// surface_input.h.
#pragma once

#include <array>
#include <filesystem>
#include <functional>
#include <string>

#include "engine/ingest/surface_reader.h"
#include "octree/geometry.h"

namespace locvol {

struct SurfaceSource {
  std::string name;  // for messages
  // Gives all to the sink. Returns the digest. Throws Stopped, as does the next; `stop` may be
  // null.
  std::function<std::string(SurfaceSink&, const StopToken* stop)> parse;
  // The name by which a store knows its input: SHA-256, hexadecimal.
  std::function<std::string(const StopToken* stop)> digest;
};

// See parse_surface(). The digest is of the file's bytes.
SurfaceSource surface_in_file(const std::filesystem::path& file);

// Calls the visitor for each triangle: the same ones in the same order whenever it is called.
using TriangleVisitor = std::function<void(const std::array<Point, 3>& corners)>;
using TriangleSource = std::function<void(const TriangleVisitor& visit)>;

// The digest is of the coordinates as they are given. Both functions call `triangles` once, and
// parse() throws InputError for coordinates that are not finite.
SurfaceSource surface_in_memory(TriangleSource triangles);

}  // namespace locvol
