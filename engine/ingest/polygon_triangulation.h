// Cuts polygons into triangles.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "octree/geometry.h"

namespace locvol {

inline constexpr std::size_t kMaxPolygonCorners = 10'000;  // the time grows with the square

// Replaces `triangles` by the ears clipped from a polygon with n corners: n - 2 triangles of corner
// numbers that turn as the polygon does. Decided exactly, in the coordinate plane onto which the
// polygon projects largest; corners on a straight line with their neighbors are no ears, so that
// no triangle is flat. Of a polygon whose corners are all collinear, the triangles are.
// Returns false if the polygon crosses itself there.
// REQUIRES: 3 <= corners.size() <= kMaxPolygonCorners, no corner equals the next
bool triangulate_polygon(std::span<const Point> corners,
                         std::vector<std::array<std::uint32_t, 3>>& triangles);

}  // namespace locvol
