// The same as winding_surface(), to the bit, of a surface that has holes and no other fault: all of
// it but what is around its holes comes one triangle after another, again and again, and is never
// in memory.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>

#include "octree/geometry.h"
#include "octree/stop.h"
#include "refine/winding/inside_surface.h"

namespace locvol {

// An edge in one triangle alone, on the way that it has there.
struct OpenSide {
  Point from, to;
  std::uint32_t triangle = 0;
};

// Where triangles come from.
class PassingTriangles {
 public:
  using Corners = std::array<Point, 3>;

  virtual ~PassingTriangles() = default;
  virtual std::uint32_t num() const = 0;
  // visit(number, corners, group), each time in the same order, from number 0 on.
  virtual void for_each(
      const std::function<void(std::uint32_t, const Corners&, SheetId)>& visit) const = 0;
  // visit(s, t) for each edge of two triangles.
  virtual void for_each_edge(
      const std::function<void(std::uint32_t, std::uint32_t)>& visit) const = 0;
};

// Gives the triangles of the surface in order, as give(corners, group). False, before any is given:
// this is more than a matter of holes, or a hole is so wide that the level goes over it.
// Memory: 9 bytes a triangle, 1 kB an open side.
// REQUIRES: each edge is in one triangle, or in two that have it in opposite ways; no triangles
// meet but in vertices and edges that they have in common; no vertices, and no vertex and edge of a
// triangle, are nearer than the snapping distance; there are triangles and open sides. Throws
// Stopped.
bool close_holes_alone(const PassingTriangles& triangles, std::span<const OpenSide> open,
                       double spacing, double gap, WindingChanges& changes,
                       const std::function<void(const std::array<Point, 3>&, SheetId)>& give,
                       const StopToken* stop);

}  // namespace locvol
