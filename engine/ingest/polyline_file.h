// Reads polylines, as CGAL writes them (.polylines.txt): each line of the file is a polyline, how
// many points it has and their coordinates. A closed one ends where it begins.
//
//   5  0 0 0  1 0 0  1 1 0  0 1 0  0 0 0      # a square
//
// A polyline of more than 16 MiB of text comes in several.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

#include "octree/geometry.h"
#include "octree/stop.h"

namespace locvol {

struct PolylinePoint {
  Point position;          // no coordinate is -0.0
  bool is_first = false;   // of its polyline
  std::uint64_t line = 0;  // of the file, from 1 on
};

// Gives the points of all polylines to take(), in the order of the file; what gzip has packed is
// unpacked. Returns a digest of the polylines: a number in hexadecimal, whatever the way their
// coordinates are written. Needs memory for a line. Throws InputError, with file and line, for a
// polyline of fewer than two points, or with more or fewer coordinates than it says, and for a file
// without one; Stopped.
std::string read_polylines(const std::filesystem::path& file,
                           const std::function<void(const PolylinePoint&)>& take,
                           const StopToken* stop = nullptr);
// The digest alone; of none, if `file` is empty, an empty one.
std::string survey_polylines(const std::filesystem::path& file, const StopToken* stop = nullptr);

}  // namespace locvol
