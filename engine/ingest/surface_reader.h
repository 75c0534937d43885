// Parses surface files. Whatever a file holds goes to a SurfaceSink in file order, unchanged:
// merging points, cutting polygons into triangles and judging the surface is the business of
// others.
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "engine/ingest/input_bytes.h"
#include "engine/ingest/surface_ranges.h"
#include "engine/ingest/surface_sink.h"
#include "octree/stop.h"

namespace locvol {

// Reads the whole file. Its content decides what format it has, and only if that says nothing, its
// extension: that of "part.stl.gz" is .stl, and whether it is packed decides its content, too.
// Returns the SHA-256 of its bytes, or of what they are when they are unpacked. Needs memory for
// one buffer, whatever the size of the file. Throws InputError: missing, unreadable, of no known
// format, damaged, cut off, with a header that promises more than the file holds, with a coordinate
// that is not finite, or named as another format than it is. Throws Stopped.
std::string parse_surface(std::shared_ptr<const InputBytes> bytes, SurfaceSink& sink,
                          const StopToken* stop = nullptr);
// Parses a regular file.
std::string parse_surface(const std::filesystem::path& file, SurfaceSink& sink,
                          const StopToken* stop = nullptr);

// Null: the file is to be read from front to back, and so is what is no regular file, or packed.
// Throws as parse_surface(), of what can be known before faces are read.
std::unique_ptr<SurfaceRanges> ranges_of_surface(const std::filesystem::path& file,
                                                 const StopToken* stop = nullptr);

}  // namespace locvol
