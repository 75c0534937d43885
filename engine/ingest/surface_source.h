// What a run meshes: a file, or triangles that a program gives. Both go the same way, see
// surface_input.h.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "engine/ingest/cad_file.h"
#include "engine/ingest/surface_reader.h"
#include "octree/geometry.h"

namespace locvol {

// What is known of curved faces before they are cut into triangles.
struct CurvedFaces {
  Box box;
  std::uint64_t num_bodies = 0;
};

struct SurfaceSource {
  std::string name;            // for messages
  std::filesystem::path file;  // of which others may read parts, too; empty: there is none
  // Gives all to the sink. Returns the digest. Throws Stopped, as does the next; `stop` may be
  // null.
  std::function<std::string(SurfaceSink&, const StopToken* stop)> parse;
  // The name by which a store knows its input: SHA-256, hexadecimal.
  std::function<std::string(const StopToken* stop)> digest;
  // Nobody is going to call them again: a copy of what came through a pipe can go.
  std::function<void()> release = [] {};
  // Nothing: it has triangles. Else bodies with curved faces are in memory from now on; of several
  // files, the box is that of all. `cap`: on the memory of the process; 0: any. Throws InputError,
  // OverBudget, Stopped.
  std::function<std::optional<CurvedFaces>(std::uint64_t cap, const StopToken* stop)> curved =
      [](std::uint64_t, const StopToken*) { return std::optional<CurvedFaces>(); };
  // How parse() is to cut them; nothing of triangles. See settle_faces().
  std::function<void(const CadCut&)> cut_faces = [](const CadCut&) {};
};

// See parse_surface() and InputBytes. The digest is that of parse_surface(). What is read through a
// pipe is copied once, when it is first asked for, into `directory`, or into one above it that
// exists.
SurfaceSource surface_in_file(const std::filesystem::path& file,
                              const std::filesystem::path& directory);
SurfaceSource surface_in_standard_input(const std::filesystem::path& directory);
// The surface that MeshOptions::input means: a file, or the standard input.
SurfaceSource surface_at(const std::filesystem::path& input,
                         const std::filesystem::path& directory);
// With any `others`, each file is a body of the file's name without its extension. Throws
// InputError where a file is there twice, or the standard input is one.
SurfaceSource surface_at(const std::filesystem::path& input,
                         const std::vector<std::filesystem::path>& others,
                         const std::filesystem::path& directory);

// Calls the visitor for each triangle: the same ones in the same order whenever it is called.
// `group`: what the triangle's group is called; empty: it has no name.
using TriangleVisitor =
    std::function<void(const std::array<Point, 3>& corners, std::string_view group)>;
using TriangleSource = std::function<void(const TriangleVisitor& visit)>;

// The digest is of the coordinates and groups as they are given. Both functions call `triangles`
// once, and parse() throws InputError for coordinates that are not finite.
SurfaceSource surface_in_memory(TriangleSource triangles);

}  // namespace locvol
