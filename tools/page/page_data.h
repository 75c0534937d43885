// What the page of `locvol report` draws, as text that the page carries: JSON, and arrays that are
// packed, deflated and written in base64 (tools/page/viewer.js undoes it).
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "engine/inspect/mesh_view.h"
#include "tools/results.h"

namespace locvol {

// Positions on the page: whole steps from `origin`, at most 65535 along the longest side.
class PageGrid {
 public:
  explicit PageGrid(const Box& box);
  std::uint16_t index(const Point& p, int axis) const;
  double steps(double value, int axis) const { return (value - origin_[axis]) / step_; }
  const Point& origin() const { return origin_; }
  double step() const { return step_; }
  std::array<double, 3> extent() const;  // of the box, in steps

 private:
  Point origin_, side_;
  double step_;
};

// The packed forms, before they are deflated:
//   positions   for x, then y, then z: steps modulo 2^16 to the vertex before, the low byte of
//   each,
//               then the high byte of each
//   references  for the first corner of each cell or triangle, then the second, ...: how many
//               vertices had been named before, less the vertex; 0: the next new one. Four planes
//               of bytes, the lowest first. REQUIRES: vertices are in the order of their first
//               naming
//   levels      value from `low` to `high` as 0 to 255; what lies beyond, and NaN, at the ends
std::string packed_positions(std::span<const Point> points, const PageGrid& grid);
template <std::size_t N>
std::string packed_references(std::span<const std::array<std::uint32_t, N>> shapes);
std::string packed_levels(std::span<const float> values, double low, double high);

std::string deflated(std::string_view bytes);  // zlib's format
std::string base64(std::string_view bytes);

// Bounds of the packed qualities: degrees, ratio.
inline constexpr double kAngleBounds[] = {0, 75};
inline constexpr double kRatioBounds[] = {0.6, 2.2};

// An array in a page is an element of its own, found by its id.
using PutArray = std::function<void(const std::string& id, const std::string& base64)>;

// Hands each array over, one after another, and returns the rest as JSON. Takes the view's parts as
// it writes them, so that they are not twice in memory.
Json page_view(MeshView&& view, const RunRecord& run, const PutArray& put_array);

}  // namespace locvol
