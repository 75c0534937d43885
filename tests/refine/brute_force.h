// What refine/ computes by grids and filters, computed here the slow way: every triangle, rational
// arithmetic. Shares no code with what it judges.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "octree/geometry.h"
#include "tests/refine/shapes.h"

namespace locvol::brute_force {

using shapes::Mesh;

// The sign of the volume of abcd, exactly.
int orientation(const Point& a, const Point& b, const Point& c, const Point& d);
// Is p in the circumball of the cell (1), on its sphere (0), or outside (-1)? Exact.
// REQUIRES: the cell is positively oriented
int side_of_sphere(const std::array<Point, 4>& cell, const Point& p);

// Does the segment, moved by (ε, ε², ε³) with ε = 2^-400, cross the triangle? Exact: no
// infinitesimal, but a number so small that no determinant of doubles between 2^-100 and 2^100
// tells them apart.
bool segment_crosses(const Point& a, const Point& b, const Triangle& triangle);
// The ids of the triangles crossed, ascending.
std::vector<std::uint64_t> crossings(const Point& a, const Point& b, const Mesh& mesh);
// REQUIRES: the mesh is closed
bool is_inside(const Point& p, const Mesh& mesh);

double distance(const Point& p, const Triangle& triangle);
double distance(const Point& p, const Mesh& mesh);

struct Ball {
  Point center;
  double radius = 0;
};
// Rounded at the very end. Empty for a flat cell.
std::optional<Ball> circumball(const std::array<Point, 4>& vertices);
// The circumcircle. Empty for a triangle without area.
std::optional<Ball> circumball(const std::array<Point, 3>& corners);
// Is p in the smallest ball through the corners (1), on its sphere (0), or outside (-1)? Exact.
// REQUIRES: the triangle has an area
int side_of_smallest_ball(const std::array<Point, 3>& corners, const Point& p);

// The dual Voronoi edge of a facet between two cells, which are given by their vertices off it
// (empty: the infinite cell), without what is farther than `limit` from the facet's circumcenter;
// empty if nothing is left. REQUIRES: the two cells are not flat and lie on different sides of the
// facet
std::optional<std::array<Point, 2>> dual_edge(const std::array<Point, 3>& facet,
                                              const std::optional<Point>& here,
                                              const std::optional<Point>& there, double limit);

}  // namespace locvol::brute_force
