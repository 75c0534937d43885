// One parser for each surface format; parse_surface() chooses. All throw InputError.
#pragma once

#include <array>
#include <memory>
#include <string_view>

#include "engine/ingest/input_file.h"
#include "engine/ingest/surface_ranges.h"
#include "engine/ingest/surface_sink.h"

namespace locvol {

void parse_binary_stl(InputFile& file, SurfaceSink& sink);
void parse_ascii_stl(InputFile& file, SurfaceSink& sink);
void parse_obj(InputFile& file, SurfaceSink& sink);
void parse_off(InputFile& file, SurfaceSink& sink);
void parse_ply(InputFile& file, SurfaceSink& sink);
void parse_gmsh(InputFile& file, SurfaceSink& sink);
// These go through the file as often as they need, and take nothing of what is given.
void parse_vtk(const InputFile& file, SurfaceSink& sink);  // legacy
void parse_vtp(const InputFile& file, SurfaceSink& sink);
void parse_3mf(const InputFile& file, SurfaceSink& sink);
void parse_gltf(const InputFile& file, SurfaceSink& sink);  // as JSON or binary

// The ranges of a binary file; null: not all of the file's faces are known to take as many bytes.
std::unique_ptr<SurfaceRanges> ranges_of_binary_stl(InputFile file);
std::unique_ptr<SurfaceRanges> ranges_of_ply(InputFile file);

// The integers of a face that tell groups apart, of which the first has them: a group is called
// after that and its value, "region 3".
constexpr std::array<std::string_view, 7> kGroupProperties = {
    "sheet", "group", "region", "patch", "label", "segment", "material_index"};

// Do the file's size and its count of triangles agree, as they ought to in a binary STL file?
bool is_binary_stl(InputFile& file);
// Tells whether this is text, with a line that begins as those of an ASCII STL file do.
bool has_stl_line(std::string_view text);
// Tells whether this is the first word of an OFF file (OFF, COFF, NOFF, …, also those of other
// dimensions), in any case.
bool is_off_keyword(std::string_view word);
// Tells whether this is a zip archive with a 3D model in it. Throws InputError: it is a damaged
// one.
bool is_3mf(const InputFile& file);
// Tells whether this is a word that may begin a line of an OBJ file.
bool is_obj_keyword(std::string_view word);

}  // namespace locvol
