// Cuts a triangle along others that meet it.
//
// Everything is exact until the end: then each new point is rounded to the nearest double. It is a
// function of the exact point alone, and so are the pieces of the part that two triangles of one
// plane share. So each triangle can be cut by itself: with those of its neighbors, and with those
// that it was cut along, its pieces have vertices, edges and triangles in common.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "octree/geometry.h"

namespace locvol {

struct TrianglePieces {
  // In an order that their points decide, and turned as the triangle is. One, the triangle itself:
  // nothing cuts it.
  std::vector<std::array<Point, 3>> corners;
  std::uint64_t num_collapsed = 0;  // that are missing: two corners became one, when rounded
};

// Time: some 80 µs for each of `others`; those that do not meet the triangle may be among them.
// REQUIRES: no triangle is collinear; coordinates are finite, differ by at most 1e50, and none is
// -0.0
TrianglePieces cut_triangle(const std::array<Point, 3>& triangle,
                            std::span<const std::array<Point, 3>> others);

// ---- What is nearly so ----
//
// Where rounding parts what was one, cuts would leave dust. So first triangles take over each
// other's vertices and edges where these come closer than a distance: edges get vertices that are
// near them, and one vertex where two come near to each other; faces get vertices and edges. All of
// that is a function of edges and points alone, so that neighbors agree. What is made so comes
// nearer to others, and is to be looked at again, until nothing is near that is not the same.

// Would `other` leave anything on the triangle?
bool leaves_print(const std::array<Point, 3>& triangle, const std::array<Point, 3>& other,
                  double distance);
// A triangle with a corner so near to the opposite edge has no pieces: its neighbors meet. Those of
// its plane that leave nothing may be among `others`. Time and memory: as of cut_triangle().
// REQUIRES: the distance is far above what rounding does, and far below what edges are long
TrianglePieces imprinted_triangle(const std::array<Point, 3>& triangle,
                                  std::span<const std::array<Point, 3>> others, double distance);
// Its height over its longest edge.
double height_of(const std::array<Point, 3>& triangle);

}  // namespace locvol
