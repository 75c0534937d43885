// SurfaceSink takes what a surface file holds, as it stands there.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "octree/geometry.h"
#include "storage/records.h"

namespace locvol {

// The place where something stands in the file, for messages.
struct FilePlace {
  enum class Unit { kLine, kFace } unit = Unit::kLine;
  std::uint64_t number = 0;  // from 1
};
inline std::string to_string(const FilePlace& place) {
  return (place.unit == FilePlace::Unit::kLine ? "line " : "face ") + std::to_string(place.number);
}

class SurfaceSink {
 public:
  virtual ~SurfaceSink() = default;
  // Says that so many polygons or facets are to come, for all that the file says. It is called
  // before any of them, if at all.
  virtual void announce(std::uint64_t /*num_faces*/) {}
  // What the user is to know of a file that is odd, and is read all the same.
  virtual void note(const std::string& /*text*/) {}
  // Points of two bodies that are closer to each other are meant to be one.
  virtual void precision(double /*length*/) {}
  // What comes from here on is another body, of that file: its vertices are numbered from 0 on.
  virtual void body(std::string_view /*name*/, std::string_view /*file*/) {}
  // Polygons and facets belong to the group of this name, as the file has it, until the next call.
  // Those before the first call have no name, and an empty one is none.
  virtual void group(std::string_view /*name*/) {}
  // The color of that group.
  virtual void color(const Color& /*color*/) {}
  // Vertices are numbered 0, 1, 2, … in the order of the calls. Their coordinates are finite.
  virtual void vertex(const Point& position) = 0;
  // Any number of corners, with any numbers: they may name a vertex that comes later, or never.
  virtual void polygon(std::span<const std::uint64_t> corners, const FilePlace& place) = 0;
  // A triangle with corners of its own, which are no numbered vertices. They are finite.
  virtual void facet(const std::array<Point, 3>& corners) = 0;
};

}  // namespace locvol
